# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The units of evaluations: a result with its ground truth, to its scores as JSON."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..files.json_text import losses_json
from .results import UnitResult
from .unit_function import loss_lines, run_guarded, write_unit_json

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ..model.losses import Loss
    from ..options.read import ReadOptions
    from .results import Advance, UnitJob
    from .units import WorkUnit


def run_detection_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Score detections; errors of the data become the reason of a failed result."""
    return run_guarded(_score_detections, job, advance)


def run_tracking_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Score tracks; errors of the data become the reason of a failed result."""
    return run_guarded(_score_tracks, job, advance)


def run_odometry_unit(job: UnitJob, advance: Advance) -> UnitResult:
    """Score a trajectory; errors of the data become the reason of a failed result."""
    return run_guarded(_score_trajectory, job, advance)


def _score_detections(job: UnitJob, _: Advance) -> UnitResult:
    from ..evaluation.detection import score_paths  # noqa: PLC0415 - as above
    from ..evaluation.score_values import detection_values  # noqa: PLC0415 - as above
    from ..options.evaluation_tables import make_detection_options  # noqa: PLC0415 - as above

    read, options, recorded = make_detection_options(_chosen(job))
    layout = job.unit.layout
    if layout is None or not layout.traits.frame_set:  # whose labels are read as label_2
        read = _read(job.unit, read)
    scores = score_paths(job.unit.source, _result(job.unit), read, options, recorded)
    return _finish(job, detection_values(scores), scores.frames, scores.losses)


def _score_tracks(job: UnitJob, advance: Advance) -> UnitResult:
    from ..evaluation.score_values import tracking_values  # noqa: PLC0415 - as above
    from ..evaluation.track_metrics import plain_parts  # noqa: PLC0415 - as above
    from ..evaluation.tracking import score_tracking  # noqa: PLC0415 - as above
    from ..options.evaluation_tables import make_tracking_options  # noqa: PLC0415 - as above

    read, options = make_tracking_options(_chosen(job))
    read = replace(read, sequence=job.unit.sequence)
    scores = score_tracking(job.unit.source, _result(job.unit), read, options, advance)
    values = {**tracking_values(scores), 'parts': plain_parts(scores.parts)}
    return _finish(job, values, scores.frames, scores.losses)


def _score_trajectory(job: UnitJob, _: Advance) -> UnitResult:
    from ..evaluation.odometry import score_trajectory  # noqa: PLC0415 - as above
    from ..evaluation.score_values import odometry_values  # noqa: PLC0415 - as above
    from ..options.evaluation_tables import make_odometry_options  # noqa: PLC0415 - as above

    read, options = make_odometry_options(_chosen(job))
    read = _read(job.unit, read)
    scores = score_trajectory(job.unit.source, _result(job.unit), read, options)
    poses = int(scores.known.sum())
    counted = {'ape_poses': len(scores.errors.ape_m), 'rpe_pairs': len(scores.errors.rpe_m)}
    return _finish(job, {**odometry_values(scores), **counted}, poses, scores.losses)


def _chosen(job: UnitJob) -> dict[str, object]:
    return {name: value for name, value in job.options.items() if name != 'overwrite'}


def _read(unit: WorkUnit, read: ReadOptions) -> ReadOptions:
    return replace(read, layout=unit.layout, sequence=unit.sequence)


def _result(unit: WorkUnit) -> Path:
    if unit.result is None:
        raise RuntimeError(f'{unit.name}: a unit of an evaluation without a result')
    return unit.result


def _finish(
    job: UnitJob, values: dict[str, Any], frames: int, losses: Sequence[Loss]
) -> UnitResult:
    """Write the scores, with what they are of and the losses."""
    about = {'ground_truth': job.unit.source, 'sequence': job.unit.sequence}
    write_unit_json(
        job,
        {**about, 'result': job.unit.result, **values, 'losses': losses_json(losses)},
    )
    return UnitResult(
        counts={'frames': frames},
        bad=sum(loss.count for loss in losses),
        losses=loss_lines(losses),
    )
