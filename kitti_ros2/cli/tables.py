# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables for a terminal of 80 columns, without lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.text import one_line

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.table import Table


NONE = '-'
"""The cell of a figure that is not there."""


def plain_table(first: str, numbers: Iterable[str] = ()) -> Table:
    """Return a table with a column of names and columns of numbers."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style='bold')
    table.add_column(first, overflow='fold')
    for heading in numbers:
        table.add_column(heading, justify='right', no_wrap=True)
    return table


def cell(text: str) -> str:
    """Return a name with its markup escaped, for a table."""
    from rich.markup import escape

    return escape(one_line(text))
