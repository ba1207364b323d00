# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores as plain values, for JSON, and the combined scores of several results."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..files.output_rules import losses_json
from .track_metrics import combine_parts

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from .detection import DetectionScores, WorstFrame
    from .odometry import OdometryScores
    from .track_metrics import Figures
    from .tracking import TrackingScores


# Scores as plain values, for JSON.


def detection_values(scores: DetectionScores) -> dict[str, object]:
    """Return the scores of detections: percent, and the worst frames if requested."""
    worst = {} if scores.worst is None else {'worst': _worst(scores.worst)}
    return {**scores.percent(), **worst}


def _worst(worst: Sequence[WorstFrame]) -> list[dict[str, object]]:
    return [{**asdict(frame), 'penalty': round(frame.penalty, 4)} for frame in worst]


def odometry_values(scores: OdometryScores) -> dict[str, object]:
    """Return the scores of a trajectory: percent, degrees per metre, metres."""
    figures = {
        't_err_percent': scores.t_err_percent,
        'r_err_deg_per_m': scores.r_err_deg_per_m,
        'segments': len(scores.segments),
        'ape_m': scores.ape_m,
        'rpe_m': scores.rpe_m,
    }
    if scores.alignment.has_scale:
        figures['scale'] = scores.errors.scale
    return {'odometry': {scores.name: figures}}


def tracking_values(scores: TrackingScores) -> dict[str, object]:
    """Return the scores of tracks: percent, or counts."""
    return {
        'tracking': scores.classes,
        'sequences': scores.sequences,
        'frames': scores.frames,
        'losses': losses_json(scores.losses),
    }


# Combined scores of several results, read from JSON.
#
# KITTI's errors of a trajectory are means over the segments of all sequences, and APE and RPE are
# roots of mean squares over their frames, so both follow from the figures of single sequences and
# their numbers of segments and frames. TrackEval has rules of its own. An average precision does
# not follow from those of parts.

if TYPE_CHECKING:
    Values = Mapping[str, Any]


def combined_odometry(results: Sequence[Values]) -> dict[str, float | int | None]:
    """Return the errors of several sequences together.

    Args:
        results: The JSON of each: odometry_values, ape_poses and rpe_pairs.
    """
    figures = [(result, figure) for result in results for figure in result['odometry'].values()]
    segments = [(figure['segments'], figure) for _, figure in figures]
    poses = [(result['ape_poses'], figure) for result, figure in figures]
    pairs = [(result['rpe_pairs'], figure) for result, figure in figures]
    return {
        't_err_percent': _mean((count, errors['t_err_percent']) for count, errors in segments),
        'r_err_deg_per_m': _mean((count, errors['r_err_deg_per_m']) for count, errors in segments),
        'segments': sum(count for count, _ in segments),
        'ape_m': _root_mean_square((count, errors['ape_m']) for count, errors in poses),
        'rpe_m': _root_mean_square((count, errors['rpe_m']) for count, errors in pairs),
    }


def _mean(weighted: Iterable[tuple[int, float | None]]) -> float | None:
    counted = [(count, value) for count, value in weighted if count and value is not None]
    total = sum(count for count, _ in counted)
    return sum(count * value for count, value in counted) / total if total else None


def _root_mean_square(weighted: Iterable[tuple[int, float | None]]) -> float | None:
    squares = ((count, None if value is None else value * value) for count, value in weighted)
    mean = _mean(squares)
    return None if mean is None else math.sqrt(mean)


def combined_tracking(results: Sequence[Values]) -> dict[str, Figures]:
    """Return the figures of several sequences together by class, as TrackEval combines them.

    Args:
        results: The JSON of each: parts as plain_parts returns them.

    Raises:
        ImportError: TrackEval is not installed.
    """
    sequences = {
        f'{index}/{name}': part
        for index, result in enumerate(results)
        for name, part in result['parts'].items()
    }
    return combine_parts(sequences) if sequences else {}
