# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of report: one recording or bag, to its HTML page."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..files.replacing import KEEP_ALL_BUT_PAGES, keep_all
from ..files.staging import staged_file
from .results import UnitResult
from .unit_function import first_lines, run_guarded

if TYPE_CHECKING:
    from .results import Advance, UnitJob


def run_report_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Write the report of a recording or bag; errors of its data become the reason of failure."""
    return run_guarded(_write_report, job, advance)


def _write_report(job: UnitJob, advance: Advance) -> UnitResult:
    from ..options.table import make_settings  # noqa: PLC0415 - as above
    from ..report.gather import gather  # noqa: PLC0415 - as above
    from ..report.page import make_page  # noqa: PLC0415 - as above

    unit = job.unit
    read = make_settings({n: v for n, v in job.options.items() if n != 'overwrite'}).read
    report = gather(unit.source, replace(read, layout=unit.layout, sequence=unit.sequence), advance)
    refusal = KEEP_ALL_BUT_PAGES if job.options.get('overwrite') else keep_all
    with staged_file(job.out, refusal) as path:
        size = path.write_bytes(make_page(report).encode())
    losses = [each for each in report.findings if each.is_loss]
    return UnitResult(
        counts={'frames': report.frames or 0, 'bytes': size},
        bad=len(losses),
        losses=first_lines(
            f'{each.where + ": " if each.where else ""}{each.text}' for each in losses
        ),
    )
