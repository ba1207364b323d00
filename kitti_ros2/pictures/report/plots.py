# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plots of streams and of labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .markup import Markup, element, join, number
from .svg import WIDTH, box, figure, line, plain, text, ticks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...geometry import Float64Array
    from .timing import Timing

_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 10, 14, 30
_INTERVAL_HEIGHT = 150
_HISTOGRAM_HEIGHT = 130
_COLUMNS = 172
_STRIP_BINS = 200
_MOST_BANDS = 200


def strip(timing: Timing, start_ns: int, end_ns: int) -> Markup:
    """When a stream has samples between two times: a bar, with its gaps cut out and marked.

    It has no words of its own, for the row it stands in has them.
    """
    span = max(end_ns - start_ns, 1)
    period = timing.period_ns or 0
    drawn = [
        box(x0, 3, max(x1 - x0, 0.5), 6, 'bar')
        for x0, x1 in _spans(timing, start_ns, span, period if timing.regular else 0)
    ]
    for gap in timing.gaps[:_MOST_BANDS]:
        x0 = 100 * (gap.at_ns - start_ns) / span
        drawn.append(box(x0, 0, max(100 * gap.length_ns / span, 0.5), 12, 'gap'))
    return element(
        'svg',
        *drawn,
        viewBox='0 0 100 12',
        preserveAspectRatio='none',
        class_='strip',
        aria_hidden='true',
        focusable='false',
    )


def _spans(timing: Timing, start_ns: int, span: int, period: int) -> list[tuple[float, float]]:
    """Where samples are, 0..100: runs of a regular stream, the samples themselves of others."""
    places = 100 * (timing.stamps_ns - start_ns) / span
    if period:
        ends = [gap.at_ns for gap in timing.gaps]
        cuts = np.searchsorted(timing.stamps_ns, ends, 'right')
        return [(float(run[0]), float(run[-1])) for run in np.split(places, cuts) if len(run)]
    bins = np.unique(np.round(places * _STRIP_BINS / 100)) * 100 / _STRIP_BINS
    return [(float(place), float(place)) for place in bins]


def interval_plot(key: str, name: str, timing: Timing) -> Markup:
    """Distance to the next sample over time, milliseconds over seconds; gaps are marked.

    The axis shows the usual distances large; what is outside is drawn at its edge.
    """
    intervals = timing.intervals_ns / 1e6
    times = (timing.stamps_ns[:-1] - timing.stamps_ns[0]) / 1e9
    period = (timing.period_ns or 0) / 1e6
    reach = max(float(np.percentile(np.abs(intervals - period), 97)) * 1.25, period * 0.02, 1e-3)
    span = float(times[-1]) or 1.0
    frame = _Frame((0, span), (max(period - reach, 0.0), period + reach), _INTERVAL_HEIGHT)
    drawn = [
        frame.axes('s', 'ms'),
        line(_LEFT, frame.y(period), WIDTH - _RIGHT, frame.y(period), 'median'),
        _dots(frame, times, np.clip(intervals, *frame.vertical)),
        *[
            _gap_mark(frame, (gap.at_ns - int(timing.stamps_ns[0])) / 1e9)
            for gap in timing.gaps[:_MOST_BANDS]
        ],
    ]
    return figure(
        key,
        f'Intervals of {name}',
        f'{len(intervals)} distances between neighbouring samples over {span:.1f} seconds. The'
        f' median is {period:.2f} ms, the shortest {intervals.min():.2f} ms, the longest'
        f' {intervals.max():.2f} ms; {len(timing.gaps)} gaps are marked.',
        (WIDTH, _INTERVAL_HEIGHT),
        *drawn,
    )


def _gap_mark(frame: _Frame, at_s: float) -> Markup:
    """A triangle at the upper edge and a line down from it."""
    x = frame.x(at_s)
    return join(
        [
            line(x, _TOP - 2, x, _INTERVAL_HEIGHT - _BOTTOM, 'gap-line'),
            element('path', d=f'M{number(x)} {_TOP}l-5-9h10z', class_='gap'),
        ]
    )


class _Frame:
    """The axes of a plot: what it shows across and up, and where that is in the SVG."""

    def __init__(
        self, across: tuple[float, float], vertical: tuple[float, float], height: int
    ) -> None:
        self._across, self.vertical = across, vertical
        self._floor = height - _BOTTOM

    def x(self, value: float) -> float:
        """Place of a value across."""
        low, high = self._across
        return _LEFT + (WIDTH - _LEFT - _RIGHT) * (value - low) / (high - low)

    def y(self, value: float) -> float:
        """Place of a value up."""
        low, high = self.vertical
        return self._floor - (self._floor - _TOP) * (value - low) / (high - low)

    def axes(self, across: str, up: str) -> Markup:
        """Lines and numbers of both axes, with their units."""
        drawn = [
            join(
                [
                    line(_LEFT, self.y(value), WIDTH - _RIGHT, self.y(value), 'grid-line'),
                    text(_LEFT - 6, self.y(value) + 4, plain(value), 'end'),
                ]
            )
            for value in ticks(*self.vertical, 4)
        ]
        drawn += [
            text(self.x(value), self._floor + 16, plain(value), 'middle')
            for value in ticks(*self._across, 6)
        ]
        drawn += [
            text(_LEFT + 4, 11, up, class_='unit'),
            text(WIDTH - _RIGHT, self._floor + 27, across, 'end', 'unit'),
        ]
        return join(drawn)


def _dots(frame: _Frame, times: Float64Array, values: Float64Array) -> Markup:
    """Each value a dot; of very many, the range of each column."""
    if len(values) <= 4 * _COLUMNS:
        marks = (
            f'M{number(frame.x(float(x)))} {number(frame.y(float(y)))}h0'
            for x, y in zip(times, values, strict=True)
        )
        return element('path', d=''.join(marks), class_='dots')
    edges = np.searchsorted(times, np.linspace(0, float(times[-1]), _COLUMNS + 1)[1:-1])
    bars = []
    for xs, ys in zip(np.split(times, edges), np.split(values, edges), strict=True):
        if len(ys):
            x, low, high = frame.x(float(xs.mean())), frame.y(ys.min()), frame.y(ys.max())
            bars.append(f'M{number(x)} {number(low + 0.7)}V{number(high - 0.7)}')
    return element('path', d=''.join(bars), class_='ranges')


def histogram_plot(
    key: str, title: str, edges: Sequence[float], counts: Sequence[int], unit: str
) -> Markup:
    """Bars over bins of one width; the last bin has all from its edge on."""
    width = edges[1] - edges[0]
    most = max(*counts, 1)
    height = _HISTOGRAM_HEIGHT
    frame = _Frame((edges[0], edges[-1] + width), (0, most * 1.08), height)
    drawn = [
        join(
            [
                line(_LEFT, frame.y(value), WIDTH - _RIGHT, frame.y(value), 'grid-line'),
                text(_LEFT - 6, frame.y(value) + 4, f'{int(value):,}', 'end'),
            ]
        )
        for value in ticks(0, most, 3)
        if value == int(value)
    ]
    across = frame.x(edges[1]) - frame.x(edges[0])
    drawn += [
        box(frame.x(edge) + 1, frame.y(count), across - 2, frame.y(0) - frame.y(count), 'bar')
        for edge, count in zip(edges, counts, strict=True)
        if count
    ]
    low = height - _BOTTOM + 16
    drawn += [text(frame.x(edge), low, plain(edge), 'middle') for edge in edges[:-1:2]]
    drawn += [
        text(frame.x(edges[-1]) + across / 2, low, f'{plain(edges[-1])}+', 'middle'),
        line(_LEFT, frame.y(0), WIDTH - _RIGHT, frame.y(0), 'axis'),
        text(WIDTH - _RIGHT, height - 3, unit, 'end', 'unit'),
    ]
    ends = [f'to {plain(edge)}' for edge in edges[1:]] + ['on']
    told = ', '.join(
        f'{count} from {plain(edge)} {end}'
        for edge, end, count in zip(edges, ends, counts, strict=True)
        if count
    )
    return figure(key, title, f'In {unit}: {told or "none"}.', (WIDTH, height), *drawn)


def shares_bar(shares: Sequence[int]) -> Markup:
    """Counts as parts of a bar; the cells beside it have the numbers."""
    total = max(sum(shares), 1)
    drawn, x = [], 0.0
    for place, share in enumerate(shares):
        width = 100 * share / total
        if share:
            drawn.append(box(x, 0, width, 10, f'share{place}'))
        x += width
    return element(
        'svg',
        *drawn,
        viewBox='0 0 100 10',
        preserveAspectRatio='none',
        class_='shares',
        aria_hidden='true',
        focusable='false',
    )
