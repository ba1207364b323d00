# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of plots: inline SVG with text alternatives; colours come from the page.

Each plot is drawn 400 units wide and shown between 300 and 560 pixels wide, so its text stays
legible on a phone.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .markup import element, number

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from .markup import Markup

WIDTH = 400


def figure(key: str, title: str, description: str, size: tuple[int, int], *drawn: Markup) -> Markup:
    """Make an SVG with a text alternative for screen readers.

    Args:
        key: Unique in the page; its ids are made from it.
        title: Its name.
        description: Text alternative.
        size: Width and height in its own units.
        drawn: Its elements.
    """
    return element(
        'svg',
        element('title', title, id=f'{key}-title'),
        element('desc', description, id=f'{key}-desc'),
        *drawn,
        viewBox=f'0 0 {size[0]} {size[1]}',
        role='img',
        aria_labelledby=f'{key}-title {key}-desc',
        class_='plot',
    )


def text(x: float, y: float, words: str, anchor: str = 'start', class_: str = '') -> Markup:
    """Draw text; anchor is start, middle or end."""
    return element(
        'text', words, x=number(x), y=number(y), text_anchor=anchor, class_=class_ or None
    )


def line(x1: float, y1: float, x2: float, y2: float, class_: str) -> Markup:
    """Draw a straight line."""
    return element(
        'line', x1=number(x1), y1=number(y1), x2=number(x2), y2=number(y2), class_=class_
    )


def box(x: float, y: float, width: float, height: float, class_: str) -> Markup:
    """Draw a filled rectangle."""
    return element(
        'rect',
        x=number(x),
        y=number(y),
        width=number(width),
        height=number(height),
        class_=class_,
    )


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
    return [step * place for place in range(first, last + 1)]


def plain(value: float) -> str:
    """Format a tick's value without needless digits."""
    return f'{value:.6g}'


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= length * 1.001)


def scale_bar(scale: float, height: float) -> Markup:
    """Draw a scale bar of a round length in the lower left corner.

    Args:
        scale: Units per metre.
        height: Height of the plot.
    """
    length = round_length(110 / scale)
    y = height - 8
    return element(
        'g',
        element('path', d=f'M10 {number(y - 5)}v5h{number(length * scale)}v-5', class_='scale'),
        text(10 + length * scale + 6, y + 1, f'{plain(length)} m', class_='label'),
    )


def path(points: Float64Array) -> str:
    """Return the d attribute of a line through (N, 2) points."""
    return 'M' + 'L'.join(f'{number(x)} {number(y)}' for x, y in points.tolist())
