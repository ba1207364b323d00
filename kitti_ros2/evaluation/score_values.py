# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores as plain values, for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from ..files.json_text import losses_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .detection import DetectionScores
    from .odometry import OdometryScores
    from .tracking import TrackingScores
    from .worst import WorstFrame


def detection_values(scores: DetectionScores) -> dict[str, object]:
    """Return the scores of detections: percent, and the worst frames if requested."""
    worst = {} if scores.worst is None else {'worst': _worst(scores.worst)}
    return {**scores.percent(), **worst}


def _worst(worst: Sequence[WorstFrame]) -> list[dict[str, object]]:
    return [{**asdict(each), 'penalty': round(each.penalty, 4)} for each in worst]


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
