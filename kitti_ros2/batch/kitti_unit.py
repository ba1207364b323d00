# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of to-kitti: one bag, to a folder of its own."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from .results import UnitResult
from .unit_function import loss_lines, run_guarded, samples_shown

if TYPE_CHECKING:
    from .results import Advance, UnitJob

PLAN_FILE = 'plan_file'
"""Name of the plan among the options of a unit."""


def run_kitti_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Convert a bag; errors of its data become the reason of a failed result."""
    return run_guarded(_convert_bag, job, advance)


def _convert_bag(job: UnitJob, advance: Advance) -> UnitResult:
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - as above
    from ..options.table import make_import_options  # noqa: PLC0415 - as above
    from ..own_bags.to_kitti import Conversion  # noqa: PLC0415 - as above

    chosen = dict(job.options)
    plan_file = chosen.pop(PLAN_FILE, None)
    options = make_import_options(chosen)
    notes: list[str] = []
    with open_bag_source(job.unit.source) as bag:
        conversion = Conversion(
            [bag],
            job.out,
            options,
            plan_file,  # type: ignore[arg-type] # a path, put there by the command
            notes.append,
            partial(samples_shown, advance),
        )
        reports = conversion.run()
    losses = [loss for report in reports for loss in report.losses]
    return UnitResult(
        counts={
            'frames': sum(report.frames for report in reports),
            'files': sum(sum(report.counts.values()) for report in reports),
            'bytes': sum(report.size_bytes for report in reports),
        },
        bad=sum(loss.count for loss in losses),
        losses=loss_lines(losses),
        notes=(*notes, *(note for report in reports for note in report.notes)),
    )
