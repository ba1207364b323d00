# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit of to-bag: one recording, or a slice of one, to one bag."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.containers import CONTAINERS
from ..model.errors import UsageError
from .results import UnitResult
from .unit_function import loss_lines, run_guarded, samples_shown

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..exporter.to_bag import ExportReport
    from .results import Advance, UnitJob


def bag_suffix(options: Mapping[str, object]) -> str:
    """Return the ending of the bags: a container's, or empty where a bag is a directory.

    Raises:
        UsageError: An option is invalid.
    """
    from ..bags.writer import guess_storage  # noqa: PLC0415 - as below
    from ..options.table import make_settings  # noqa: PLC0415 - as below

    settings = make_settings(options)
    storage = guess_storage(Path(), settings.storage)
    bag = settings.bag(storage)
    container = CONTAINERS[storage]
    return container.suffix if container.in_file and not bag.split else ''


def run_bag_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Convert a unit; errors of its data become the reason of a failed result."""
    return run_guarded(_convert_recording, job, advance)


def _convert_recording(job: UnitJob, advance: Advance) -> UnitResult:
    report = _exported(job, advance)
    return UnitResult(
        counts={
            'frames': report.frames,
            'messages': sum(report.counts.values()),
            'bytes': report.size_bytes,
        },
        bad=sum(loss.count for loss in report.losses),
        losses=loss_lines(report.losses),
        notes=report.notes,
    )


def _exported(job: UnitJob, advance: Advance) -> ExportReport:
    # What one kind of units needs takes tenths of a second, and workers import it at their start.
    from ..bags.open_folder import open_folder  # noqa: PLC0415
    from ..exporter.to_bag import ExportOptions, convert  # noqa: PLC0415
    from ..kitti.extract_oxts import add_extract  # noqa: PLC0415
    from ..kitti.predictions import add_predictions  # noqa: PLC0415
    from ..options.selection import Bound  # noqa: PLC0415
    from ..options.table import make_settings  # noqa: PLC0415

    unit, settings = job.unit, make_settings(job.options)
    read = replace(settings.read, layout=unit.layout, sequence=unit.sequence)
    selection = settings.selection
    if unit.first is not None:
        if not selection.is_whole:
            raise UsageError('--slice-frames chooses the frames; leave --start and --end out')
        selection = replace(selection, start=Bound(frame=unit.first), end=Bound(frame=unit.last))
    recording = open_folder(unit.source, read)
    add_predictions(recording, settings.predictions.path)
    add_extract(recording, settings.imu)
    return convert(
        recording,
        job.out,
        ExportOptions.of(replace(settings, selection=selection), job.out),
        progress=partial(samples_shown, advance),
    )
