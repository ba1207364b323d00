# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Markdown of the reference: tables, and the descriptions of fields in docstrings."""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_MARKUP = re.compile(r'(`[^`]*`)|[*<]|(?<!\w)_|_(?!\w)')
_SHOWN = {'*': '\\*', '_': '\\_', '<': '&lt;'}


def attributes(kind: type) -> dict[str, str]:
    """Return the descriptions of fields, from the section Attributes of a class's docstring."""
    section = inspect.getdoc(kind) or ''
    return entries(section.partition('Attributes:\n')[2].split('\n\n')[0])


def entries(section: str) -> dict[str, str]:
    """Return the texts of a docstring's section by name."""
    found: dict[str, str] = {}
    for names, text in re.findall(
        r'^ {4}([\w*, ]+): ((?:.*\n?)(?: {8}.*\n?)*)', section, re.MULTILINE
    ):
        found |= dict.fromkeys(names.split(', '), ' '.join(text.split()))
    return found


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; what Markdown would take for its own in cells is escaped."""
    lines = [head, ['---'] * len(head), *rows]
    cells = (
        [escape(' '.join(cell.split())).replace('|', '\\|') for cell in line] for line in lines
    )
    return '\n'.join(f'| {" | ".join(line)} |' for line in cells)


def escape(text: str) -> str:
    """Return a text whose asterisks, underscores and angles are shown; code is left as it is."""
    return _MARKUP.sub(lambda found: found[1] or _SHOWN[found[0]], text)


def code(text: str) -> str:
    """Return a text as code."""
    return f'`{text}`'
