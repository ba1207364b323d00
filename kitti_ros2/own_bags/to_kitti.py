# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of bags to KITTI: the files byte for byte if to-bag wrote them, else by a plan.

Also the plan in advance, before anything is written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..bags.bag_files import path_of
from ..bags.reader import bag_stamps
from ..importer.apply_plan import adapt, guess, streams_of_topics
from ..importer.bag_scans import labelled_fields
from ..importer.plan import parse_plan
from ..importer.survey import survey_bags
from ..kitti.store import STORE
from ..messages.naming import FILES, RECORDING
from ..messages.topics import own_topics
from ..model.errors import (
    Loss,
    MissingDataError,
    UsageError,
)
from ..model.streams import Layout, LayoutTraits, Stream
from .missing_files import is_calibration
from .numbering import number_bag, select_part, select_times, tracklets_by_stamp
from .restore import restore, restored_topics
from .source_files import (
    EarlierVersionError,
    UndescribedError,
    find_source_files,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import OpenBag
    from ..importer.kitti_frames import ImportReport
    from ..importer.plan import Plan
    from ..importer.survey import Survey
    from ..options.outputs import ImportOptions
    from ..options.read import SelectionOptions
    from .source_files import SourceFiles
    from .to_bag import ShowProgress


# Conversion of bags to KITTI: the files byte for byte if to-bag wrote them, else by a plan.


@dataclass(frozen=True)
class Conversion:
    """A conversion of bags to a data set.

    Attributes:
        bags: All bags of the call.
        out: The data set.
        options: Import options.
        plan_file: A plan to use.
        note: Called with each note that is known before anything is written.
        progress: Called with the number of samples and of frames; returns a context with a function
            that is called with the samples done and the bytes written so far.
        survey: The content of the bags, if it is known already.
    """

    bags: Sequence[OpenBag]
    out: Path
    options: ImportOptions
    plan_file: Path | None
    note: Callable[[str], None]
    progress: ShowProgress
    survey: Survey | None = None

    def run(self) -> list[ImportReport]:
        """Restore the recordings of bags written by to-bag, or convert by a plan.

        Raises:
            KittiRos2Error: A bag, the plan or an option is invalid; nothing is left behind.
            OSError: A file cannot be read.
        """
        options = self.options
        own, losses = own_bags(self.bags, options, planned=self.plan_file is not None)
        if not is_restored(own, options) or self.plan_file is not None:
            if self.plan_file is None and lacks_numbers(own):
                options, note = _as_recorded(own, options)
                losses += (Loss(FILES, 1, note),)
            return self._convert_by_plan(own, losses, options)
        if options.train_fraction < 1:
            raise UsageError(
                '--split is for object sets that are made by a plan; to-bag wrote this bag, and its'
                ' files come back as they were: leave it out, and divide the data set by'
                ' kitti-ros2 split'
            )
        if options.origin is not None:
            raise UsageError(
                '--origin is for oxts that are made of poses; to-bag wrote this bag, and its files'
                ' come back as they were: leave it out, or give a plan with --plan-file'
            )
        selected = [(bag, select_part(bag, files, options.selection)) for bag, files in own]
        count = sum(files.files for _, files in selected)
        frames = sum(_count_frames(*pair) for pair in selected)
        with self.progress(count, frames) as show:
            return restore(
                selected,
                self.out,
                show,
                png=options.png,
                snap=options.snap,
                overwrite=options.overwrite,
                fsync=options.fsync,
            )

    def _convert_by_plan(
        self,
        recordings: Sequence[tuple[OpenBag, SourceFiles]],
        losses: tuple[Loss, ...],
        options: ImportOptions,
    ) -> list[ImportReport]:
        """Convert by a plan.

        Args:
            recordings: The bags with their source files, if to-bag wrote all of them.
            losses: Their damaged descriptions.
            options: Import options, with the layout and the name.
        """
        from ..importer.apply_plan import adapt, convert, guess, plans_of  # noqa: PLC0415
        from ..importer.guess import unused_notes  # noqa: PLC0415
        from ..importer.kitti_frames import frame_topics  # noqa: PLC0415
        from ..importer.plan import parse_plan  # noqa: PLC0415
        from ..importer.survey import survey_bags, topic_of  # noqa: PLC0415
        from ..kitti.append import mend  # noqa: PLC0415
        from ..kitti.store import STORE  # noqa: PLC0415

        survey = with_tracklets(self.survey or survey_bags(self.bags), recordings)
        counts = {topic.name: topic.count for topic in survey.topics.values()}
        for _, source_files in recordings:
            losses += (*source_files.losses, *source_files.shortfall(counts))
            if source_files.columns is not None and source_files.columns.extra:
                extra = ', '.join(source_files.columns.extra)
                self.note(f'scans of a plan have x y z reflectance; left out: {extra}')
        reported = set[str]()
        if self.plan_file is not None:
            plan = adapt(parse_plan(STORE.read_text(self.plan_file), self.plan_file), options)
            for note in unused_notes(survey, plan):
                self.note(note)
        else:
            guessed = guess(self.bags, survey, options)
            plan, losses = guessed.plan, (*losses, *guessed.losses)
            for note in guessed.notes:
                self.note(note)
            reported |= set(guessed.notes)
        for note in mend(self.out) if options.append else ():
            self.note(note)
        plans = plans_of(plan).values()
        options = replace(options, selection=selected(recordings, plan, options))
        samples = sum(
            topic_of(survey, topic).count for plan in plans for topic in frame_topics(plan).values()
        )
        with self.progress(samples, samples) as show:
            reports = convert(self.bags, plan, survey, self.out, options, show)
        reported |= {loss.text() for loss in losses}
        for index, report in enumerate(reports):
            notes = tuple(note for note in report.notes if note not in reported)
            before = losses if index == 0 else ()
            reports[index] = replace(report, losses=(*before, *report.losses), notes=notes)
        return reports


def _count_frames(bag: OpenBag, source_files: SourceFiles) -> int:
    if source_files.selected is not None:
        return len(frozenset().union(*map(source_files.requested, source_files.folders)))
    numbered = number_bag(bag, bag_stamps(bag), source_files=source_files, by_header=False)
    return 0 if numbered is None else len(numbered.frames)


def lacks_numbers(recordings: Sequence[tuple[OpenBag, SourceFiles]]) -> bool:
    """Return whether no sample of a bag has a known number: the files of stamps are missing."""
    if len(recordings) != 1:
        return False  # a plan would make one recording of several
    ((_, source_files),) = recordings
    topics = restored_topics(source_files.topics)
    streams = {own_topics()[t].stream for t in topics if not own_topics()[t].is_frame_text}
    numbers = [source_files.numbers_by_stamp(s) for s in streams.intersection(source_files.folders)]
    return bool(numbers) and all(by_stamp is None for by_stamp in numbers)


def is_restored(recordings: Sequence[tuple[OpenBag, SourceFiles]], options: ImportOptions) -> bool:
    """Return whether the original files of bags written by to-bag come back, without a plan."""
    kept = all(options.keeps(files.layout) for _, files in recordings)
    return bool(recordings) and kept and not lacks_numbers(recordings)


def selected(
    recordings: Sequence[tuple[OpenBag, SourceFiles]], plan: Plan, options: ImportOptions
) -> SelectionOptions:
    """Return the selection of a conversion by a plan; KITTI's file numbers become stamps.

    Args:
        recordings: The bags with their source files, if to-bag wrote all of them.
        plan: The plan.
        options: Import options.

    Raises:
        UsageError: The bag has no sample of these numbers.
    """
    if len(recordings) != 1:
        return options.selection
    from ..importer.kitti_frames import frame_topics  # noqa: PLC0415

    topics = frame_topics(plan)
    reference = next((t for s, t in topics.items() if s.value == plan.reference), '')
    return select_times(*recordings[0], reference, options.selection)


def with_tracklets(survey: Survey, recordings: Sequence[tuple[OpenBag, SourceFiles]]) -> Survey:
    """Add the tracklets of raw drives to the survey of their bags; leave out half a calibration."""
    tracklets = tracklets_by_stamp(source_files for _, source_files in recordings)
    survey = replace(survey, tracklets=tracklets) if tracklets else survey
    half = any(
        is_calibration(source_files.layout, path)
        for _, source_files in recordings
        for path in source_files.missing
    )
    return replace(survey, calibrations=()) if half else survey


def own_bags(
    bags: Sequence[OpenBag], options: ImportOptions, *, planned: bool = False
) -> tuple[list[tuple[OpenBag, SourceFiles]], tuple[Loss, ...]]:
    """Return bags written by to-bag with their source files, and damaged descriptions.

    Args:
        bags: All bags of the call.
        options: With a layout, a bag may be converted by a plan instead.
        planned: Whether a plan is given.

    Returns:
        No bags unless every one was written by to-bag; and the damaged descriptions.

    Raises:
        BadBagError: One is not a bag.
        UndescribedError: A description is unusable, and there is no plan.
    """
    recordings, losses = [], []
    for bag in bags:
        try:
            source_files = find_source_files(bag)
        except UndescribedError as error:
            if options.layout is None and not planned:
                raise
            if not isinstance(error, EarlierVersionError):
                losses.append(Loss(RECORDING, 1, str(error)))
            continue
        if source_files is not None:
            recordings.append((bag, source_files))
    return recordings if len(recordings) == len(bags) else [], tuple(losses)


# The plan by which bags would be converted, before anything is written.


@dataclass(frozen=True)
class PlanProposal:
    """The plan of a conversion.

    Attributes:
        survey: The content of the bags.
        plan: The plan that was given, or the one that was guessed.
        options: Import options, with the layout and the selection of the plan.
        notes: Notes, missing data and damage, a line each.
        restored: Whether to-bag wrote the bags and no option changes that: without a plan the
            original files come back.
        reason: Why the layout was chosen; empty if it was given.
        layouts: Without a given layout: by possible layout the streams that it would have.
    """

    survey: Survey
    plan: Plan
    options: ImportOptions
    notes: tuple[str, ...]
    restored: bool = False
    reason: str = ''
    layouts: Mapping[Layout, tuple[str, ...]] | None = None


def propose_plan(
    bags: Sequence[OpenBag],
    options: ImportOptions,
    plan_file: Path | None = None,
    *,
    any_layout: bool = False,
) -> PlanProposal:
    """Survey bags, and make or read the plan of their conversion.

    Args:
        bags: The bags of one recording.
        options: Import options.
        plan_file: A plan to use.
        any_layout: Whether a missing layout is chosen by the content of the bags.

    Raises:
        KittiRos2Error: A bag, the plan or an option is invalid.
    """
    own, damaged = own_bags(bags, options, planned=plan_file is not None)
    if plan_file is not None:
        plan = adapt(parse_plan(STORE.read_text(plan_file), plan_file), options)
        survey = with_tracklets(survey_bags(bags), own)
        options = replace(options, selection=selected(own, plan, options))
        return PlanProposal(survey, plan, options, (*survey.notes, *survey.losses))
    restored = is_restored(own, options)
    notes: tuple[str, ...] = ()
    if own:
        options, note = _as_recorded(own, options)
        notes = (note,)
    survey = with_tracklets(survey_bags(bags), own)
    reason, layouts = '', None
    if options.layout is None and any_layout:
        plans = _every_plan(bags, survey, options)
        layout, reason = _choose_layout(plans, survey)
        options = replace(options, layout=layout)
        layouts = {layout: _streams(plan, survey) for layout, plan in plans.items()}
    guessed = guess(bags, survey, options)
    notes += (*guessed.notes, *(loss.text() for loss in (*damaged, *guessed.losses)))
    notes += (*survey.notes, *survey.losses)
    options = replace(options, selection=selected(own, guessed.plan, options))
    notes = tuple(dict.fromkeys(notes))
    return PlanProposal(survey, guessed.plan, options, notes, restored, reason, layouts)


def _as_recorded(
    recordings: Sequence[tuple[OpenBag, SourceFiles]], options: ImportOptions
) -> tuple[ImportOptions, str]:
    """Return the options with layout and name of a bag written by to-bag, and a note about it."""
    bag, source_files = recordings[0]
    name = source_files.name
    if options.layout in (None, source_files.layout):
        options = replace(options, layout=source_files.layout, name=options.name or name)
    if lacks_numbers(recordings):
        return options, (
            f'{path_of(bag).name}: without the stamps of the files their numbers are unknown: a'
            f' plan converts {name}, with frames numbered from 0'
        )
    return options, f'made by to-bag: without a plan every file of {name} comes back as it was'


def _every_plan(
    bags: Sequence[OpenBag], survey: Survey, options: ImportOptions
) -> dict[Layout, Plan]:
    """Return the plans of all layouts that are possible.

    Raises:
        MissingDataError: None is.
    """
    plans, errors = {}, []
    for layout in filter(lambda layout: layout.traits.from_others, Layout):
        try:
            plans[layout] = guess(bags, survey, replace(options, layout=layout)).plan
        except (MissingDataError, UsageError) as error:
            errors.append(error)
    if not plans:
        raise errors[-1]
    return plans


_PREFERENCES: Sequence[tuple[Callable[[LayoutTraits, Plan, Survey], bool], str]] = (
    (lambda traits, plan, _: traits.frame_set and plan.labels is not None, 'the bag has 3D boxes'),
    (
        lambda traits, plan, survey: traits.point_labels and _are_labelled(plan, survey),
        'the points have labels',
    ),
    (lambda traits, plan, _: traits.dated and bool(plan.fix), 'the bag has GPS'),
    (
        lambda traits, plan, _: Stream.POSE in traits.streams and plan.pose is not None,
        'the bag has poses',
    ),
    (lambda traits, _plan, _: traits.frame_set, 'the bag has neither 3D boxes nor GPS nor poses'),
    (lambda _traits, _plan, _: True, 'the first that is possible'),
)
"""Contents of a bag with the layout that most programs expect: the first possible one counts."""


def _are_labelled(plan: Plan, survey: Survey) -> bool:
    return plan.scan is not None and bool(labelled_fields(survey.topics[plan.scan.topic]))


def _choose_layout(plans: Mapping[Layout, Plan], survey: Survey) -> tuple[Layout, str]:
    """Return the layout that most programs expect for the content of a bag, and the reason."""
    return next(
        (layout, reason)
        for fits, reason in _PREFERENCES
        for layout, plan in plans.items()
        if fits(layout.traits, plan, survey)
    )


def _streams(plan: Plan, survey: Survey) -> tuple[str, ...]:
    """Return the streams of a plan, by name."""
    present = {name for names in streams_of_topics(plan, survey).values() for name in names}
    return tuple(stream.value for stream in Stream if stream.value in present)
