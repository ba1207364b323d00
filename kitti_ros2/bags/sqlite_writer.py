# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One sqlite3 file of a rosbag2 bag: rosbag2_storage_sqlite3's schema, version 4 (Jazzy).

Tables: schema (version, distribution), metadata (its version, YAML), topics (id, name, type,
serialization format, offered QoS profiles as YAML, type hash), message_definitions (type, encoding,
text, type hash) and messages (topic, stamp in ns, CDR data), the last indexed by stamp.
"""

from __future__ import annotations

import sqlite3
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from ..files.local_files import WritingOut
from ..files.threads import OrderedPool
from .file_writer import POOL_AHEAD, ROS_DISTRO, VERSION, compressor, qos_text

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.bag_formats import Channel
    from .file_writer import Parts, WriterContext

_SCHEMA_VERSION = 4

# The complete file is renamed to the bag, so it needs neither a journal nor an order of writes.
# Pages of 16 KiB keep the overflow chains of scans short, and waste little of the last page.
_PRAGMAS = """
PRAGMA page_size = 16384;
PRAGMA journal_mode = OFF;
PRAGMA synchronous = OFF;
PRAGMA locking_mode = EXCLUSIVE;
"""

_TABLES = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
    id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
CREATE TABLE topics(
    id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
    type_description_hash TEXT NOT NULL);
CREATE TABLE message_definitions(
    id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
    encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
CREATE TABLE messages(
    id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
    data BLOB NOT NULL);
"""

_Row: TypeAlias = 'tuple[int, int, bytes | memoryview]'


class SqliteFileWriter:
    """The writer of one .db3 file; compression is rosbag2's message mode."""

    def __init__(self, path: Path, context: WriterContext) -> None:
        self._typestore = context.typestore
        self._types: set[str] = set()
        options = context.options
        self._pool: OrderedPool[_Row] | None = None
        if options.compression != 'none':
            self._pool = OrderedPool(context.threads, POOL_AHEAD)
            self._compress = compressor(options.compression, options.compression_level)
        self._connection = sqlite3.connect(path, isolation_level=None)
        self._connection.executescript(_PRAGMAS + _TABLES)
        self._connection.execute('INSERT INTO schema VALUES(?, ?)', (_SCHEMA_VERSION, ROS_DISTRO))
        self._connection.execute('BEGIN')
        self._writing_out = WritingOut(path)

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Write the topic's row, and its type's row if the type is new."""
        digest = self._typestore.hash_rihs01(channel.msgtype)
        if channel.msgtype not in self._types:
            self._types.add(channel.msgtype)
            text = self._typestore.generate_msgdef(channel.msgtype, ros_version=2)[0]
            self._connection.execute(
                'INSERT INTO message_definitions'
                '(topic_type, encoding, encoded_message_definition, type_description_hash)'
                ' VALUES(?, ?, ?, ?)',
                (channel.msgtype, 'ros2msg', text, digest),
            )
        self._connection.execute(
            'INSERT INTO topics VALUES(?, ?, ?, ?, ?, ?)',
            (channel_id + 1, channel.topic, channel.msgtype, 'cdr', qos_text(channel), digest),
        )

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one row."""
        data = parts[0] if len(parts) == 1 else b''.join(parts)
        row = channel_id + 1, stamp_ns, data
        if self._pool is None:
            self._insert(row)
        else:
            for compressed in self._pool.put(partial(self._compressed, row)):
                self._insert(compressed)

    def close(self, information: bytes) -> None:
        """Write the bag's metadata and the index, and commit."""
        if self._pool is not None:
            for row in self._pool.drain():
                self._insert(row)
            self._pool.close()
        self._connection.execute(
            'INSERT INTO metadata(metadata_version, metadata) VALUES(?, ?)',
            (VERSION, information.decode()),
        )
        self._connection.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
        self._connection.execute('COMMIT')
        self._close()

    def abort(self) -> None:
        """Stop all threads and close the file."""
        if self._pool is not None:
            self._pool.close()
        self._close()

    def _close(self) -> None:
        self._connection.close()
        # After it: closing a file ends the locks that SQLite has on it.
        self._writing_out.close()

    def _compressed(self, row: _Row) -> _Row:
        topic_id, stamp_ns, data = row
        return topic_id, stamp_ns, self._compress(bytes(data))

    def _insert(self, row: _Row) -> None:
        self._connection.execute(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)', row
        )
        self._writing_out.advance(len(row[2]))
