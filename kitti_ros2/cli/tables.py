# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables for a terminal of 80 columns, without lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.text import one_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

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


def number_cell(value: float | None, digits: int = 2) -> str:
    """Format a figure: a count, which is an integer, or a number with decimal places."""
    if value is None:
        return NONE
    return f'{value:d}' if isinstance(value, int) else f'{value:.{digits}f}'


def figure_cells(figures: Mapping[str, float | None], names: Iterable[str]) -> list[str]:
    """Format the figures of a class; the counts of one that neither side has are no figures."""
    found = [figures[name] for name in names]
    return [NONE for _ in found] if None in found else [number_cell(each) for each in found]
