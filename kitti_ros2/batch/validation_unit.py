# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of validate: one recording or bag, to its findings as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .results import UnitResult
from .unit_function import first_lines, run_guarded, write_unit_json

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..validation.results import ValidationReport
    from .results import Advance, UnitJob


def run_validation_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Check a recording or bag; its errors are findings, not failures.

    A unit that cannot be checked at all has failed.
    """
    return run_guarded(_check, job, advance)


def _check(job: UnitJob, advance: Advance) -> UnitResult:
    from ..validation.validate import validate  # noqa: PLC0415 - as above

    unit = job.unit
    chosen: Any = {name: value for name, value in job.options.items() if name != 'overwrite'}
    chosen |= {'layout': unit.layout, 'sequence': unit.sequence}
    report = validate(unit.source, progress=advance, **chosen)
    write_unit_json(job, {**asdict(report), 'ok': report.ok})
    return UnitResult(
        counts={
            'files': sum(source.files for source in report.sources),
            'warnings': report.warnings,
            'bytes': sum(source.size_bytes for source in report.sources),
        },
        bad=report.errors,
        losses=first_lines(_error_lines(report)),
    )


def _error_lines(report: ValidationReport) -> Iterator[str]:
    from ..validation.rule import RuleSeverity  # noqa: PLC0415 - as above

    for each in report.findings:
        if each.severity == RuleSeverity.ERROR.value:
            yield f'{each.rule}: {each.place}: {each.message} ({each.remedy})'
