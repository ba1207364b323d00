# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text carried verbatim <-> std_msgs/String: what makes the way back exact to the byte.

The first line of the string is the file's name relative to the recording's root; the rest is the
file's text, or the part of it that belongs to the frame.
"""

from __future__ import annotations

import json

from ..samples import Scan, TextFile
from .ros_types import String

RECORDING = '/kitti/source/recording'
SWEEP = '/kitti/source/sweep'


def encode_text(file: TextFile) -> String:
    """A String of a file's name and text."""
    return String(f'{file.name}\n{file.text}')


def decode_text(message: String) -> TextFile:
    """The inverse of encode_text."""
    name, _, text = message.data.partition('\n')
    return TextFile(name, text)


def encode_sweep(scan: Scan) -> String | None:
    """Start and end of a sweep, nanoseconds; None where neither is told."""
    if scan.start_ns is None and scan.end_ns is None:
        return None
    return String(json.dumps({'start_ns': scan.start_ns, 'end_ns': scan.end_ns}))


def decode_sweep(message: String) -> tuple[int | None, int | None]:
    """The inverse of encode_sweep."""
    values = json.loads(message.data)
    return values['start_ns'], values['end_ns']


def encode_description(description: dict[str, object]) -> String:
    """What Recording.describe tells, as JSON."""
    return String(json.dumps(description, sort_keys=True))


def decode_description(message: String) -> dict[str, object]:
    """The inverse of encode_description."""
    values: dict[str, object] = json.loads(message.data)
    return values
