# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a scored trajectory: the paths from above, and the errors.

Axes are those of matplotlib.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.plot_style import INK, plot_file
from .segment_errors import LENGTHS_M

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from ..model.geometry import Float64Array
    from .odometry import OdometryScores
    from .segment_errors import SegmentErrors

_INCHES = (10.0, 6.6)
_RESULT = '#c8502b'
_PLACES = (('path', 't'), ('path', 'r'), ('ape', 'ape'))
_SPEEDS_M_S = np.arange(2, 25, 2)
_SPEED_RANGE_M_S = 2.0
_LEAST = 3
"""Means are of the segments within 2 m/s of a speed, and of 3 segments at least, as in
saveErrorPlots of evaluate_odometry.cpp."""


def draw_odometry(scores: OdometryScores, path: Path) -> None:
    """Draw the paths from above, KITTI's errors by length and speed, and APE along the path.

    Args:
        scores: The scores.
        path: The picture: .png, .pdf or .svg.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    with plot_file(path, _INCHES) as figure:
        axes = figure.subplot_mosaic([*map(list, _PLACES)], height_ratios=(1, 1, 0.6))
        figure.suptitle(_heading(scores), size=11, weight='bold')
        _draw_paths(axes['path'], scores)
        _draw_means(axes['t'], scores.segments, 'translation, %', lambda part: part.t_err_percent)
        _draw_means(
            axes['r'], scores.segments, 'rotation, deg/m', lambda part: part.r_err_deg_per_m
        )
        _draw_ape(axes['ape'], scores)


def _heading(scores: OdometryScores) -> str:
    parts = [f'{scores.name}, {scores.distances_m[-1]:,.0f} m']
    if scores.t_err_percent is not None and scores.r_err_deg_per_m is not None:
        parts.append(f'{scores.t_err_percent:.2f} %')
        parts.append(f'{scores.r_err_deg_per_m:.4f} deg/m')
    if scores.ape_m is not None:
        parts.append(f'APE {scores.ape_m:.2f} m')
    if scores.alignment.has_scale:
        parts.append(f'scale {scores.errors.scale:.6g}')
    return ', '.join(parts)


def _at_frames(scores: OdometryScores, values: Float64Array) -> Float64Array:
    """Return values of the frames with a result at all frames, NaN between them."""
    found = np.full((len(scores.known), *values.shape[1:]), np.nan)
    found[scores.known] = values
    return found


def _draw_paths(axes: Any, scores: OdometryScores) -> None:  # noqa: ANN401
    """Draw both paths from above: x of camera 0 to the right, z up."""
    axes.plot(*scores.positions[:, [0, 2]].T, color=INK, linewidth=1.4, label='ground truth')
    aligned = _at_frames(scores, scores.errors.positions)
    aligned_as = f'result (align {scores.alignment.value})'
    axes.plot(*aligned[:, [0, 2]].T, color=_RESULT, linewidth=1.0, label=aligned_as)
    axes.plot(*scores.positions[0, [0, 2]], 'o', color=INK, markersize=4, label='start')
    missing = scores.positions[~scores.known]
    if len(missing):
        axes.plot(*missing[:, [0, 2]].T, '.', color='#9a9a9a', markersize=3, label='no result')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set_xlabel('x, m')
    axes.set_ylabel('z, m')
    axes.legend(loc='best')


def _draw_means(
    axes: Any,  # noqa: ANN401 - as above
    segments: SegmentErrors,
    title: str,
    mean: Callable[[SegmentErrors], float | None],
) -> None:
    """Draw a mean error by length of the segments, and by speed on a second axis."""
    axes.set_title(title, loc='left')
    axes.set_xlabel('length of the segments, m')
    if not len(segments):
        axes.text(0.5, 0.5, 'no segment', ha='center', transform=axes.transAxes)
        return
    by_length = [segments.of_length(length) for length in LENGTHS_M]
    near = (np.abs(segments.speeds_m_s - speed) < _SPEED_RANGE_M_S for speed in _SPEEDS_M_S)
    by_speed = [segments.chosen(kept) for kept in near]
    means, means_by_speed = (
        [np.nan if len(part) < _LEAST else mean(part) for part in parts]
        for parts in (by_length, by_speed)
    )
    axes.plot(LENGTHS_M, means, 'o-', color=_RESULT, markersize=3, label='by length')
    speeds = axes.twiny()
    speeds.plot(_SPEEDS_M_S, means_by_speed, 's--', color=INK, markersize=3, linewidth=0.8)
    axes.plot([], [], 's--', color=INK, markersize=3, linewidth=0.8, label='by speed')
    speeds.set_xlabel('speed, m/s', loc='right')
    speeds.grid(visible=False)
    speeds.spines['top'].set_visible(True)
    axes.set_ylim(bottom=0)
    axes.legend(loc='lower right')


def _draw_ape(axes: Any, scores: OdometryScores) -> None:  # noqa: ANN401 - as above
    errors = _at_frames(scores, scores.errors.ape_m)
    axes.plot(scores.distances_m, errors, color=_RESULT, linewidth=1.0)
    axes.set_title('APE, m', loc='left')
    axes.set_xlabel('distance along the ground truth, m')
    axes.set_ylim(bottom=0)
    axes.margins(x=0.01)
