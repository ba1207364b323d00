# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""GPS/IMU packets: one a file (raw) or one a line (tracking), 30 columns.

Columns: lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu
pos_accuracy vel_accuracy navstat numsats posmode velmode orimode; for units and axes see
samples.OxtsPacket. The dataset's own dataformat.txt lists ay twice: the second is az.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import TYPE_CHECKING

from ..model.errors import BadFileError
from ..model.samples import OxtsPacket
from .text_file import check_columns, parse_numbers

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.samples import TextFile

COLUMNS: tuple[str, ...] = tuple(
    field.name for field in fields(OxtsPacket) if field.name != 'source'
)
_FLOATS = COLUMNS.index('navstat')
_EXPECTED = f'the {len(COLUMNS)} numbers of an oxts packet'
# Degrees, metres, radians, metres, m/s: no real packet comes near.
_LIMITS = {
    'lat': 89.9,
    'lon': 360.0,
    'alt': 1e5,
    **dict.fromkeys(('roll', 'pitch', 'yaw'), 6.3),
    **dict.fromkeys(('pos_accuracy', 'vel_accuracy'), 1e9),
}


def parse_packet(
    text: str, path: Path | str, line: int = 1, source: TextFile | None = None
) -> OxtsPacket:
    """Parse a packet.

    Args:
        text: The line.
        path: For the errors.
        line: For the errors, from 1.
        source: Kept in the packet.

    Raises:
        BadFileError: Not 30 values, or one that is no finite number.
    """
    try:
        values = parse_numbers(text.split(), len(COLUMNS))
        _check_ranges(values)
    except ValueError as error:
        raise BadFileError(path, str(error), _EXPECTED, line=line) from None
    states = (int(value) for value in values[_FLOATS:])
    return OxtsPacket(*values[:_FLOATS], *states, source=source)  # type: ignore[arg-type, misc]


def packet_lines(text: str, path: Path | str) -> list[str]:
    """Return the lines of a file of packets with their ends, blank ones at its end left out.

    Raises:
        BadFileError: More than a thousand do not have 30 values.
    """
    lines = text.splitlines(keepends=True)
    while lines and not lines[-1].strip():
        lines.pop()
    check_columns(enumerate(lines, 1), (len(COLUMNS),), path, _EXPECTED)
    return lines


def _check_ranges(values: list[float]) -> None:
    """Check that a place is on earth, and that accuracies have squares.

    Mercator would make NaN of another place.

    Raises:
        ValueError: A column is out of range.
    """
    for name, value in zip(COLUMNS, values, strict=True):
        if abs(value) > _LIMITS.get(name, math.inf):
            raise ValueError(f'{name} is {value:g}')


def format_packet(packet: OxtsPacket) -> str:
    """Format the line of a packet without its end, 14 significant digits as the dataset's own."""
    values = [getattr(packet, name) for name in COLUMNS]
    return ' '.join(
        [f'{value:.14g}' for value in values[:_FLOATS]]
        + [f'{value:d}' for value in values[_FLOATS:]]
    )
