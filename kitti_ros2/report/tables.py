# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of the page."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

NUMBER = 'num'
TEXT = ''
LONG = 'wide'
NAME = 'name'


class Table(NamedTuple):
    """A table; the first cell of a row names it.

    Attributes:
        caption: Its caption.
        columns: Heading and kind (NUMBER, TEXT, LONG or NAME) of each.
        rows: The cells; the section's template writes those that are more than text.
        total: A last row with totals.
    """

    caption: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[object]]
    total: Sequence[str] = ()
