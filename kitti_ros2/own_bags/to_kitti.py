# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of bags to KITTI: the files byte for byte if to-bag wrote them, else by a plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..bags.reader import bag_stamps
from ..messages.source import RECORDING
from ..model.losses import Loss
from .numbering import number_bag
from .recorded_layout import EarlierVersionError, UndescribedError, find_blueprint
from .restore import restore

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..exporter.to_bag import ShowProgress
    from ..importer.report import ImportReport
    from ..options.importing import ImportOptions
    from .recorded_layout import Blueprint


def convert_bags(
    bags: Sequence[OpenBag],
    out: Path,
    options: ImportOptions,
    plan_file: Path | None,
    progress: ShowProgress,
    note: Callable[[str], None],
) -> list[ImportReport]:
    """Convert bags to one data set: byte for byte where to-bag wrote them, else by a plan.

    Args:
        bags: The bags, open.
        out: The folder to create, or to append to.
        options: Of the conversion.
        plan_file: A plan to use, None for the one that the bags suggest.
        progress: Called with the number of samples and of frames; returns a context with a function
            that is called with the samples done and the bytes written so far.
        note: Called with each remark before the conversion.

    Raises:
        KittiRos2Error: A bag, the plan or an option is invalid, or the output cannot be written.
        OSError: A file cannot be read.
    """
    recordings, losses = own_bags(bags, options, planned=plan_file is not None)
    keeps = all(options.keeps(blueprint.layout) for _, blueprint in recordings)
    if recordings and keeps and plan_file is None:
        files = sum(blueprint.files for _, blueprint in recordings)
        frames = sum(_count_frames(*each) for each in recordings)
        with progress(files, frames) as show:
            return restore(recordings, out, show)
    # Bags that to-bag wrote need none of these.
    from ..importer.append import mend  # noqa: PLC0415
    from ..importer.apply_plan import adapt, convert_by_plan, guess  # noqa: PLC0415
    from ..importer.frames import frame_topics, topic_of  # noqa: PLC0415
    from ..importer.plan import parse_plan  # noqa: PLC0415
    from ..importer.survey import look  # noqa: PLC0415
    from ..kitti.store import STORE  # noqa: PLC0415

    survey = look(bags)
    counts = {topic.name: topic.count for topic in survey.topics.values()}
    for _, blueprint in recordings:
        losses += (*blueprint.losses, *blueprint.shortfall(counts))
    if plan_file is not None:
        plan = adapt(parse_plan(STORE.read_text(plan_file), plan_file), options)
    else:
        found = guess(bags, survey, options)
        plan, losses = found.plan, (*losses, *found.losses)
        for remark in found.notes:
            note(remark)
    for remark in mend(out) if options.append else ():
        note(remark)
    samples = sum(topic_of(survey, topic).count for topic in frame_topics(plan).values())
    with progress(samples, samples) as show:
        report = convert_by_plan(bags, plan, survey, out, options, show)
    reported = {loss.text() for loss in losses}
    notes = tuple(each for each in report.notes if each not in reported)
    return [replace(report, losses=(*losses, *report.losses), notes=notes)]


def _count_frames(bag: OpenBag, blueprint: Blueprint) -> int:
    numbered = number_bag(bag, bag_stamps(bag), blueprint=blueprint, by_header=False)
    return 0 if numbered is None else len(numbered.frames)


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
