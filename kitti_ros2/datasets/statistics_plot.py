# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Draws statistics as a picture, several sets side by side."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from ..drawing.labelled_objects import (
    BESIDE,
    INK,
    OTHER_COLOR,
    SEMANTIC_COLORS,
    SEMANTIC_NAMES,
    plot_file,
    rgb_of,
)
from ..model.boxes import DONT_CARE, OCCLUSIONS
from ..model.errors import format_count
from .recording_statistics import DIFFICULTIES, TRUNCATIONS, RouteStatistics, merged

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .recording_statistics import Distribution, ObjectStatistics, RecordingStatistics
    from .set_statistics import SetStatistics


# The panels of a picture of statistics. Axes are those of matplotlib.

if TYPE_CHECKING:
    Draw = Callable[[Any, RecordingStatistics, Sequence[str]], None]
    """Draws into axes the statistics of a set, with the classes in this order."""

_PLAIN = '#5b7c99'
_GREY = '#9a9a9a'
_STRENGTHS = (1.0, 0.62, 0.34, 0.14, 0.06)
_MOST_LINES = 5
_ROWS_POINTS = 130
"""Height of the rows of a panel, in points of 1/72 inch."""
_SEMANTIC = {name: SEMANTIC_COLORS[number] for number, name in SEMANTIC_NAMES.items()}


@dataclass(frozen=True)
class Panel:
    """A kind of plot.

    Attributes:
        title: Heading.
        has: Returns True for a set with data for it.
        draw: Draws a set into axes.
        label: Label of the horizontal axis.
        by_class: True if its rows are classes.
        common: True gives several sets the same horizontal scale.
    """

    title: str
    has: Callable[[RecordingStatistics], bool]
    draw: Draw
    label: str
    by_class: bool = False
    common: bool = True


def _color(class_name: str, strength: float = 1.0) -> tuple[float, ...]:
    """Return the colour of a class mixed with white: red, green, blue, 0..1."""
    return tuple(1 - strength * (1 - value / 255) for value in rgb_of(class_name))


def _solid(total: RecordingStatistics, classes: Sequence[str]) -> list[str]:
    """Return the classes of a set in the given order, without DontCare."""
    return [name for name in classes if name in total.classes and name != DONT_CARE]


def _route(total: RecordingStatistics) -> RouteStatistics:
    return total.route or RouteStatistics()


def _any(get: Callable[[ObjectStatistics], int]) -> Callable[[RecordingStatistics], bool]:
    return lambda total: any(
        get(objects) for name, objects in total.classes.items() if name != DONT_CARE
    )


def _rows(axes: Any, classes: Sequence[str]) -> None:  # noqa: ANN401 - axes of matplotlib
    """Name the rows of horizontal bars, the first at the top."""
    axes.set_yticks(range(len(classes)), classes, size=min(7.5, _ROWS_POINTS / (len(classes) + 1)))
    axes.set_ylim(len(classes) - 0.4, -0.6)
    axes.tick_params(axis='y', length=0)


def _draw_counts(axes: Any, total: RecordingStatistics, classes: Sequence[str]) -> None:  # noqa: ANN401
    _rows(axes, classes)
    for row, name in enumerate(classes):
        count = total.classes[name].count if name in total.classes else 0
        axes.barh(row, count, 0.72, color=_GREY if name == DONT_CARE else _color(name))
        axes.annotate(
            f'{count:,}', (count, row), (3, 0), textcoords='offset points', va='center', color=INK
        )
    axes.margins(x=0.22)


def _stacked(get: Callable[[ObjectStatistics], Any], names: Sequence[str]) -> Draw:
    """Return a function that draws the shares of counts as stacked bars."""

    def draw(axes: Any, total: RecordingStatistics, classes: Sequence[str]) -> None:  # noqa: ANN401
        from matplotlib.patches import Patch  # noqa: PLC0415 - heavy

        class_names = [name for name in classes if name != DONT_CARE]
        _rows(axes, class_names)
        for row, class_name in enumerate(class_names):
            counts = get(total.classes[class_name]) if class_name in total.classes else {}
            every, start = sum(counts.values()), 0.0
            for name, strength in zip(names, _STRENGTHS, strict=False):
                share = 100 * counts[name] / every if every else 0.0
                color = _color(class_name, strength)
                axes.barh(row, share, 0.72, start, color=color, edgecolor='white', lw=0.4)
                start += share
        handles = [Patch(facecolor=INK, alpha=s) for _, s in zip(names, _STRENGTHS, strict=False)]
        axes.legend(handles, [_short_name(name) for name in names], **BESIDE)
        axes.set_xlim(0, 100)

    return draw


def _lines(get: Callable[[ObjectStatistics], Distribution], *, even: bool) -> Draw:
    """Return a function that draws distributions of the largest classes, in per cent.

    Args:
        get: Returns the distribution of a class.
        even: True scales the horizontal axis by the values; else all bins have one width.
    """

    def draw(axes: Any, total: RecordingStatistics, classes: Sequence[str]) -> None:  # noqa: ANN401
        names = [name for name in _solid(total, classes) if get(total.classes[name]).count]
        for name in names[:_MOST_LINES]:
            values = get(total.classes[name])
            edges = [*values.edges, 2 * values.edges[-1] - values.edges[-2]]
            if not even:
                edges = [*range(len(values.edges) + 1)]
                axes.set_xticks(edges[:-1], [_short(edge) for edge in values.edges], size=6.5)
            shares = [100 * count / values.count for count in values.counts]
            axes.stairs(shares, edges, color=_color(name), lw=1.4, label=name)
            axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(bottom=0)
        axes.set_ylabel('% of the class')
        title = f'{_MOST_LINES} of {len(names)} classes' if len(names) > _MOST_LINES else None
        axes.legend(title=title, **BESIDE)

    return draw


def _short_name(name: str) -> str:
    return name.removesuffix(' occluded').replace('to ', '≤').replace('over ', '>')


def _short(edge: float) -> str:
    return f'{edge:g}' if edge < 1000 else f'{edge / 1000:g}k'


def _bars(get: Callable[[RecordingStatistics], Distribution], noun: str) -> Draw:
    """Return a function that draws a distribution of the whole set, with its mean."""

    def draw(axes: Any, total: RecordingStatistics, _: Sequence[str]) -> None:  # noqa: ANN401
        values = get(total)
        used = max(index for index, count in enumerate(values.counts) if count) + 1
        edges = [*values.edges, 2 * values.edges[-1] - values.edges[-2]][: used + 1]
        shares = [100 * count / values.count for count in values.counts[:used]]
        axes.stairs(shares, edges, fill=True, color=_PLAIN)
        axes.axvline(values.mean, color=INK, lw=0.9, ls=(0, (4, 3)))
        axes.annotate(
            f'mean {values.mean:.1f}',
            (values.mean, 1),
            (0, 2),
            xycoords=('data', 'axes fraction'),
            textcoords='offset points',
            ha='center',
            color=INK,
        )
        axes.set_xlim(edges[0], edges[-1])
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_ylabel(f'% of {noun}')

    return draw


def _draw_sizes(axes: Any, total: RecordingStatistics, classes: Sequence[str]) -> None:  # noqa: ANN401
    class_names = [name for name in classes if name != DONT_CARE]
    _rows(axes, class_names)
    for row, class_name in enumerate(class_names):
        if class_name not in total.classes or not total.classes[class_name].length_m.count:
            continue
        objects = total.classes[class_name]
        for index, (size, mark) in enumerate(
            ((objects.length_m, 'o'), (objects.width_m, 's'), (objects.height_m, '^'))
        ):
            axes.errorbar(
                size.mean,
                row + 0.22 * (index - 1),
                xerr=size.deviation,
                fmt=mark,
                ms=3.6,
                lw=1.1,
                color=_color(class_name),
            )
    for name, mark in (('length', 'o'), ('width', 's'), ('height', '^')):
        axes.plot([], [], mark, color=INK, ms=3.6, label=name)
    axes.legend(**BESIDE)
    axes.set_xlim(left=0)


def _draw_point_classes(axes: Any, total: RecordingStatistics, _: Sequence[str]) -> None:  # noqa: ANN401
    every = sum(total.point_classes.values())
    _rows(axes, [*total.point_classes])
    for row, (name, count) in enumerate(total.point_classes.items()):
        color = _SEMANTIC.get(name, OTHER_COLOR) or OTHER_COLOR
        axes.barh(row, 100 * count / every, 0.72, color=f'#{color:06x}')


def _shares_panel(title: str, names: Sequence[str]) -> Panel:
    get = attrgetter(title.lower())
    has_shares = _any(lambda statistics: get(statistics).total())
    return Panel(title, has_shares, _stacked(get, names), '% of the class', by_class=True)


PANELS = (
    Panel(
        'Labels',
        lambda total: bool(total.classes),
        _draw_counts,
        'labels',
        by_class=True,
        common=False,
    ),
    _shares_panel('Difficulty', DIFFICULTIES),
    _shares_panel('Occlusion', OCCLUSIONS),
    _shares_panel('Truncation', TRUNCATIONS),
    Panel(
        '3D boxes, mean ± deviation',
        _any(lambda objects: objects.length_m.count),
        _draw_sizes,
        'metres',
        by_class=True,
    ),
    Panel(
        'Distance',
        _any(lambda objects: objects.distance_m.count),
        _lines(lambda objects: objects.distance_m, even=True),
        'metres; the last bin is open',
    ),
    Panel(
        'Points in a 3D box',
        _any(lambda objects: objects.points.count),
        _lines(lambda objects: objects.points, even=False),
        'points, from',
    ),
    Panel(
        'Length of a track',
        _any(lambda objects: objects.tracks.count),
        _lines(lambda objects: objects.tracks, even=False),
        'frames, from',
    ),
    Panel(
        'Objects in a frame',
        lambda total: bool(total.objects),
        _bars(lambda total: total.objects_a_frame, 'labelled frames'),
        'objects',
    ),
    Panel(
        'Speed',
        lambda total: bool(_route(total).speed_m_s.count),
        _bars(lambda total: _route(total).speed_m_s, 'poses'),
        'm/s',
    ),
    Panel(
        'Turn rate',
        lambda total: bool(_route(total).turn_rate_deg_s.count),
        _bars(lambda total: _route(total).turn_rate_deg_s, 'poses'),
        'deg/s',
    ),
    Panel(
        'Points by class',
        lambda total: bool(total.point_classes),
        _draw_point_classes,
        '% of the points',
        by_class=True,
    ),
)


_COLUMNS = (3, 4)
"""Possible numbers of columns for a single set; the one with fewer gaps is chosen."""
_PANEL_INCHES = (3.7, 2.5)
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
    totals = [statistics.total for statistics in sets]
    panels = [panel for panel in PANELS if any(panel.has(total) for total in totals)]
    columns = len(sets) if len(sets) > 1 else _columns(len(panels))
    rows = max(len(panels) if len(sets) > 1 else -(-len(panels) // columns), 1)
    width, height = _PANEL_INCHES
    with plot_file(path, (width * columns, height * rows + 0.4), h_pad=0.08) as figure:
        if len(sets) > 1:
            grid = figure.subplots(rows, columns, squeeze=False)
            _draw_side_by_side(grid, panels, totals, titles)
        else:
            figure.suptitle(_heading(titles[0], totals[0]), **_TITLE)
            all_axes = _full_rows(figure, len(panels), columns)
            _draw_panels(all_axes, panels, totals * len(panels), totals)


def _columns(panels: int) -> int:
    """Return the number of columns for the panels of a single set."""
    if panels <= min(_COLUMNS):
        return max(panels, 1)
    return min(_COLUMNS, key=lambda columns: -panels % columns)


def _full_rows(figure: Figure, count: int, columns: int) -> Iterator[Axes]:
    """Yield axes in rows of at most so many columns, each as wide as the figure."""
    rows = max(-(-count // columns), 1)
    in_rows = [count // rows + (row < count % rows) for row in range(rows)]
    cells = math.lcm(*in_rows) or 1
    grid = figure.add_gridspec(rows, cells)
    for row, in_row in enumerate(in_rows):
        for start in range(0, cells, cells // in_row) if in_row else ():
            yield figure.add_subplot(grid[row, start : start + cells // in_row])


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
        style = {'xycoords': 'axes fraction', 'textcoords': 'offset points', 'ha': 'center'}
        axes.annotate(title, (0.5, 1), (0, 36), **style, **_TITLE)
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
    all_axes: Iterable[Any],
    panels: Sequence[Panel],
    shown: Sequence[RecordingStatistics],
    totals: Sequence[RecordingStatistics],
) -> None:
    """Draw panels, each of the statistics of a set; one without data says so.

    Args:
        all_axes: Axes, possibly more than panels.
        panels: The panels.
        shown: The statistics of each panel.
        totals: Statistics of all sets, for the order of classes.
    """
    classes = [*merged(totals).classes]
    for axes, panel, total in itertools.zip_longest(all_axes, panels, shown):
        if panel is None:
            axes.set_axis_off()
            continue
        axes.set_title(panel.title, loc='left', pad=16)
        if not panel.has(total):
            axes.set_axis_off()
            axes.text(0, 1, 'none in this set', va='top')
            continue
        panel.draw(axes, total, classes)
        axes.set_xlabel(panel.label)
        if panel.by_class:
            axes.grid(visible=False, axis='y')
