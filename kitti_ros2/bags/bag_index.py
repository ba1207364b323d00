# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The stamps of a bag's messages without its payloads, one function per kind of file."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from typing import TYPE_CHECKING, BinaryIO
from urllib.parse import quote

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import ReaderError as Ros1ReaderError
from rosbags.rosbag1.reader import decompressors

from kitti_ros2.errors import BadBagError

from .mcap_scan import scan_mcap
from .mcap_summary import MAGIC
from .summary import BagIndex

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt
    from mcap.records import ChunkIndex
    from mcap.summary import Summary

_INDEX_HEAD = struct.Struct('<BQHI')


def mcap_index(path: Path) -> BagIndex:
    """The index of an MCAP file: from its summary, or from a pass over a file that lacks one.

    Raises:
        BadBagError: It is no MCAP file.
        OSError: It cannot be read.
    """
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise BadBagError(path, 'does not begin as an MCAP file does')
        summary = _read_summary(file)
        if summary is not None:
            index = _summarized(file, summary)
            # Messages outside of chunks, or chunks without index: only the file itself can tell.
            if summary.statistics and summary.statistics.message_count == index.total:
                return index
    return scan_mcap(path).index()


def sqlite_index(path: Path) -> BagIndex:
    """The index of a .db3 file.

    Raises:
        BadBagError: It is no rosbag2 sqlite3 file.
    """
    index = BagIndex()
    wal = path.with_name(path.name + '-wal')
    if wal.is_file() and wal.stat().st_size:
        index.complete = False
        index.warnings.append(
            f'{wal}: the recorder did not close this bag; open it once with sqlite3 to complete it'
        )
    try:
        uri = f'file:{quote(str(path.absolute()))}?immutable=1'
        with closing(sqlite3.connect(uri, uri=True)) as connection:
            topics = connection.execute('SELECT id, name, type FROM topics').fetchall()
            rows = connection.execute('SELECT topic_id, timestamp FROM messages').fetchall()
    except sqlite3.Error as error:
        raise BadBagError(path, f'is no rosbag2 sqlite3 file ({error})') from error
    table = np.array(rows, dtype=np.int64).reshape(-1, 2)
    for topic_id, name, msgtype in topics:
        index.add((name, msgtype), table[table[:, 0] == topic_id, 1])
    return index


def ros1_index(path: Path) -> BagIndex:
    """The index of a ROS 1 .bag file.

    Raises:
        BadBagError: It is no such file, or its index is lacking.
    """
    index = BagIndex()
    reader = Ros1Reader(path)
    try:
        reader.open()
    except (Ros1ReaderError, AssertionError, struct.error, ValueError, IndexError) as error:
        raise BadBagError(path, _ros1_trouble(path, error)) from error
    try:
        for connection in reader.connections:
            stamps = [entry.time for entry in reader.indexes.get(connection.id, [])]
            index.add((connection.topic, connection.msgtype), stamps)
        names = {function: name for name, function in decompressors.items()}
        index.compressions |= {names[chunk.decompressor] for chunk in reader.chunks.values()}
    finally:
        reader.close()
    return index


def _read_summary(file: BinaryIO) -> Summary | None:
    try:
        file.seek(-len(MAGIC), 2)
        return make_reader(file).get_summary() if file.read() == MAGIC else None
    except (McapError, StopIteration, struct.error, ValueError, OSError):
        return None


def _summarized(file: BinaryIO, summary: Summary) -> BagIndex:
    index = BagIndex()
    keys = {}
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        keys[channel.id] = (channel.topic, schema.name if schema else '')
        index.add(keys[channel.id], [])
    for chunk in summary.chunk_indexes:
        index.compressions.add(chunk.compression)
        for channel_id, stamps in _chunk_stamps(file, chunk):
            if channel_id in keys:
                index.add(keys[channel_id], stamps)
    return index


def _chunk_stamps(
    file: BinaryIO, chunk: ChunkIndex
) -> Iterator[tuple[int, npt.NDArray[np.uint64]]]:
    file.seek(chunk.chunk_start_offset + chunk.chunk_length)
    block = file.read(chunk.message_index_length)
    position = 0
    while position + _INDEX_HEAD.size <= len(block):
        _, length, channel_id, size = _INDEX_HEAD.unpack_from(block, position)
        entries = np.frombuffer(block, '<u8', size // 8, position + _INDEX_HEAD.size)
        yield channel_id, entries[::2]
        position += 9 + length


def _ros1_trouble(path: Path, error: Exception) -> str:
    if 'reindex' in str(error):
        return 'is a ROS 1 bag whose recorder was cut off; run rosbag reindex on it'
    if path.stat().st_size == 0:
        return 'is empty'
    return f'is no readable ROS 1 bag: cut off or damaged ({error})'
