# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""HTML and SVG elements; all text that is not Markup is escaped."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

_VOID = frozenset({'br', 'img', 'link', 'meta', 'wbr'})
_BREAKS = re.compile(r'(?<=[/_.-])(?=\w)|(?<=[a-z])(?=[A-Z])')


class Markup(str):
    """HTML text; only element should create it."""

    __slots__ = ()


Child: TypeAlias = 'str | float | Markup | Iterable[Child] | None'
"""The content of an element: text, numbers, elements, several of them; None for nothing."""

Attribute: TypeAlias = 'str | float | bool | None'


def element(tag: str, *children: Child, **attributes: Attribute) -> Markup:
    """Make an element.

    Args:
        tag: Its name.
        children: Its content; text that is not Markup is escaped.
        attributes: Its attributes, escaped; class_ is class, aria_label is aria-label. True is an
            attribute without a value; None and False omit the attribute.
    """
    written = ''.join(_attribute(name, value) for name, value in attributes.items())
    if tag in _VOID:
        return Markup(f'<{tag}{written}>')
    return Markup(f'<{tag}{written}>{join(children)}</{tag}>')


def join(children: Iterable[Child]) -> Markup:
    """Concatenate several."""
    return Markup(''.join(_child(child) for child in children))


def breakable(name: str) -> Markup:
    """Add line break opportunities to a name, such as after a slash or before a capital."""
    first, *rest = _BREAKS.split(name)
    return join([first, *([element('wbr'), part] for part in rest)])


def _child(child: Child) -> str:
    if child is None:
        return ''
    if isinstance(child, Markup):
        return child
    if isinstance(child, (str, int, float)):
        return escape(_printable(str(child)))
    return join(child)


def _attribute(name: str, value: Attribute) -> str:
    if value is None or value is False:
        return ''
    name = name.rstrip('_').replace('_', '-')
    return f' {name}' if value is True else f' {name}="{escape(_printable(str(value)))}"'


def _printable(text: str) -> str:
    """Replace characters that are invalid in HTML: control characters and lone surrogates."""
    if text.isprintable():
        return text
    kept = (c if c.isprintable() or c in '\n\t' else '\N{REPLACEMENT CHARACTER}' for c in text)
    return ''.join(kept)


def number(value: float) -> str:
    """Format a coordinate of an SVG: two decimals at most, and no negative zero."""
    text = f'{value:.2f}'.rstrip('0').rstrip('.')
    return '0' if text == '-0' else text
