# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the curves of precision and orientation similarity over recall."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.plot_style import plot_file
from ..model.difficulty import Difficulty
from ..model.text import format_count
from .object_benchmark import SAMPLES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from .detection import DetectionScores
    from .object_benchmark import Curve

_PANEL_INCHES = (2.9, 2.3)
_TITLES = {'2d': '2D', 'aos': 'orientation', 'bev': "bird's-eye view", '3d': '3D'}
_LOOKS = {
    Difficulty.EASY: ('#2a9d5c', (0, ())),
    Difficulty.MODERATE: ('#e0861a', (0, (5, 1.5))),
    Difficulty.HARD: ('#c03a4b', (0, (2, 1.2))),
}


def draw_curves(scores: DetectionScores, title: str, path: Path) -> None:
    """Draw a row of panels for each class, with a curve for each level of difficulty.

    Args:
        scores: The scores.
        title: The heading.
        path: The picture: .png, .pdf or .svg.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    width, height = _PANEL_INCHES
    rows = len(scores.scores)
    with plot_file(path, (width * len(_TITLES), height * rows + 0.4)) as figure:
        grid = figure.subplots(rows, len(_TITLES), squeeze=False, sharex=True, sharey=True)
        heading = f'{title}, {format_count(scores.frames, "frame")}'
        figure.suptitle(heading, size=11, weight='bold')
        for row, (class_name, metrics) in zip(grid, scores.scores.items(), strict=True):
            row[0].set_ylabel('precision, %')
            for axes, (metric, name) in zip(row, _TITLES.items(), strict=True):
                axes.set_title(f'{class_name}, {name}', loc='left')
                _draw(axes, metrics[metric])
        for axes in grid[-1]:
            axes.set_xlabel('recall, %')


def _draw(axes: Any, curves: Mapping[Difficulty, Curve | None]) -> None:  # noqa: ANN401 - of matplotlib
    """Draw the curves of a class in one metric, with their averages."""
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 103)
    recall = 100 * np.arange(SAMPLES) / (SAMPLES - 1)
    for level, curve in curves.items():
        if curve is not None and curve.objects:
            color, dashes = _LOOKS[level]
            label = f'{level.value} {curve.r40:.2f}'
            axes.plot(recall, 100 * curve.values, color=color, ls=dashes, lw=1.4, label=label)
    if axes.lines:
        axes.legend(loc='best', title='R40', title_fontsize=7, alignment='left')
    else:
        axes.text(50, 50, 'no objects, or not evaluated', ha='center', va='center')
