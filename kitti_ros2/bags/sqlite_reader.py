# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 .db3 file open for reading, even if it is truncated or damaged."""

from __future__ import annotations

import os
import shutil
import sqlite3
import sys
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np

from ..files.remote import is_remote
from ..model.errors import BadBagError, one_line
from .container_file import (
    LAST_NS,
    START_BYTES,
    BagFile,
    Chunk,
    FileBytes,
    MessageStart,
    StoredChannel,
    UnreadMessage,
    offered_qos,
    ros2_spelling,
)
from .decompression import FileLimits, LimitError
from .sqlite_pages import Pages

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from .container_file import (
        FetchedChunk,
        FoundMessage,
        IndexedMessage,
        NamedFile,
        Problems,
        Wanted,
    )
    from .decompression import DescriptionLimits
    from .sqlite_pages import MessageRow


# Connections to databases of any origin, which may hold programs in place of tables.

_TABLES = ('topics', 'messages', 'message_definitions')
_PERIOD = 100_000  # SQLite's instructions between two checks of the budget
_ALWAYS = 20_000_000  # about a second
_QUERY_BYTES = 1_000_000  # of what is no value of the file, such as a query
_LONGEST = 2**31 - 1
_PER_BYTE = 20  # a row has at least 20 bytes, and takes about 10


class GuardedConnection(sqlite3.Connection):
    """A connection whose queries end after a number of steps in proportion to the file.

    A tree of pages may lead to the same page again and again.
    """

    _left = 0
    _budget = 0

    def guard(self, size: int) -> None:
        """Refuse views and virtual tables where rosbag2 has tables, and bound the queries.

        Args:
            size: Bytes of the file.

        Raises:
            ValueError: A table of rosbag2 is none, or computes its columns.
            sqlite3.Error: The database cannot be read.
        """
        self._budget = _ALWAYS + _PER_BYTE * size
        if sys.version_info >= (3, 11):
            # A chain of pages may lead back to itself: no value is longer than the file.
            self.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(size + _QUERY_BYTES, _LONGEST))
        self.set_progress_handler(self._is_spent, _PERIOD)
        self.execute('PRAGMA trusted_schema = OFF')
        kinds = {
            name.lower(): (kind, root)
            for kind, name, root in self.execute('SELECT type, name, rootpage FROM sqlite_master')
            if kind in {'table', 'view'} and isinstance(name, str)
        }
        for name in _TABLES:
            kind, root = kinds.get(name, ('table', 1))
            if kind != 'table' or not root:
                raise ValueError(f'{name} is a {"view" if kind == "view" else "virtual table"}')
            if any(hidden for *_, hidden in self.execute(f'PRAGMA table_xinfo({name})')):
                raise ValueError(f'{name} has columns that are computed')

    def execute(self, sql: str, values: Any = (), /) -> sqlite3.Cursor:  # noqa: ANN401 - as sqlite3
        """Run a query with a budget of its own."""
        self._left = self._budget
        return super().execute(sql, values)

    def _is_spent(self) -> bool:
        self._left -= _PERIOD
        return self._left < 0


# The topics of a rosbag2 database: from its tables, or from its pages if it is damaged.

_DEFINITION_COLUMNS = 4
_LEAST_TOPIC_COLUMNS = 3


def stored_topics(
    connection: sqlite3.Connection, limits: DescriptionLimits
) -> dict[int, StoredChannel]:
    """Read the topics by the id of their row; earlier versions of the schema have fewer columns.

    Raises:
        sqlite3.Error: The topics cannot be read.
        TypeError: The topics are damaged.
        LimitError: There are too many.
    """
    definitions = {}
    with suppress(sqlite3.OperationalError):  # the table is missing before version 4
        for row in connection.execute(
            'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
        ):
            limits.add(_size(row))
            definitions[row[0]] = (row[2], row[1])
    # Columns by number: the id, and about four texts.
    topics = {}
    for topic_id, *texts in connection.execute('SELECT * FROM topics'):
        limits.add(_size(texts))
        topics[topic_id] = _channel(texts, definitions)
    return topics


def scanned_topics(pages: Pages, limits: DescriptionLimits) -> dict[int, StoredChannel]:
    """Return the topics found in the pages, by the id of their row.

    Raises:
        LimitError: There are too many.
    """
    definitions = {}
    topics = {}
    for row_id, texts in pages.texts():
        limits.add(_size(texts))
        if len(texts) == _DEFINITION_COLUMNS and texts[1].startswith('ros2'):
            definitions[texts[0]] = (texts[2], texts[1])
        elif len(texts) >= _LEAST_TOPIC_COLUMNS and '/' in texts[1]:
            topics[row_id] = texts
    return {topic_id: _channel(texts, definitions) for topic_id, texts in topics.items()}


def _size(row: Sequence[object]) -> int:
    return sum(len(column) for column in row if isinstance(column, (str, bytes)))


def _channel(texts: Sequence[str], definitions: Mapping[str, tuple[str, str]]) -> StoredChannel:
    """Make a topic from its row: name, type, serialization format, from version 2 on QoS profiles.

    Raises:
        TypeError: A column is not a text.
    """
    topic, msgtype, encoding, *rest = texts
    if not all(isinstance(text, str) for text in (topic, msgtype, encoding or '')):
        raise TypeError('the names of topics are no texts')
    return StoredChannel(
        topic,
        ros2_spelling(msgtype) if '/' in msgtype else msgtype,
        encoding or '',
        *definitions.get(msgtype, ('', '')),
        **offered_qos(rest[0] if rest else ''),
    )


# A rosbag2 .db3 file open for reading, even if it is truncated or damaged.
#
# All rows are listed first, without their data, and sorted by time. Their data are read by one
# query up to the first failure, then from the file's pages.

_ROW = np.dtype([('id', '<i8'), ('topic_id', '<i8'), ('stamp_ns', '<i8')])
# SQLite does not read data of which it needs the length only; a chain of pages may have no end.
_DATA = (
    "SELECT id, CASE typeof(data) WHEN 'blob' THEN length(data) END,"
    ' CASE WHEN length(data) <= ? THEN data END FROM messages {}'
    ' WHERE {} IN ({}) AND timestamp >= ? {}'
)
_BY_ID = _DATA.format('NOT INDEXED', 'id', '{}', '')  # in order; told to sort, SQLite copies data
_IN_ORDER = _DATA.format('NOT INDEXED', 'topic_id', '{}', 'ORDER BY id')
_TO_SORT = _DATA.format('', 'topic_id', '{}', 'ORDER BY timestamp, id')
_FEW = 8  # rows that are found by their ids
_LARGE = 2**16
_READS_PARTS = sys.version_info >= (3, 11)
_BLOB = 'messages', 'data'
_ADVISED_BYTES = 2**22
_ERRORS = (sqlite3.Error, TypeError, ValueError, OverflowError)


class SqliteFile(BagFile):
    """A .db3 file.

    Args:
        file: The file.
        problems: Collects notes and losses.

    Attributes:
        channels: By the id of their row.
        chunks: All rows are one chunk.
        compressions: Empty; rosbag2 compresses messages or whole files.

    Raises:
        BadBagError: The file is no rosbag2 database.
        OSError: The file cannot be read.
    """

    def __init__(self, file: NamedFile, problems: Problems) -> None:
        if is_remote(file.path):
            raise BadBagError(
                file.name,
                'is a sqlite3 bag, which is read from a local disk only',
                'an MCAP file or a ROS 1 bag at a URL; copy it to this machine first',
            )
        self._name = file.name
        self._problems = problems
        self._file = FileBytes(file)
        self._connection: sqlite3.Connection | None = None
        self._by_id: dict[int, MessageRow] | None = None
        self._left = ExitStack()
        self._size = self._file.size  # with the log beside it
        self._limits = self._file.limits
        try:
            self._pages = Pages(self._file)
            rows = self._open(file.path)
        except LimitError as error:
            self.close()
            raise BadBagError(file.name, str(error), expected='') from error
        except ValueError as error:
            self.close()
            raise BadBagError(file.name, f'is no rosbag2 sqlite3 file ({error})') from error
        described = np.isin(rows['topic_id'], list(self.channels))
        if not described.all():
            count = int(np.count_nonzero(~described))
            self._lose(f'{count} messages are of topics that are not described', count)
            rows = rows[described]
        # Stable: equal stamps stay in the order of ids.
        self._rows = rows[np.argsort(rows['stamp_ns'], kind='stable')]
        self.chunks = [self._chunk()] if len(rows) else []

    def read(
        self,
        chunk: Chunk,
        wanted: Wanted,
        fetched: FetchedChunk | Sequence[IndexedMessage] | None = None,
    ) -> Iterator[FoundMessage]:
        """Yield the requested messages, in time order."""
        del chunk, fetched  # there is only one chunk, which is read row by row
        channel_ids, since_ns, until_ns = wanted
        stamps_ns = self._rows['stamp_ns']
        last_ns = min(until_ns, LAST_NS)
        span = slice(stamps_ns.searchsorted(since_ns), stamps_ns.searchsorted(last_ns, 'right'))
        rows = self._rows[span]
        rows = rows[np.isin(rows['topic_id'], list(channel_ids))]
        done = 0
        for message in self._in_one_query(rows, channel_ids):
            yield message
            done += 1
        for row_id, topic_id, stamp_ns in rows[done:].tolist():
            data = self._data(row_id)
            if data is not None:
                yield stamp_ns, topic_id, data

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        if self._connection is not None:
            self._connection.close()
        self._left.close()

    def _all_stamps(self) -> Iterator[tuple[int, npt.NDArray[np.int64]]]:
        # Sorted once: a search for each topic takes time with the square of their number.
        order = self._rows['topic_id'].argsort(kind='stable')
        stamps = self._rows['stamp_ns'][order]
        ids, starts = np.unique(self._rows['topic_id'][order], return_index=True)
        by_topic = dict(zip(ids.tolist(), np.split(stamps, starts[1:]), strict=False))
        for topic_id in self.channels:
            yield topic_id, by_topic.get(topic_id, stamps[:0])

    def _lose(self, text: str, messages: int | None) -> None:
        self._problems.lose(f'{self._name}: {text}', messages)

    def _chunk(self) -> Chunk:
        stamps = self._rows['stamp_ns']
        ids, counts = np.unique(self._rows['topic_id'], return_counts=True)
        by_topic = dict(zip(ids.tolist(), counts.tolist(), strict=True))
        return Chunk(int(stamps[0]), int(stamps[-1]), 0, len(stamps), by_topic)

    def _open(self, path: Path) -> npt.NDArray[np.void]:
        """Read id, topic and stamp of every readable row, by id; set the channels.

        Raises:
            LimitError: There are too many topics or rows.
            ValueError: There are no topics.
        """
        size = self._file.size
        if size < self._pages.expected:
            self._lose(f'cut off at byte {size} of {self._pages.expected}', None)
        else:
            try:
                self._connection = self._connect(path)
                self.channels = stored_topics(self._connection, self._limits.descriptions())
                return _listed_rows(self._connection, self._limits)
            except LimitError:
                raise
            except _ERRORS as error:
                if self._connection is not None:
                    self._connection.close()
                    self._connection = None
                self._lose(f'is damaged ({one_line(str(error))})', None)
        self.channels = scanned_topics(self._pages, self._limits.descriptions())
        if not self.channels:
            raise ValueError('it has no list of topics')
        return self._scanned_rows()

    def _connect(self, path: Path) -> sqlite3.Connection:
        """Open the database read-only.

        Raises:
            sqlite3.Error: The database cannot be opened.
            ValueError: It has views in place of tables.
        """
        mode = 'immutable=1'
        wal = path.with_name(f'{path.name}-wal')
        if wal.is_file() and wal.stat().st_size:
            self._lose(f'its recorder did not close it; what {wal.name} adds is read', 0)
            mode = 'mode=ro'
            self._size += wal.stat().st_size
            self._limits = FileLimits(self._size)
            shared = path.with_name(f'{path.name}-shm')
            if not shared.exists():
                if not os.access(path.parent, os.W_OK):
                    path = self._copied(path, wal)
                else:
                    # SQLite creates and leaves it.
                    self._left.callback(shared.unlink, missing_ok=True)
        uri = f'file:{quote(os.fsencode(path.absolute()))}?{mode}'
        # Several threads may read, one at a time.
        connection = sqlite3.connect(
            uri, uri=True, check_same_thread=False, factory=GuardedConnection
        )
        try:
            connection.guard(min(self._size, self._limits.largest_part))
        except BaseException:
            connection.close()
            raise
        return connection

    def _copied(self, *files: Path) -> Path:
        """Copy a database and its log to where SQLite may create a file beside them.

        Raises:
            OSError: The disk has no room for the copy.
        """
        folder = Path(self._left.enter_context(TemporaryDirectory(prefix='kitti_ros2_')))
        try:
            for file in files:
                shutil.copyfile(file, folder / file.name)
        except OSError as error:
            self.close()
            error.filename = f'{self._name} (copied to {folder.parent})'
            raise
        return folder / files[0].name

    def _scanned_rows(self) -> npt.NDArray[np.void]:
        by_id = self._scanned()
        ids = np.array(sorted(by_id), dtype=np.int64)
        # Recorders number without gaps and delete nothing.
        for gap in np.flatnonzero(np.diff(ids) > 1).tolist():
            first, last = int(ids[gap]) + 1, int(ids[gap + 1]) - 1
            which = f'row {first}' if first == last else f'rows {first} to {last}'
            self._lose(f'{which} cannot be read', last - first + 1)
        rows = [(row_id, by_id[row_id].topic_id, by_id[row_id].stamp_ns) for row_id in ids.tolist()]
        return np.array(rows, _ROW)

    def _scanned(self) -> dict[int, MessageRow]:
        """Return the messages found in the pages, by the id of their row."""
        if self._by_id is None:
            self._by_id = {}
            try:
                for message in self._pages.messages():
                    self._by_id[message.row.row_id] = message
            except LimitError as error:
                self._lose(f'{error}; no more rows are read', None)
        return self._by_id

    def _in_one_query(
        self, rows: npt.NDArray[np.void], ids: Collection[int]
    ) -> Iterator[FoundMessage]:
        """Yield the messages of rows by the fastest query, up to the first damage."""
        if self._connection is None or not len(rows):
            return
        # The database's index sorts the rows, unless they are stored in order.
        query = _IN_ORDER if (np.diff(rows['id']) > 0).all() else _TO_SORT
        if query is _IN_ORDER and len(rows) <= _FEW:
            query, ids = _BY_ID, rows['id'].tolist()
        query = query.format(', '.join('?' * len(ids)))
        is_skimmed = self.is_start_enough is not None and _READS_PARTS and not self.whole_chunks
        largest = _LARGE - 1 if is_skimmed else self._size
        done = advised = 0
        with suppress(sqlite3.Error):
            cursor = self._connection.execute(query, [largest, *ids, int(rows['stamp_ns'][0])])
            for (row_id, topic_id, stamp_ns), (found_id, size, data) in zip(
                rows.tolist(), cursor, strict=False
            ):
                # SQLite reads zeros behind the end of a file that was cut meanwhile.
                if found_id != row_id or self._file.is_cut():
                    return
                if is_skimmed and size is not None and largest < size <= self._size:
                    yield stamp_ns, topic_id, UnreadMessage(partial(self._large, row_id, topic_id))
                    continue
                if not isinstance(data, bytes):
                    return
                # Rows stored in order lie about as far in the file as their data together.
                done += len(data)
                if done >= advised and not is_skimmed:
                    self._file.expect(done + _ADVISED_BYTES, _ADVISED_BYTES)
                    advised = done + _ADVISED_BYTES
                yield stamp_ns, topic_id, data

    def _large(self, row_id: int, topic_id: int) -> bytes | None:
        """Read the data of a row, or its start where that is enough."""
        data = b''
        if sys.version_info >= (3, 11) and self._connection is not None:
            connection = self._connection
            with (
                suppress(sqlite3.Error),
                connection.blobopen(*_BLOB, row_id, readonly=True) as blob,
            ):
                data = blob.read(START_BYTES)
                if self._wants_start(topic_id, data):
                    data = MessageStart.of(data, len(blob))
                else:
                    data += blob.read()
        return data if data and not self._file.is_cut() else self._data(row_id)

    def _data(self, row_id: int) -> bytes | None:
        message = self._scanned().get(row_id)
        if message is None:
            self._lose(f'row {row_id} cannot be read', 1)
            return None
        try:
            return self._pages.data(message)
        except ValueError as error:
            self._lose(f'row {row_id} cannot be read ({error})', 1)
            return None


def _listed_rows(connection: sqlite3.Connection, limits: FileLimits) -> npt.NDArray[np.void]:
    """Read id, topic and stamp of all rows, by id.

    Raises:
        LimitError: There are too many.
        sqlite3.Error, TypeError, ValueError, OverflowError: The table is damaged.
    """
    query = 'SELECT id, topic_id, timestamp FROM messages NOT INDEXED ORDER BY id LIMIT ?'
    rows = np.fromiter(connection.execute(query, [limits.most_records + 1]), _ROW)
    limits.add_records(0, len(rows))
    if (np.diff(rows['id']) <= 0).any():
        raise ValueError('its rows are not in order')
    return rows
