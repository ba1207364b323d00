# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of bags to KITTI: the files byte for byte if to-bag wrote them, else by a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..bags.reader import bag_stamps
from ..messages.source import RECORDING
from ..model.errors import UsageError
from ..model.losses import Loss
from .numbering import number_bag
from .part import select_part, select_times
from .recorded_layout import EarlierVersionError, UndescribedError, find_blueprint
from .restore import restore
from .stamp_numbers import tracklets_by_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..exporter.to_bag import ShowProgress
    from ..importer.plan import Plan
    from ..importer.report import ImportReport
    from ..importer.survey import Survey
    from ..options.importing import ImportOptions
    from ..options.selection import SelectionOptions
    from .blueprint import Blueprint


@dataclass(frozen=True)
class Conversion:
    """A conversion of bags to a data set.

    Attributes:
        bags: All bags of the call.
        out: The data set.
        options: Of the conversion.
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
            return self._convert_by_plan(own, losses)
        if options.origin is not None:
            raise UsageError(
                '--origin is for oxts that are made of poses; to-bag wrote this bag, and its files'
                ' come back as they were: leave it out, or give a plan with --plan-file'
            )
        selected = [(bag, select_part(bag, each, options.selection)) for bag, each in own]
        files = sum(blueprint.files for _, blueprint in selected)
        frames = sum(_count_frames(*each) for each in selected)
        with self.progress(files, frames) as show:
            return restore(
                selected, self.out, show, overwrite=options.overwrite, fsync=options.fsync
            )

    def _convert_by_plan(
        self, recordings: Sequence[tuple[OpenBag, Blueprint]], losses: tuple[Loss, ...]
    ) -> list[ImportReport]:
        """Convert by a plan.

        Args:
            recordings: The bags with their layouts, if to-bag wrote all of them.
            losses: Their damaged descriptions.
        """
        from ..importer.append import mend  # noqa: PLC0415
        from ..importer.apply_plan import adapt, convert, guess  # noqa: PLC0415
        from ..importer.camera_sets import plans_of  # noqa: PLC0415
        from ..importer.frames import frame_topics  # noqa: PLC0415
        from ..importer.passed_over import passed_over  # noqa: PLC0415
        from ..importer.plan_text import parse_plan  # noqa: PLC0415
        from ..importer.planned_topics import topic_of  # noqa: PLC0415
        from ..importer.survey import look  # noqa: PLC0415
        from ..kitti.store import STORE  # noqa: PLC0415

        survey = with_tracklets(self.survey or look(self.bags), recordings)
        counts = {topic.name: topic.count for topic in survey.topics.values()}
        for _, blueprint in recordings:
            losses += (*blueprint.losses, *blueprint.shortfall(counts))
            if blueprint.columns is not None and blueprint.columns.extra:
                extra = ', '.join(blueprint.columns.extra)
                self.note(f'scans of a plan have x y z reflectance; left out: {extra}')
        reported = set[str]()
        if self.plan_file is not None:
            plan = adapt(parse_plan(STORE.read_text(self.plan_file), self.plan_file), self.options)
            for remark in passed_over(survey, plan):
                self.note(remark)
        else:
            found = guess(self.bags, survey, self.options)
            plan, losses = found.plan, (*losses, *found.losses)
            for remark in found.notes:
                self.note(remark)
            reported |= set(found.notes)
        for remark in mend(self.out) if self.options.append else ():
            self.note(remark)
        plans = plans_of(plan).values()
        options = replace(self.options, selection=selected(recordings, plan, self.options))
        samples = sum(
            topic_of(survey, topic).count for each in plans for topic in frame_topics(each).values()
        )
        with self.progress(samples, samples) as show:
            reports = convert(self.bags, plan, survey, self.out, options, show)
        reported |= {loss.text() for loss in losses}
        for place, report in enumerate(reports):
            notes = tuple(each for each in report.notes if each not in reported)
            before = losses if place == 0 else ()
            reports[place] = replace(report, losses=(*before, *report.losses), notes=notes)
        return reports


def _count_frames(bag: OpenBag, blueprint: Blueprint) -> int:
    if blueprint.selected is not None:
        return len(frozenset().union(*map(blueprint.requested, blueprint.folders)))
    numbered = number_bag(bag, bag_stamps(bag), blueprint=blueprint, by_header=False)
    return 0 if numbered is None else len(numbered.frames)


def is_restored(recordings: Sequence[tuple[OpenBag, Blueprint]], options: ImportOptions) -> bool:
    """Whether the original files of bags written by to-bag come back, without a plan."""
    return bool(recordings) and all(options.keeps(each.layout) for _, each in recordings)


def selected(
    recordings: Sequence[tuple[OpenBag, Blueprint]], plan: Plan, options: ImportOptions
) -> SelectionOptions:
    """Return the selection of a conversion by a plan; KITTI's file numbers become stamps.

    Args:
        recordings: The bags with their layouts, if to-bag wrote all of them.
        plan: Of the conversion.
        options: Of the conversion.

    Raises:
        UsageError: The bag has no sample of these numbers.
    """
    if len(recordings) != 1:
        return options.selection
    from ..importer.frames import frame_topics  # noqa: PLC0415

    topics = frame_topics(plan)
    reference = next((t for s, t in topics.items() if s.value == plan.reference), '')
    return select_times(*recordings[0], reference, options.selection)


def with_tracklets(survey: Survey, recordings: Sequence[tuple[OpenBag, Blueprint]]) -> Survey:
    """Add the tracklets of raw drives to the survey of their bags."""
    found = tracklets_by_stamp(blueprint for _, blueprint in recordings)
    return replace(survey, tracklets=found) if found else survey


def own_bags(
    bags: Sequence[OpenBag], options: ImportOptions, *, planned: bool = False
) -> tuple[list[tuple[OpenBag, Blueprint]], tuple[Loss, ...]]:
    """Return bags written by to-bag with their original layouts, and damaged descriptions.

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
    found, losses = [], []
    for bag in bags:
        try:
            blueprint = find_blueprint(bag)
        except UndescribedError as error:
            if options.layout is None and not planned:
                raise
            if not isinstance(error, EarlierVersionError):
                losses.append(Loss(RECORDING, 1, str(error)))
            continue
        if blueprint is not None:
            found.append((bag, blueprint))
    return found if len(found) == len(bags) else [], tuple(losses)
