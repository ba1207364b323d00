# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text files <-> std_msgs/String, verbatim, for byte-exact restoration.

The first line of the string is the file's name relative to the recording's root; the rest is the
file's text, or the part of it that belongs to the frame.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..model.losses import runs_of
from ..model.samples import Description, Scan, TextFile
from ..model.streams import Stream
from .ros_types import String

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

RECORDING = '/kitti/source/recording'
FILES = '/kitti/source/files'
CALIBRATION = '/kitti/source/calibration'
SWEEP = '/kitti/source/sweep'
POINTS = '/kitti/source/points'
LABEL_LINES = '/kitti/source/labels'
OXTS_LINES = '/kitti/source/oxts'

GREY = 'grey'
"""Key of the description: the streams of colour images whose pixels are in messages as grey."""


def encode_text(file: TextFile) -> String:
    """Make a String of a file's name and text."""
    return String(f'{file.name}\n{file.text}')


def decode_text(message: String) -> TextFile:
    """Decode a file's name and text: the inverse of encode_text."""
    name, _, text = message.data.partition('\n')
    return TextFile(name, text)


def encode_sweep(scan: Scan) -> String | None:
    """Make a String of start and end of a sweep, nanoseconds; None if both are unknown."""
    if scan.start_ns is None and scan.end_ns is None:
        return None
    return String(json.dumps({'start_ns': scan.start_ns, 'end_ns': scan.end_ns}))


def decode_sweep(message: String) -> tuple[int | None, int | None]:
    """Decode start and end of a sweep: the inverse of encode_sweep."""
    values = json.loads(message.data)
    return values['start_ns'], values['end_ns']


def promise(
    description: Description,
    carried: Mapping[Stream, Sequence[int]],
    calibrations: Sequence[str],
) -> Description:
    """Add a list of the recording's files that are in the messages of a selection.

    A reader of the bag compares the messages with it, so that a lost one is always detected.

    Args:
        description: Of the recording; its files list all numbered files of a stream.
        carried: By stream with files in messages: the selected numbers; those without a file are
            ignored. The text files are included if Stream.RECORDING is.
        calibrations: Names of the calibration files in messages, if these are not numbered.
    """
    values: dict[str, Any] = dict(description.values)
    values['files'] = {
        name: {**entry, 'carried': _common_runs(entry['numbers'], carried.get(Stream(name), ()))}
        for name, entry in values['files'].items()
    }
    texts = description.files if Stream.RECORDING in carried else ()
    values['texts'] = [file.name for file in texts]
    values['calibrations'] = list(calibrations)
    return replace(description, values=values)


def _common_runs(runs: Iterable[Sequence[int]], numbers: Iterable[int]) -> list[list[int]]:
    """Return the runs of those numbers that are within other runs."""
    within = {number for first, last in runs for number in range(first, last + 1)}
    return runs_of(sorted(within.intersection(numbers)))


def encode_description(description: dict[str, object]) -> String:
    """Make a String of a recording's description, as JSON."""
    return String(json.dumps(description, sort_keys=True))


def decode_description(message: String) -> dict[str, object]:
    """Decode a recording's description: the inverse of encode_description."""
    values: dict[str, object] = json.loads(message.data)
    return values
