# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws statistics as a picture, a column for each of several sets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..model.text import format_count
from .statistics_panels import INK, PANELS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from .recording_statistics import RecordingStatistics
    from .set_statistics import SetStatistics
    from .statistics_panels import Panel

_COLUMNS = (3, 4)
"""Of the panels of a single set: the number that leaves fewer places empty."""
_PANEL_INCHES = (3.3, 2.5)
_DPI = 200
_STYLE: dict[str, Any] = {
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
    'xtick.color': INK,
    'ytick.color': INK,
}


def draw_statistics(sets: Sequence[SetStatistics], titles: Sequence[str], path: Path) -> None:
    """Draw the statistics of sets; one set has its panels in a grid.

    Args:
        sets: The sets.
        titles: Their names.
        path: The picture: .png, .pdf or .svg.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415 - heavy, and an extra
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above

    totals = [each.total for each in sets]
    panels = [panel for panel in PANELS if any(panel.has(total) for total in totals)]
    several = len(sets) > 1
    columns = len(sets) if several else _columns(len(panels))
    rows = len(panels) if several else -(-len(panels) // columns)
    width, height = _PANEL_INCHES
    with rc_context(_STYLE):
        figure = Figure((width * columns, height * max(rows, 1) + 0.4), layout='constrained')
        figure.get_layout_engine().set(w_pad=0.06, h_pad=0.08, hspace=0.02, wspace=0.02)
        grid = figure.subplots(max(rows, 1), columns, squeeze=False)
        if several:
            for row, panel in enumerate(panels):
                _draw_row(grid[row], panel, totals)
            for axes, title in zip(grid[0], titles, strict=True):
                axes.annotate(
                    title,
                    (0.5, 1.22),
                    xycoords='axes fraction',
                    ha='center',
                    size=11,
                    weight='bold',
                )
        else:
            figure.suptitle(_heading(titles[0], totals[0]), size=11, weight='bold')
            for axes, panel in zip(grid.flat, panels, strict=False):
                _draw_panel(axes, panel, totals[0], totals)
            for axes in grid.flat[len(panels) :]:
                axes.set_axis_off()
        figure.savefig(path, dpi=_DPI, format=path.suffix[1:].lower())


def _columns(panels: int) -> int:
    """Return the number of columns for the panels of a single set."""
    if panels <= min(_COLUMNS):
        return max(panels, 1)
    return min(_COLUMNS, key=lambda columns: -panels % columns)


def _heading(title: str, total: RecordingStatistics) -> str:
    parts = [title, format_count(total.frames, 'frame')]
    if total.objects:
        parts.append(format_count(total.objects, 'object'))
    if total.route is not None:
        parts.append(f'{total.route.length_m:,.0f} m')
    return ', '.join(parts)


def _draw_row(row: Sequence[Any], panel: Panel, totals: Sequence[RecordingStatistics]) -> None:
    """Draw a panel of each set, with the same scales."""
    for axes, total in zip(row, totals, strict=True):
        _draw_panel(axes, panel, total, totals)
    drawn = [axes for axes, total in zip(row, totals, strict=True) if panel.has(total)]
    for limits in ('xlim', 'ylim'):
        if limits == 'ylim' and panel.by_class:
            continue
        if limits == 'xlim' and panel.title == 'Labels':
            continue
        values = [getattr(axes, f'get_{limits}')() for axes in drawn]
        low, high = min(pair[0] for pair in values), max(pair[1] for pair in values)
        for axes in drawn:
            getattr(axes, f'set_{limits}')(low, high)


def _draw_panel(
    axes: Any,  # noqa: ANN401 - of matplotlib
    panel: Panel,
    total: RecordingStatistics,
    totals: Sequence[RecordingStatistics],
) -> None:
    if not panel.has(total):
        axes.set_axis_off()
        return
    panel.draw(axes, total, _order(totals))
    axes.set_title(panel.title, loc='left', pad=16)
    axes.set_xlabel(panel.label)
    if panel.by_class:
        axes.grid(visible=False, axis='y')


def _order(totals: Sequence[RecordingStatistics]) -> list[str]:
    """Return all classes, the most frequent first."""
    counts: dict[str, int] = {}
    for total in totals:
        for name, each in total.classes.items():
            counts[name] = counts.get(name, 0) + each.count
    return sorted(counts, key=lambda name: (-counts[name], name))
