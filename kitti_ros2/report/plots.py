# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of streams and of labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.palette import rgb_of
from .svg import WIDTH, bar, box, figure, line, number, path, plain, text, ticks

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from ..model.geometry import Float64Array
    from .timing import Timing

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
"""Of the values of a line above and below it."""


def strip(timing: Timing, start_ns: int, end_ns: int) -> str:
    """Draw when a stream has samples between two times: a bar, with its gaps cut out and marked."""
    scale = (100 - _STRIP_TICK) / max(end_ns - start_ns, 1)
    period = timing.period_ns or 0
    places: Float64Array = np.multiply(timing.stamps_ns - start_ns, scale, dtype=np.float64)
    drawn = [
        box(x0, 3, x1 - x0 + _STRIP_TICK, 6, 'bar')
        for x0, x1 in _spans(timing, places, period if timing.regular else 0)
    ]
    for gap in timing.gaps[:_MOST_BANDS]:
        x0 = (gap.at_ns - start_ns) * scale
        drawn.append(box(x0, 0, max(gap.length_ns * scale, _STRIP_TICK), 12, 'gap'))
    return bar(12, 'strip', drawn)


def _spans(timing: Timing, places: Float64Array, period: int) -> list[tuple[float, float]]:
    """Return the spans with samples: runs of a regular stream, single samples of others."""
    if period:
        ends = [gap.at_ns for gap in timing.gaps]
        cuts = np.searchsorted(timing.stamps_ns, ends, 'right')
        return [(float(run[0]), float(run[-1])) for run in np.split(places, cuts) if len(run)]
    step = (100 - _STRIP_TICK) / _STRIP_BINS
    bins = np.unique(np.round(places / step)) * step
    return [(float(place), float(place)) for place in bins]


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
            (xs[place], ys[place])
            for xs, ys in _columns(times, values)
            for place in sorted((int(ys.argmin()), int(ys.argmax())))
        ]
        times, values = np.array(ends).T
    places = zip(times.tolist(), values.tolist(), strict=True)
    return 'M' + 'L'.join(f'{number(area.x(x))} {number(area.y(y))}' for x, y in places)


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
    power, letter = next(each for each in ((1e9, 'G'), (1e6, 'M'), (1e3, 'k')) if count >= each[0])
    return f'{count / power:.4g}{letter}'


def shares_bar(shares: Sequence[int]) -> str:
    """Draw counts as parts of a bar; the cells beside it have the numbers."""
    total = max(sum(shares), 1)
    drawn, x = [], 0.0
    for place, share in enumerate(shares):
        width = 100 * share / total
        if share:
            drawn.append(box(x, 0, width, 10, f'share{place}'))
        x += width
    return bar(10, 'shares', drawn)
