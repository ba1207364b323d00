# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Markdown of the reference: tables, and the descriptions of fields in docstrings."""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def attributes(kind: type) -> dict[str, str]:
    """Return the descriptions of fields, from the section Attributes of a class's docstring."""
    section = inspect.getdoc(kind) or ''
    section = section.partition('Attributes:\n')[2].split('\n\n')[0]
    found: dict[str, str] = {}
    for names, text in re.findall(
        r'^ {4}([\w, ]+): ((?:.*\n?)(?: {8}.*\n?)*)', section, re.MULTILINE
    ):
        found |= dict.fromkeys(names.split(', '), ' '.join(text.split()))
    return found


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; bars in cells are escaped."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join(
        '| ' + ' | '.join(' '.join(cell.split()).replace('|', '\\|') for cell in line) + ' |'
        for line in lines
    )


def code(text: str) -> str:
    """Return a text as code."""
    return f'`{text}`'
