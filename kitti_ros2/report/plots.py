# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of the report, as inline SVG: streams, labels, sensors, the route."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.labelled_objects import rgb_of
from ..model.geometry import Transform, rotation_from_rpy

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from ..model.geometry import Float64Array
    from .contents import Timing
    from .overview import LinkSummary


# The parts of plots: inline SVG with text alternatives; colours come from the page.
#
# Each plot is drawn 400 units wide and shown between 300 and 560 pixels wide, so its text stays
# legible on a phone.

WIDTH = 400


def figure(key: str, title: str, description: str, size: tuple[int, int], *drawn: str) -> str:
    """Make an SVG with a text alternative for screen readers.

    Args:
        key: Unique in the page; its ids are made from it.
        title: Its name.
        description: Text alternative.
        size: Width and height in its own units.
        drawn: Its elements.
    """
    return (
        f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img"'
        f' aria-labelledby="{key}-title {key}-desc" class="plot">'
        f'<title id="{key}-title">{escape(title)}</title>'
        f'<desc id="{key}-desc">{escape(description)}</desc>{"".join(drawn)}</svg>'
    )


def bar(height: int, class_: str, drawn: Sequence[str]) -> str:
    """Make an SVG 100 units wide, stretched to fit; the text beside it is its alternative."""
    return (
        f'<svg viewBox="0 0 100 {height}" preserveAspectRatio="none" class="{class_}"'
        f' aria-hidden="true" focusable="false">{"".join(drawn)}</svg>'
    )


def text(x: float, y: float, words: str, anchor: str = 'start', class_: str = '') -> str:
    """Draw text; anchor is start, middle or end."""
    css_class = class_ and f' class="{class_}"'
    position = f'x="{number(x)}" y="{number(y)}" text-anchor="{anchor}"'
    return f'<text {position}{css_class}>{escape(words)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, class_: str) -> str:
    """Draw a straight line."""
    ends = f'x1="{number(x1)}" y1="{number(y1)}" x2="{number(x2)}" y2="{number(y2)}"'
    return f'<line {ends} class="{class_}"></line>'


def box(x: float, y: float, width: float, height: float, class_: str, fill: str = '') -> str:
    """Draw a filled rectangle; its colour is that of the class, or else fill."""
    size = f'width="{number(width)}" height="{number(height)}"'
    colour = fill and f' fill="{fill}"'
    return f'<rect x="{number(x)}" y="{number(y)}" {size} class="{class_}"{colour}></rect>'


def path(d: str, class_: str) -> str:
    """Draw a path."""
    return f'<path d="{d}" class="{class_}"></path>'


def circle(x: float, y: float, radius: float, class_: str) -> str:
    """Draw a circle."""
    return f'<circle cx="{number(x)}" cy="{number(y)}" r="{radius}" class="{class_}"></circle>'


def number(value: float) -> str:
    """Format a coordinate: two decimals at most, and no negative zero."""
    written = f'{value:.2f}'.rstrip('0').rstrip('.')
    return '0' if written == '-0' else written


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return round values (1, 2 or 5 times a power of ten apart) from low to high.

    Args:
        low: Least value.
        high: Greatest value.
        most: Maximum number of values.
    """
    span = max(high - low, 1e-9)
    rough = span / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [step * multiple for multiple in range(first, last + 1)]


def plain(value: float) -> str:
    """Format a tick's value without needless digits."""
    return f'{value:.6g}'


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= length * 1.001)


def scale_bar(scale: float, height: float) -> str:
    """Draw a scale bar of a round length in the lower left corner.

    Args:
        scale: Units per metre.
        height: Height of the plot.
    """
    length = round_length(110 / scale)
    y = height - 8
    bracket = path(f'M10 {number(y - 5)}v5h{number(length * scale)}v-5', 'scale')
    words = text(10 + length * scale + 6, y + 1, f'{plain(length)} m', class_='label')
    return f'<g>{bracket}{words}</g>'


# Plots of streams and of labels.

_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 10, 14, 30
_INTERVAL_HEIGHT = 150
_HISTOGRAM_HEIGHT = 130
_COURSE_HEIGHT = 112
_COLUMNS = 172
_STRIP_BINS = 200
_STRIP_TICK = 0.5
"""Width of one sample in a strip of 100."""

_UNITS = (('s', 1e9), ('ms', 1e6), ('\N{MICRO SIGN}s', 1e3), ('ns', 1.0))
_LARGE_NS = 1e10
_DIGIT = 7.5
"""Width of a digit of a tick, at most."""

_MOST_BANDS = 200
_LEAST_MARGIN = 0.05
"""Margin above and below the values of a line."""


def strip(timing: Timing, start_ns: int, end_ns: int) -> str:
    """Draw the times of a stream's samples between two times: a bar with its gaps marked."""
    scale = (100 - _STRIP_TICK) / max(end_ns - start_ns, 1)
    period = timing.period_ns or 0
    xs: Float64Array = np.multiply(timing.stamps_ns - start_ns, scale, dtype=np.float64)
    drawn = [
        box(x0, 3, x1 - x0 + _STRIP_TICK, 6, 'bar')
        for x0, x1 in _spans(timing, xs, period if timing.regular else 0)
    ]
    for gap in timing.gaps[:_MOST_BANDS]:
        x0 = (gap.at_ns - start_ns) * scale
        drawn.append(box(x0, 0, max(gap.length_ns * scale, _STRIP_TICK), 12, 'gap'))
    return bar(12, 'strip', drawn)


def _spans(timing: Timing, xs: Float64Array, period: int) -> list[tuple[float, float]]:
    """Return the spans with samples: runs of a regular stream, single samples of others."""
    if period:
        ends = [gap.at_ns for gap in timing.gaps]
        cuts = np.searchsorted(timing.stamps_ns, ends, 'right')
        return [(float(run[0]), float(run[-1])) for run in np.split(xs, cuts) if len(run)]
    step = (100 - _STRIP_TICK) / _STRIP_BINS
    bins = np.unique(np.round(xs / step)) * step
    return [(float(x), float(x)) for x in bins]


def interval_plot(key: str, name: str, timing: Timing) -> str:
    """Draw the distance to the next sample over time; gaps are marked.

    The axis is scaled to the usual distances; values outside are drawn at its edge.
    """
    period_ns = timing.period_ns or 0
    away = np.abs(timing.intervals_ns - period_ns)
    reach_ns = max(float(np.percentile(away, 97)) * 1.25, period_ns * 0.02, 1.0)
    unit, length = _unit(period_ns + reach_ns)
    intervals, period, reach = timing.intervals_ns / length, period_ns / length, reach_ns / length
    times = (timing.stamps_ns[:-1] - timing.stamps_ns[0]) / 1e9
    span = float(times[-1]) or 1.0
    area = _PlotArea((0, span), (max(period - reach, 0.0), period + reach), _INTERVAL_HEIGHT)
    drawn = [
        area.axes('s', unit),
        line(area.left, area.y(period), WIDTH - _RIGHT, area.y(period), 'median'),
        _dots(area, times, np.clip(intervals, *area.vertical)),
        *[
            _gap_mark(area, (gap.at_ns - int(timing.stamps_ns[0])) / 1e9)
            for gap in timing.gaps[:_MOST_BANDS]
        ],
    ]
    return figure(
        key,
        f'Intervals of {name}',
        f'{len(intervals)} distances between neighbouring samples over {span:.1f} seconds. The'
        f' median is {period:.2f} {unit}, the shortest {intervals.min():.2f} {unit}, the longest'
        f' {intervals.max():.2f} {unit}; {len(timing.gaps)} gaps are marked.',
        (WIDTH, _INTERVAL_HEIGHT),
        *drawn,
    )


def format_period(period_ns: int) -> str:
    """Format a period in the unit of its plot, such as 100.00 ms."""
    unit, length = _unit(period_ns)
    return f'{period_ns / length:.2f} {unit}'


def _unit(longest_ns: float) -> tuple[str, float]:
    """Return a unit and its nanoseconds, for few digits of durations up to a longest one."""
    if longest_ns >= _LARGE_NS:
        return _UNITS[0]
    return next((unit for unit in _UNITS[1:] if longest_ns >= unit[1]), _UNITS[-1])


def _gap_mark(area: _PlotArea, at_s: float) -> str:
    """Draw a triangle at the upper edge and a line down from it."""
    x = area.x(at_s)
    down = line(x, _TOP - 2, x, _INTERVAL_HEIGHT - _BOTTOM, 'gap-line')
    return down + path(f'M{number(x)} {_TOP}l-5-9h10z', 'gap')


class _PlotArea:
    """The axes of a plot: the value ranges across and up, and their mapping to the SVG."""

    def __init__(
        self, across: tuple[float, float], vertical: tuple[float, float], height: int
    ) -> None:
        self._across, self.vertical = across, vertical
        self._floor = height - _BOTTOM
        self._levels = [(value, plain(value)) for value in ticks(*vertical, 4)]
        widest = max((len(words) for _, words in self._levels), default=0)
        self.left = max(_LEFT, widest * _DIGIT + 6)

    def x(self, value: float) -> float:
        """Return the x coordinate of a value."""
        low, high = self._across
        return self.left + (WIDTH - self.left - _RIGHT) * (value - low) / (high - low)

    def y(self, value: float) -> float:
        """Return the y coordinate of a value."""
        low, high = self.vertical
        return self._floor - (self._floor - _TOP) * (value - low) / (high - low)

    def axes(self, across: str, up: str) -> str:
        """Draw lines and numbers of both axes, with their units."""
        drawn = [self.level(value, words) for value, words in self._levels]
        drawn += [
            text(_inside(self.x(value), plain(value)), self._floor + 16, plain(value), 'middle')
            for value in ticks(*self._across, 6)
        ]
        drawn += [
            text(self.left + 4, 12, up, class_='unit'),
            text(WIDTH - _RIGHT, self._floor + 27, across, 'end', 'unit'),
        ]
        return ''.join(drawn)

    def level(self, value: float, words: str) -> str:
        """Draw a line across at a value, and its number beside the axis."""
        y = self.y(value)
        across = line(self.left, y, WIDTH - _RIGHT, y, 'grid-line')
        return across + text(self.left - 6, y + 4, words, 'end')


def _inside(x: float, words: str) -> float:
    """Return the centre of a tick's text, moved so that it is not cut off at the edges."""
    half = len(words) * _DIGIT / 2
    return min(max(x, half), WIDTH - half)


def _dots(area: _PlotArea, times: Float64Array, values: Float64Array) -> str:
    """Draw a dot for each value; for very many, the range of each column."""
    if len(values) <= 4 * _COLUMNS:
        marks = (
            f'M{number(area.x(float(x)))} {number(area.y(float(y)))}h0'
            for x, y in zip(times, values, strict=True)
        )
        return path(''.join(marks), 'dots')
    bars = []
    for xs, ys in _columns(times, values):
        x, low, high = area.x(float(xs.mean())), area.y(ys.min()), area.y(ys.max())
        bars.append(f'M{number(x)} {number(low + 0.7)}V{number(high - 0.7)}')
    return path(''.join(bars), 'ranges')


def _columns(
    times: Float64Array, values: Float64Array
) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Yield the times and values in each column of a plot that has any."""
    edges = np.searchsorted(times, np.linspace(0, float(times[-1]), _COLUMNS + 1)[1:-1])
    for xs, ys in zip(np.split(times, edges), np.split(values, edges), strict=True):
        if len(ys):
            yield xs, ys


def course_plot(key: str, title: str, times: Float64Array, values: Float64Array, unit: str) -> str:
    """Draw a line of finite values over times in seconds, both (N,) with N > 1."""
    low, high = float(values.min()), float(values.max())
    margin = max((high - low) * 0.06, _LEAST_MARGIN)
    span = float(times[-1]) or 1.0
    area = _PlotArea((0, span), (low - margin, high + margin), _COURSE_HEIGHT)
    return figure(
        key,
        f'{title} over time',
        f'Over {span:.1f} seconds from {values[0]:.2f} {unit} to {values[-1]:.2f} {unit}, between'
        f' {low:.2f} and {high:.2f} {unit}.',
        (WIDTH, _COURSE_HEIGHT),
        area.axes('s', unit),
        path(_course(area, times, values), 'course'),
    )


def curves_plot(
    key: str, title: str, recall: Float64Array, curves: Mapping[str, Float64Array]
) -> str:
    """Draw curves by name, percent over recall in percent; each has its class of the page."""
    area = _PlotArea((0, 100), (0, 100), _INTERVAL_HEIGHT)
    means = ', '.join(f'{name} {values.mean():.1f}' for name, values in curves.items())
    return figure(
        key,
        title,
        f'Precision over recall, percent; the mean of the samples is {means}.',
        (WIDTH, _INTERVAL_HEIGHT),
        area.axes('recall %', 'precision %'),
        *(path(_course(area, recall, values), f'course {name}') for name, values in curves.items()),
    )


def _course(area: _PlotArea, times: Float64Array, values: Float64Array) -> str:
    """Draw a line through values; of very many, through the least and greatest of each column."""
    if len(values) > 4 * _COLUMNS:
        ends = [
            (xs[index], ys[index])
            for xs, ys in _columns(times, values)
            for index in sorted((int(ys.argmin()), int(ys.argmax())))
        ]
        times, values = np.array(ends).T
    points = zip(times.tolist(), values.tolist(), strict=True)
    return 'M' + 'L'.join(f'{number(area.x(x))} {number(area.y(y))}' for x, y in points)


def class_colour(class_name: str) -> str:
    """Return the colour of a class in the pictures, as CSS."""
    return '#{:02x}{:02x}{:02x}'.format(*rgb_of(class_name))


def histogram_plot(
    key: str, title: str, edges: Sequence[float], counts: Sequence[int], unit: str, colour: str
) -> str:
    """Draw bars over bins of equal width; the last bin contains all from its edge on."""
    width = edges[1] - edges[0]
    most = max(*counts, 1)
    height = _HISTOGRAM_HEIGHT
    area = _PlotArea((edges[0], edges[-1] + width), (0, most * 1.08), height)
    drawn = [
        area.level(value, _short(int(value))) for value in ticks(0, most, 3) if value == int(value)
    ]
    across = area.x(edges[1]) - area.x(edges[0])
    drawn += [
        box(area.x(edge) + 1, area.y(count), across - 2, area.y(0) - area.y(count), 'share', colour)
        for edge, count in zip(edges, counts, strict=True)
        if count
    ]
    low = height - _BOTTOM + 16
    drawn += [text(area.x(edge), low, plain(edge), 'middle') for edge in edges[:-1:2]]
    drawn += [
        text(area.x(edges[-1]) + across / 2, low, f'{plain(edges[-1])}+', 'middle'),
        line(area.left, area.y(0), WIDTH - _RIGHT, area.y(0), 'axis'),
        text(WIDTH - _RIGHT, height - 3, unit, 'end', 'unit'),
    ]
    ends = [f'to {plain(edge)}' for edge in edges[1:]] + ['on']
    words = ', '.join(
        f'{count} from {plain(edge)} {end}'
        for edge, end, count in zip(edges, ends, counts, strict=True)
        if count
    )
    return figure(key, title, f'In {unit}: {words or "none"}.', (WIDTH, height), *drawn)


def _short(count: int) -> str:
    """Format a count that fits beside an axis, such as 2,500 or 120k."""
    if count < 10_000:
        return f'{count:,}'
    power, letter = next(unit for unit in ((1e9, 'G'), (1e6, 'M'), (1e3, 'k')) if count >= unit[0])
    return f'{count / power:.4g}{letter}'


def shares_bar(shares: Sequence[int]) -> str:
    """Draw counts as parts of a bar; the cells beside it have the numbers."""
    total = max(sum(shares), 1)
    drawn, x = [], 0.0
    for index, share in enumerate(shares):
        width = 100 * share / total
        if share:
            drawn.append(box(x, 0, width, 10, f'share{index}'))
        x += width
    return bar(10, 'shares', drawn)


# The plot of the sensors: their frames with axes, from above and from the side.

MOST_FRAMES = 16
"""Maximum number of frames that can be distinguished in a drawing."""

_RIG_MARGIN = 44.0
_FOOT = 26
_AXIS = 26.0
_LEAST_RIG_M = 0.2
_APART = 15.0
_LABELLED = 84.0
_SPARSE = 9
_NAMES = ('x', 'y', 'z')


@dataclass(frozen=True, eq=False)
class Mount:
    """A frame of the rig.

    Attributes:
        name: Frame.
        parent: Its parent frame, empty for the root.
        root_T_frame: Its pose in the root.
        xyz_m: Translation in its parent, metres; empty for the root.
        rpy_deg: Rotation in its parent, roll pitch yaw in degrees; empty for the root.
    """

    name: str
    parent: str
    root_T_frame: Transform
    xyz_m: tuple[float, ...] = ()
    rpy_deg: tuple[float, ...] = ()

    @property
    def distance_m(self) -> float:
        """Distance to its parent, metres; 0 for the root."""
        return math.hypot(*self.xyz_m)


def mounts_of(links: Sequence[LinkSummary]) -> list[Mount]:
    """Return the frames of the largest tree of links, parents before children."""
    links = [link for link in links if is_finite(link)]
    children: dict[str, list[LinkSummary]] = defaultdict(list)
    for link in links:
        children[link.parent].append(link)
    placed = {link.child for link in links}
    trees = [_tree(root, children) for root in children if root not in placed]
    return max(trees, key=len, default=[])


def is_finite(link: LinkSummary) -> bool:
    """Return whether the values of a link are finite; those of a zero quaternion are not."""
    return bool(np.isfinite([*link.xyz_m, *link.rpy_deg]).all())


def _tree(root: str, children: dict[str, list[LinkSummary]]) -> list[Mount]:
    mounts = [Mount(root, '', Transform.identity())]
    for mount in mounts:
        for link in children.get(mount.name, ()):
            parent_T_child = Transform(
                rotation_from_rpy(*(float(np.radians(angle)) for angle in link.rpy_deg)),
                np.array(link.xyz_m),
            )
            pose = mount.root_T_frame @ parent_T_child
            mounts.append(Mount(link.child, mount.name, pose, link.xyz_m, link.rpy_deg))
    return mounts


def rig_plot(key: str, mounts: Sequence[Mount], *, side: bool) -> str:
    """Draw the frames with their axes, numbered from 1, and distances on links with room.

    Args:
        key: Unique in the page.
        mounts: At most MOST_FRAMES.
        side: From the left side (x to the right, z up); else from above (x to the right, y up).
    """
    axes = (0, 2) if side else (0, 1)
    view = _RigView(mounts, axes)
    order = {mount.name: index for index, mount in enumerate(mounts)}
    spots = np.array([view.project(mount.root_T_frame.translation) for mount in mounts])
    links = [
        (spots[order[mount.parent]], spots[index], mount.distance_m)
        for index, mount in enumerate(mounts)
        if mount.parent
    ]
    drawn = [line(start[0], start[1], end[0], end[1], 'link') for start, end, _ in links]
    drawn += [
        _axes(spot, mount.root_T_frame.rotation[list(axes)])
        for spot, mount in zip(spots, mounts, strict=True)
    ]
    drawn += _lengths(links) if len(mounts) <= _SPARSE else []
    drawn += [_badge(spot, index + 1) for index, spot in enumerate(_apart(spots))]
    seen, up = ('the left side', 'z') if side else ('above', 'y')
    height = view.height + _FOOT
    drawn += [
        text(WIDTH - 8, height - 7, 'x \N{RIGHTWARDS ARROW}', 'end', 'unit'),
        text(8, 14, f'{up} \N{UPWARDS ARROW}', 'start', 'unit'),
        scale_bar(view.scale, height),
    ]
    poses = '; '.join(
        f'{index + 1} {mount.name} at {_metres(mount.root_T_frame.translation)}'
        for index, mount in enumerate(mounts)
    )
    words = f'Seen from {seen}, in metres x y z of {mounts[0].name}: {poses}.'
    return figure(key, f'Sensors from {seen}', words, (WIDTH, height), *drawn)


def _metres(xyz: Float64Array) -> str:
    return ' '.join(f'{value + 0.0:.2f}' for value in xyz.tolist())


class _RigView:
    """The mapping from metres of two axes to the units of the plot."""

    def __init__(self, mounts: Sequence[Mount], axes: tuple[int, int]) -> None:
        self._axes = list(axes)
        translations = np.array([mount.root_T_frame.translation for mount in mounts])
        flat = translations[:, self._axes]
        extent = np.maximum(flat.max(axis=0) - flat.min(axis=0), _LEAST_RIG_M)
        # The same scale in both views, so that they can be compared.
        widest = float(np.ptp(translations, axis=0).max())
        self.scale = (WIDTH - 2 * _RIG_MARGIN) / max(widest, _LEAST_RIG_M)
        self.height = round(float(extent[1]) * self.scale + 2 * _RIG_MARGIN)
        self._middle = (flat.max(axis=0) + flat.min(axis=0)) / 2

    def project(self, xyz: Float64Array) -> Float64Array:
        """Map (3,) metres to (2,) units."""
        shift = (xyz[self._axes] - self._middle) * [self.scale, -self.scale]
        placed: Float64Array = np.array([WIDTH / 2, self.height / 2]) + shift
        return placed


def _lengths(links: Sequence[tuple[Float64Array, Float64Array, float]]) -> list[str]:
    """Draw the lengths of links that are long enough, unless another length is close.

    Args:
        links: (2,) units of both ends, and the distance of the two frames in metres.
    """
    drawn: list[str] = []
    middles: list[Float64Array] = []
    for start, end, distance_m in links:
        middle = (start + end) / 2
        crowded = any(np.abs((middle - other) / [60, 18]).max() < 1 for other in middles)
        if np.linalg.norm(end - start) > _LABELLED and not crowded:
            middles.append(middle)
            x, y = middle.tolist()
            drawn.append(text(x, y - 5, f'{distance_m:.2f} m', 'middle', 'distance'))
    return drawn


def _axes(spot: Float64Array, directions: Float64Array) -> str:
    """Draw arrows along x, y and z, projected into the plane of the drawing.

    Args:
        spot: (2,) units.
        directions: (2, 3), columns are the axes in the plane.
    """
    x, y = spot.tolist()
    drawn = []
    for name, (dx, dy) in zip(_NAMES, directions.T.tolist(), strict=True):
        length = float(np.hypot(dx, dy))
        if length < 0.35:
            continue
        tip = f'{number(x + dx * _AXIS)} {number(y - dy * _AXIS)}'
        drawn.append(path(f'M{number(x)} {number(y)}L{tip}', f'axis-{name}'))
        drawn.append(
            text(x + dx * (_AXIS + 7), y - dy * (_AXIS + 7) + 4, name, 'middle', f'axis-{name}')
        )
    return ''.join(drawn)


def _apart(spots: Float64Array) -> Float64Array:
    """Return (N, 2) positions near the spots, far enough apart for their badges."""
    centres = spots + np.linspace(0, 1e-3, len(spots))[:, None]
    for _ in range(200):
        away = centres[:, None] - centres[None]
        distance = np.linalg.norm(away, axis=2)
        np.fill_diagonal(distance, np.inf)
        close = distance < _APART
        if not close.any():
            break
        push = np.where(close, (_APART - distance) / 4, 0.0)
        centres = centres + (away / np.maximum(distance, 1e-6)[..., None] * push[..., None]).sum(1)
    spread: Float64Array = centres
    return spread


def _badge(spot: Float64Array, order: int) -> str:
    x, y = spot.tolist()
    words = text(x, y + 3.8, str(order), 'middle', 'badge')
    return f'<g>{circle(x, y, 7.5, "badge")}{words}</g>'


# The plot of a route from above.

_ROUTE_MARGIN = 34.0
_LEAST_ROUTE_M = 1.0
_LOWEST = 70.0


def route_plot(key: str, positions: Float64Array, description: str) -> str:
    """Draw a route with equal axes in metres, a scale, and marks at start and end.

    Args:
        key: Unique in the page.
        positions: (N, 2) x y in metres; x is drawn to the right, y up.
        description: Text alternative.
    """
    view = _RouteView(positions)
    pixels = _thinned(view.project(positions))
    return figure(
        key,
        'Route from above',
        description,
        (WIDTH, view.height + _FOOT),
        view.grid(),
        path('M' + 'L'.join(f'{number(x)} {number(y)}' for x, y in pixels.tolist()), 'route'),
        _marked(pixels[-1], 'end'),
        _marked(pixels[0], 'start'),
        scale_bar(view.scale, view.height + _FOOT),
    )


class _RouteView:
    """The mapping from metres to the units of the plot.

    Attributes:
        scale: Units per metre, the same for both axes.
        height: Height of the part with the route.
    """

    def __init__(self, positions: Float64Array) -> None:
        low, high = positions.min(axis=0), positions.max(axis=0)
        extent = np.maximum(high - low, _LEAST_ROUTE_M)
        self.scale = float((WIDTH - 2 * _ROUTE_MARGIN) / extent.max())
        self.height = round(max(float(extent[1]) * self.scale, _LOWEST) + 2 * _ROUTE_MARGIN)
        self._middle = (low + high) / 2
        self._centre = np.array([WIDTH / 2, self.height / 2])

    def project(self, positions: Float64Array) -> Float64Array:
        """Map (N, 2) metres to (N, 2) units."""
        placed: Float64Array = self._centre + (positions - self._middle) * [self.scale, -self.scale]
        return placed

    def grid(self) -> str:
        """Draw lines at round metres, with their numbers along the left and the lower edge."""
        step = round_length(WIDTH / self.scale / 4)
        x0, y0 = self.project(np.zeros((1, 2)))[0].tolist()
        drawn = []
        for value in _multiples(-x0 / self.scale, (WIDTH - x0) / self.scale, step):
            x = x0 + value * self.scale
            drawn.append(line(x, 0, x, self.height, 'grid-line'))
            if 40 < x < WIDTH - 44:
                drawn.append(text(x, self.height - 5, plain(value), 'middle'))
        for value in _multiples((y0 - self.height) / self.scale, y0 / self.scale, step):
            y = y0 - value * self.scale
            drawn.append(line(0, y, WIDTH, y, 'grid-line'))
            if 28 < y < self.height - 20:
                drawn.append(text(4, y - 4, plain(value)))
        drawn += [
            text(WIDTH - 6, self.height - 5, 'x m', 'end', 'unit'),
            text(4, 12, 'y m', 'start', 'unit'),
        ]
        return ''.join(drawn)


def _multiples(low: float, high: float, step: float) -> list[float]:
    return [step * count for count in range(int(np.ceil(low / step)), int(high // step) + 1)]


def _thinned(pixels: Float64Array) -> Float64Array:
    """Remove points nearer than half a unit to the one before."""
    indices = [0]
    for index in range(1, len(pixels)):
        if np.abs(pixels[index] - pixels[indices[-1]]).max() >= 0.5:
            indices.append(index)
    if indices[-1] != len(pixels) - 1:
        indices.append(len(pixels) - 1)
    thinned: Float64Array = pixels[indices]
    return thinned


def _marked(at: Float64Array, name: str) -> str:
    """Draw a start (round, label above) or an end (square, label below)."""
    x, y = at.tolist()
    start = name == 'start'
    mark = circle(x, y, 5, name) if start else box(x - 4.5, y - 4.5, 9, 9, name)
    y += -10 if start else 19
    return mark + text(min(max(x, 20), WIDTH - 20), y, name, 'middle', 'label')
