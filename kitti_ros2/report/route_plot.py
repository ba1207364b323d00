# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plot of a route from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .svg import (
    WIDTH,
    box,
    circle,
    figure,
    line,
    number,
    path,
    plain,
    round_length,
    scale_bar,
    text,
)

if TYPE_CHECKING:
    from ..model.geometry import Float64Array

_ROUTE_MARGIN = 34.0
_FOOT = 26
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
    pixels = _thinned(view.place(positions))
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

    def place(self, positions: Float64Array) -> Float64Array:
        """Map (N, 2) metres to (N, 2) units."""
        placed: Float64Array = self._centre + (positions - self._middle) * [self.scale, -self.scale]
        return placed

    def grid(self) -> str:
        """Draw lines at round metres, with their numbers along the left and the lower edge."""
        step = round_length(WIDTH / self.scale / 4)
        x0, y0 = self.place(np.zeros((1, 2)))[0].tolist()
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
    """Remove places nearer than half a unit to the one before."""
    kept = [0]
    for place in range(1, len(pixels)):
        if np.abs(pixels[place] - pixels[kept[-1]]).max() >= 0.5:
            kept.append(place)
    if kept[-1] != len(pixels) - 1:
        kept.append(len(pixels) - 1)
    thinned: Float64Array = pixels[kept]
    return thinned


def _marked(at: Float64Array, name: str) -> str:
    """Draw a start (round, label above) or an end (square, label below)."""
    x, y = at.tolist()
    start = name == 'start'
    mark = circle(x, y, 5, name) if start else box(x - 4.5, y - 4.5, 9, 9, name)
    y += -10 if start else 19
    return mark + text(min(max(x, 20), WIDTH - 20), y, name, 'middle', 'label')
