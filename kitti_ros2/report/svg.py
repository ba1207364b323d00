# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of plots: inline SVG with text alternatives; colours come from the page.

Each plot is drawn 400 units wide and shown between 300 and 560 pixels wide, so its text stays
legible on a phone.
"""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    """Make an SVG 100 units wide, stretched to its place; the text beside it is its alternative."""
    return (
        f'<svg viewBox="0 0 100 {height}" preserveAspectRatio="none" class="{class_}"'
        f' aria-hidden="true" focusable="false">{"".join(drawn)}</svg>'
    )


def text(x: float, y: float, words: str, anchor: str = 'start', class_: str = '') -> str:
    """Draw text; anchor is start, middle or end."""
    look = class_ and f' class="{class_}"'
    place = f'x="{number(x)}" y="{number(y)}" text-anchor="{anchor}"'
    return f'<text {place}{look}>{escape(words)}</text>'


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
    return [step * place for place in range(first, last + 1)]


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
