# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Single messages of a chunk that is not compressed, read at the offsets in the index of its file.

The head of each record is compared with the index before any message of the chunk is used.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from .container_file import START_BYTES, IndexedMessage

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from .container_file import Chunk, FileBytes
    from .decompression import Buffer
    from .records import RecordFormat

LEAST_APART = 2**14
"""Bytes of a chunk for each requested message, from which on it is worth to read them alone."""

LARGE = 2**14
"""Bytes of the smallest message of which the start is read first."""

_NEAR = 2**13  # bytes between two messages that are read together: another call takes as long


class StartOfMessage(NamedTuple):
    """The first data of a message, perhaps all; position and size are those of all in the file."""

    data: Buffer
    position: int
    size: int


def indexed_messages(
    indexed: Mapping[int, npt.NDArray[np.integer[Any]]], chunk: Chunk, records_at: int
) -> list[IndexedMessage]:
    """Return the messages of a chunk by its index; none if that contradicts itself.

    Args:
        indexed: (N, 2) stamps and offsets by channel id.
        chunk: The chunk.
        records_at: The position of its first record, from which offsets count.
    """
    rows = [(key, *row) for key, entries in indexed.items() for row in entries.tolist()]
    starts = sorted(records_at + offset for _, _, offset in rows)
    ends = dict(pairwise([*starts, chunk.position + chunk.length]))
    if len(ends) < len(rows) or any(not chunk.start_ns <= row[1] <= chunk.end_ns for row in rows):
        return []
    return [
        IndexedMessage(stamp_ns, records_at + offset, ends[records_at + offset], channel_id)
        for channel_id, stamp_ns, offset in rows
    ]


def read_starts(
    form: RecordFormat[Any], file: FileBytes, messages: Sequence[IndexedMessage]
) -> list[StartOfMessage] | None:
    """Read the starts of messages, and small ones as a whole; in the order of the messages.

    Returns:
        None if a record is not the message that the index has there.

    Raises:
        OSError: The disk refuses.
    """
    starts = {}
    for position, end, near in _near(form, messages):
        block = memoryview(file.read(position, end - position))
        for message in near:
            start = _start(form, block, position, message)
            if start is None:
                return None
            starts[message.position] = start
    return [starts[message.position] for message in messages]


def _near(
    form: RecordFormat[Any], messages: Sequence[IndexedMessage]
) -> Iterator[tuple[int, int, list[IndexedMessage]]]:
    """Yield what is read at once: first byte, end, and the messages that begin there."""
    near: list[IndexedMessage] = []
    end = 0
    for message in sorted(messages, key=attrgetter('position')):
        if near and message.position - end > _NEAR:
            yield near[0].position, end, near
            near = []
        near.append(message)
        end = message.end
        if end - message.position >= LARGE:
            end = message.position + form.longest_message_head + START_BYTES
    if near:
        yield near[0].position, end, near


def _start(
    form: RecordFormat[Any], block: memoryview, position: int, message: IndexedMessage
) -> StartOfMessage | None:
    """Return the start of a message in bytes from a position on; None if it is another one."""
    try:
        head, start, end = form.split_record(block, message.position - position)
        body = block[start:end]
        stored = form.stored_message(head, body)
    except (ValueError, KeyError, struct.error):
        return None
    if stored is None or stored[:2] != (message.stamp_ns, message.channel_id):
        return None
    data = stored[2]
    start += len(body) - len(data)
    if position + end > message.end:
        return None
    return StartOfMessage(data, position + start, end - start)
