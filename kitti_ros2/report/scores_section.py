# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The values of the section of a detector's scores; None without results."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.difficulty import Difficulty
from ..model.text import format_count
from .contents import NUMBER, TEXT, Table
from .plots import curves_plot

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..evaluation.detection import DetectionScores
    from ..evaluation.object_benchmark import Curve
    from .contents import Report

_ROWS = {'2d': '2D', 'aos': 'Orientation', 'bev': "Bird's-eye view", '3d': '3D'}
_PLOTTED = '3d'
_NONE = '\N{EN DASH}'


def scores_section(report: Report) -> dict[str, object] | None:
    """Return the values of the section of scores."""
    scores = report.scores
    if scores is None:
        return None
    words = (
        f'Average precision by the rules of the object benchmark over'
        f' {format_count(scores.frames, "frame")}, percent: at 40 values of recall, and at 11 in'
        f' brackets.'
    )
    plots = {name: _plot(name, each[_PLOTTED]) for name, each in scores.scores.items()}
    return {
        'words': words,
        'tables': [_scores_table(class_name, scores) for class_name in scores.scores],
        'plots': [(class_name, plot) for class_name, plot in plots.items() if plot],
    }


def _scores_table(class_name: str, scores: DetectionScores) -> Table:
    columns = [('Metric', TEXT), *((level.value, NUMBER) for level in Difficulty)]
    rows = [
        [title, *(_figure(scores.scores[class_name][name][level]) for level in Difficulty)]
        for name, title in _ROWS.items()
    ]
    return Table(f'{class_name}, IoU above {scores.limits[class_name]:g}', columns, rows)


def _figure(curve: Curve | None) -> str:
    if curve is None or not curve.objects:
        return _NONE
    return f'{curve.r40:.2f} ({curve.r11:.2f})'


def _plot(class_name: str, curves: Mapping[Difficulty, Curve | None]) -> str:
    """Draw the curves of a class; empty without any."""
    known = {
        level.value: 100 * curve.values
        for level, curve in curves.items()
        if curve is not None and curve.objects
    }
    if not known:
        return ''
    recall = np.linspace(0, 100, len(next(iter(known.values()))))
    key = ''.join(each if each.isalnum() else '-' for each in class_name)
    return curves_plot(f'curves-{key}', f'Precision of {class_name} in 3D', recall, known)
