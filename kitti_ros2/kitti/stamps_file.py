# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Time stamp files: timestamps*.txt (raw) and times.txt (odometry); line n is file number n.

Raw: ``2011-09-26 13:02:25.951199337``, taken as UTC, nine digits. Odometry: seconds from the start
of the sequence, ``1.037359e-01``. Source: readme.txt of the raw and odometry devkits.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from ..model.stamps import LAST_NS, format_seconds, format_stamp, parse_seconds, parse_stamp
from .text_file import Lines, parse_lines

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

_AS_IN_KITTI = re.compile(r'((19|20)\d\d-\d\d-\d\d \d\d:\d\d:\d\d\.\d{9}\n)+', re.ASCII)


def parse_timestamps(text: str, path: Path | str) -> Lines[int]:
    """Parse a timestamps.txt: nanoseconds by line."""
    found = _parse_regular(text)  # ten times as fast as line by line, in every drive of KITTI
    if found is not None:
        return Lines(found, {})
    return parse_lines(text, path, 'YYYY-MM-DD HH:MM:SS.nnnnnnnnn', parse_stamp)


def _parse_regular(text: str) -> list[int | None] | None:
    """Parse a text whose lines all have KITTI's form; None if one has another or is invalid."""
    if not _AS_IN_KITTI.fullmatch(text):
        return None
    try:
        stamps_ns = np.array(text.splitlines(), 'datetime64[ns]').astype(np.int64)
    except ValueError:
        return None
    valid = stamps_ns.min() >= 0 and stamps_ns.max() <= LAST_NS
    return stamps_ns.tolist() if valid else None


def format_timestamps(stamps_ns: Iterable[int]) -> str:
    """Format a timestamps.txt; the inverse of parse_timestamps."""
    return ''.join(f'{format_stamp(stamp)}\n' for stamp in stamps_ns)


def parse_times(text: str, path: Path | str) -> Lines[int]:
    """Parse a times.txt: nanoseconds from the start, by line."""
    return parse_lines(text, path, 'a number of seconds', parse_seconds)


def format_times(offsets_ns: Iterable[int]) -> str:
    """Format a times.txt; the inverse of parse_times to its seven digits."""
    return ''.join(f'{format_seconds(offset)}\n' for offset in offsets_ns)
