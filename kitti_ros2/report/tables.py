# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, figures and pictures of the page."""

from __future__ import annotations

from base64 import b64encode
from typing import TYPE_CHECKING

from .markup import Markup, element

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .contents import Picture
    from .markup import Child

NUMBER = 'num'
TEXT = ''
LONG = 'wide'
NAME = 'name'


def table(
    caption: str,
    columns: Sequence[tuple[str, str]],
    rows: Sequence[Sequence[Child]],
    total: Sequence[Child] | None = None,
) -> Markup:
    """Make a table that scrolls in its own box if it is too wide, also by keyboard.

    Args:
        caption: Its caption.
        columns: Heading and kind (NUMBER, TEXT, LONG or NAME) of each; the first one names the row.
        rows: The cells.
        total: A last row with totals.
    """
    kinds = [kind for _, kind in columns]
    head = element(
        'thead',
        element(
            'tr',
            [element('th', name, scope='col', class_=kind or None) for name, kind in columns],
        ),
    )
    body = element('tbody', [_row(cells, kinds) for cells in rows])
    foot = None if total is None else element('tfoot', _row(total, kinds))
    whole = element('table', element('caption', element('span', caption)), head, body, foot)
    return element('div', whole, class_='scroll', role='region', aria_label=caption, tabindex='0')


def _row(cells: Sequence[Child], kinds: Sequence[str]) -> Markup:
    first = element('th', cells[0], scope='row', class_=kinds[0] or None)
    rest = [
        element('td', cell, class_=kind or None)
        for cell, kind in zip(cells[1:], kinds[1:], strict=True)
    ]
    return element('tr', first, *rest)


def captioned(drawn: Markup, *caption: Child, class_: str | None = None) -> Markup:
    """Make a figure with a caption."""
    return element('figure', drawn, element('figcaption', *caption), class_=class_)


def pictured(picture: Picture, class_: str | None = None) -> Markup:
    """Make an image embedded in the page."""
    data = b64encode(picture.data).decode('ascii')
    image = element(
        'img',
        src=f'data:image/jpeg;base64,{data}',
        width=picture.width,
        height=picture.height,
        alt=picture.alt,
        loading='lazy',
        decoding='async',
    )
    return captioned(image, picture.caption, class_=class_)
