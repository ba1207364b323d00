# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text from files and bags as one line that a terminal may be shown."""

from __future__ import annotations

import re

# A word of a name that nobody reads to its end: its beginning and its end are shown.
_LONG_WORD = re.compile(r'(\S{120})\S{200,}(\S{60})')


def one_line(text: str) -> str:
    r"""A text without line breaks and without what a terminal would obey instead of show.

    Names of topics, frames and types are whatever a bag says. What is not printable (control
    characters, marks that turn the direction of writing, bytes of file names that are no UTF-8) is
    written as in a Python string, such as \x1b; of very long words the middle is left out.
    """
    line = ' '.join(text.split())
    if not line.isprintable():
        line = ''.join(each if each.isprintable() else _escaped(each) for each in line)
    return _LONG_WORD.sub(r'\1...\2', line)


def _escaped(character: str) -> str:
    return character.encode('unicode_escape').decode('ascii')
