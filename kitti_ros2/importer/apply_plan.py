# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Any bag -> KITTI: survey it, make a plan, convert by the plan."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..bags.reader import path_of
from ..files.staging import staged
from ..kitti.replacing import keep_all_but_camera_sets, keep_all_but_data_sets
from ..model.errors import UsageError
from ..model.layouts import Layout
from .append import appended
from .camera_sets import build_sets, folder_of, plans_of
from .clocks import clock_notes, clocked
from .convert import build
from .guess import Guess, guess_plan
from .loader_notes import loader_notes
from .passed_over import passed_over
from .plan import NONE
from .set_builder import Target

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..bags.reader import BagSource
    from ..options.importing import ImportOptions
    from .plan import Plan
    from .report import ImportReport
    from .survey import Survey


def guess(bags: Sequence[BagSource], survey: Survey, options: ImportOptions) -> Guess:
    """Make the most complete plan for bags.

    Raises:
        MissingDataError: They contain no data that the layout requires.
        UsageError: The options name no layout.
    """
    if options.layout is None:
        known = ', '.join(layout.value for layout in Layout)
        raise UsageError(f'{path_of(bags[0])}: which layout is wanted? give --layout {known}')
    if options.all_cameras and survey.calibrations:
        raise UsageError('--all-cameras is for bags of other programs; to-bag wrote this one')
    for (parent, child), topics in survey.clashes.items():
        raise UsageError(
            f'{path_of(bags[0])}: {topics[0]} and {topics[1]} differ in {parent} -> {child}, so'
            f' they are of two robots; expected one: leave the topics of the other out of the bag'
        )
    found = guess_plan(
        survey,
        options.layout,
        path_of(bags[0]),
        all_cameras=options.all_cameras,
        with_calibration=options.calib is not None,
    )
    plan, notes = adapt(found.plan, options), found.notes
    if plan.labels is not None and plan.calibration == NONE:
        notes += (f'{plan.labels.topic}: left out, for labels need a calibration',)
        plan = replace(plan, labels=None)
    notes += (*clock_notes(clocked(survey, plan), plan), *loader_notes(plan, survey))
    return replace(found, plan=plan, notes=(*notes, *passed_over(survey, plan, notes)))


def adapt(plan: Plan, options: ImportOptions) -> Plan:
    """Override a plan by options.

    Raises:
        UsageError: The options contradict it.
    """
    if options.layout not in (None, plan.layout):
        raise UsageError(
            f'the plan is for layout {plan.layout.value}, not {options.layout};'
            f' make one with --plan --layout'
        )
    if options.name is not None:
        plan = replace(plan, name=options.name)
    if options.calib is not None:
        plan = replace(plan, calibration=str(options.calib))
    if options.origin is not None:
        plan = replace(plan, origin=options.origin)
    _check_sets(plan, options)
    if options.append and not plan.layout.traits.frame_set:
        raise UsageError('--append continues an object set; other layouts have sequences')
    return plan


def _check_sets(plan: Plan, options: ImportOptions) -> None:
    """Check the options for one data set a camera.

    Raises:
        UsageError: They contradict the plan.
    """
    if options.all_cameras and not plan.camera_sets:
        raise UsageError(
            '--all-cameras needs cameras with a camera_info; with --plan-file the plan lists them'
            ' as camera_sets (print one with --all-cameras --plan)'
        )
    if plan.camera_sets and options.append:
        raise UsageError('--append continues one object set; the plan has a set for each camera')


def convert(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    out: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> list[ImportReport]:
    """Convert bags by a plan, as convert_by_plan, also one with a data set for each camera."""
    if not plan.camera_sets:
        return [convert_by_plan(bags, plan, survey, out, options, progress)]
    folders = [folder_of(plan, name) for name in plans_of(plan)]
    refusal = keep_all_but_camera_sets(folders) if options.overwrite else None
    with staged(out, refusal, fsync=options.fsync) as stage:
        return build_sets(bags, plan, survey, stage, options, progress)


def convert_by_plan(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    out: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> ImportReport:
    """Convert bags by a plan.

    Args:
        bags: Those of one recording.
        plan: The rules of the conversion.
        survey: Their content.
        out: The data set's folder, absent or empty unless the options append or overwrite.
        options: Of the output.
        progress: Called with the samples and the bytes written so far.

    Raises:
        BadBagError: A bag cannot be read.
        UsageError: The plan names a missing topic.
        MissingDataError: The calibration is missing.
        OutputExistsError: The folder is not empty.
        OutputError: It cannot be written.
    """
    if options.append:
        with appended(out, plan.name, fsync=options.fsync) as place:
            report = build(bags, plan, survey, Target(place.stage, place.first), options, progress)
        return replace(report, notes=(*place.notes, *report.notes))
    refusal = keep_all_but_data_sets(1) if options.overwrite else None
    with staged(out, refusal, fsync=options.fsync) as stage:
        return build(bags, plan, survey, Target(stage), options, progress)
