# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text files <-> std_msgs/String, verbatim, for byte-exact restoration.

The text of a frame: the first line of the string is the file's name relative to the recording's
root; the rest is the file's text, or the part of it that belongs to the frame.

The files of a recording, or of a calibration, are one message: tools that cut bags keep no more
than the latest message of a latched topic. It is a JSON object, each text by its name. Earlier
versions wrote a message a file, as the text of a frame.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..files.local_files import crc32
from ..model.errors import runs_of
from ..model.samples import Description, Scan, TextFile
from ..model.streams import Stream
from .ros_types import String

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import PurePath


def encode_text(file: TextFile) -> String:
    """Make a String of a file's name and text."""
    return String(f'{file.name}\n{file.text}')


def decode_text(message: String) -> TextFile:
    """Decode a file's name and text: the inverse of encode_text."""
    name, _, text = message.data.partition('\n')
    return TextFile(name, text)


def encode_texts(files: Sequence[TextFile]) -> String:
    """Make a String of whole files, as JSON: their texts by name."""
    return String(json.dumps({file.name: file.text for file in files}, ensure_ascii=False))


def decode_texts(message: String) -> tuple[TextFile, ...]:
    """Decode whole files: the inverse of encode_texts, and the one file of earlier versions.

    Raises:
        ValueError: The message is damaged, or its JSON is no object of texts.
    """
    if not message.data.startswith('{'):
        return (decode_text(message),)
    try:
        pairs = json.loads(message.data, object_pairs_hook=tuple)
    except RecursionError:
        raise ValueError('the JSON of files is nested') from None
    if not all(isinstance(text, str) for _, text in pairs):
        raise ValueError('the JSON of files has a value that is no text')
    for pair in pairs:
        ''.join(pair).encode()  # raises for half a surrogate pair, which no file can have
    return tuple(TextFile(name, text) for name, text in pairs)


def encode_sweep(scan: Scan) -> String | None:
    """Make a String of start and end of a sweep, nanoseconds; None if both are unknown."""
    if scan.start_ns is None and scan.end_ns is None:
        return None
    return String(json.dumps({'start_ns': scan.start_ns, 'end_ns': scan.end_ns}))


def decode_sweep(message: String) -> tuple[int | None, int | None]:
    """Decode start and end of a sweep: the inverse of encode_sweep."""
    values = json.loads(message.data)
    return values['start_ns'], values['end_ns']


def encode_file_check(path: PurePath, data: bytes) -> String:
    """Make a String of the name, size and CRC-32 of a file of which a bag has the pixels alone."""
    return String(f'{path.name} {len(data)} {crc32(data)}')


def decode_file_check(message: String) -> tuple[str, tuple[int, int]]:
    """Decode name, and size and CRC-32, of a file: the inverse of encode_file_check.

    Raises:
        ValueError: The message is damaged.
    """
    name, size, checksum = message.data.rsplit(' ', 2)
    return name, (int(size), int(checksum))


def promise(
    description: Description,
    carried: Mapping[Stream, Sequence[int]],
    calibrations: Sequence[str],
) -> Description:
    """Add a list of the recording's files that are in the messages of a selection.

    A reader of the bag compares the messages with it, so that a lost one is always detected.

    Args:
        description: Description of the recording; its files list all numbered files of a stream.
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
