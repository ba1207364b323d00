# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The style of plots, for matplotlib's rc_context."""

from __future__ import annotations

from typing import Any

INK = '#30343b'
PLOT_STYLE: dict[str, Any] = {
    'axes.axisbelow': True,
    'axes.edgecolor': INK,
    'axes.grid': True,
    'axes.labelcolor': INK,
    'axes.linewidth': 0.6,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlesize': 9,
    'axes.titleweight': 'bold',
    'font.size': 7.5,
    'grid.color': '#e4e6ea',
    'grid.linewidth': 0.6,
    'legend.frameon': False,
    'legend.fontsize': 7,
    'svg.hashsalt': 'kitti_ros2',
    'text.color': INK,
    'text.parse_math': False,  # names of classes may hold any characters
    'xtick.color': INK,
    'ytick.color': INK,
}
