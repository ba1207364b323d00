# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws statistics as a picture, a column for each of several sets."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from ..drawing.plot_style import plot_file
from ..model.text import format_count
from .recording_statistics import merged
from .statistics_panels import PANELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from .recording_statistics import RecordingStatistics
    from .set_statistics import SetStatistics
    from .statistics_panels import Panel

_COLUMNS = (3, 4)
"""Of the panels of a single set: the number that leaves fewer places empty."""
_PANEL_INCHES = (3.3, 2.5)
_TITLE: dict[str, Any] = {'size': 11, 'weight': 'bold'}


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
    totals = [each.total for each in sets]
    panels = [panel for panel in PANELS if any(panel.has(total) for total in totals)]
    columns = len(sets) if len(sets) > 1 else _columns(len(panels))
    rows = max(len(panels) if len(sets) > 1 else -(-len(panels) // columns), 1)
    width, height = _PANEL_INCHES
    with plot_file(path, (width * columns, height * rows + 0.4), h_pad=0.08) as figure:
        grid = figure.subplots(rows, columns, squeeze=False)
        if len(sets) > 1:
            _draw_side_by_side(grid, panels, totals, titles)
        else:
            figure.suptitle(_heading(titles[0], totals[0]), **_TITLE)
            _draw_panels(grid.flat, panels, totals * len(panels), totals)


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


def _draw_side_by_side(
    grid: Any,  # noqa: ANN401 - rows of axes of matplotlib
    panels: Sequence[Panel],
    totals: Sequence[RecordingStatistics],
    titles: Sequence[str],
) -> None:
    """Draw a row for each panel and a column for each set."""
    for axes, title in zip(grid[0], titles, strict=True):
        place = {'xycoords': 'axes fraction', 'textcoords': 'offset points', 'ha': 'center'}
        axes.annotate(title, (0.5, 1), (0, 36), **place, **_TITLE)
    for row, panel in itertools.zip_longest(grid, panels):
        _draw_panels(row, [panel] * len(row) if panel else [], totals, totals)
        if panel is not None:
            drawn = [axes for axes, total in zip(row, totals, strict=True) if panel.has(total)]
            _share_scales(drawn, panel)


def _share_scales(drawn: Sequence[Any], panel: Panel) -> None:
    """Give the panels of several sets the same scales."""
    for limits in ['xlim'] * panel.common + ['ylim'] * (not panel.by_class):
        values = [getattr(axes, f'get_{limits}')() for axes in drawn]
        low, high = min(pair[0] for pair in values), max(pair[1] for pair in values)
        for axes in drawn:
            getattr(axes, f'set_{limits}')(low, high)


def _draw_panels(
    places: Iterable[Any],
    panels: Sequence[Panel],
    shown: Sequence[RecordingStatistics],
    totals: Sequence[RecordingStatistics],
) -> None:
    """Draw panels into axes, each of the statistics of a set, and hide axes without data.

    Args:
        places: Axes; there may be more of them than panels.
        panels: The panels.
        shown: The statistics that each panel shows.
        totals: Those of all sets, for the order of classes.
    """
    classes = [*merged(totals).classes]
    for axes, panel, total in itertools.zip_longest(places, panels, shown):
        if panel is None or not panel.has(total):
            axes.set_axis_off()
            continue
        panel.draw(axes, total, classes)
        axes.set_title(panel.title, loc='left', pad=16)
        axes.set_xlabel(panel.label)
        if panel.by_class:
            axes.grid(visible=False, axis='y')
