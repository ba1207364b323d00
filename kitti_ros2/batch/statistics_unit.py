# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of stats: one recording or bag, to its statistics as JSON."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from .results import UnitResult
from .unit_function import loss_lines, run_guarded, write_unit_json

if TYPE_CHECKING:
    from .results import Advance, UnitJob


def run_statistics_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Count what is in a recording or bag; errors of its data become the reason of failure."""
    return run_guarded(_count, job, advance)


def _count(job: UnitJob, advance: Advance) -> UnitResult:
    from ..datasets.set_statistics import count_set, find_sources  # noqa: PLC0415 - as above
    from ..datasets.statistics_rows import plain_values  # noqa: PLC0415 - as above
    from ..options.dataset_tables import make_statistics_options  # noqa: PLC0415 - as above

    unit = job.unit
    chosen = {name: value for name, value in job.options.items() if name != 'overwrite'}
    read, options = make_statistics_options(chosen)
    read = replace(read, layout=unit.layout, sequence=unit.sequence)
    found = count_set(unit.source, find_sources(unit.source, read), options, advance)
    write_unit_json(job, plain_values(found))
    return UnitResult(
        counts={'frames': found.total.frames, 'objects': found.total.objects},
        bad=sum(loss.count for loss in found.total.losses),
        losses=loss_lines(found.total.losses),
    )
