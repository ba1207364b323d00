# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 .db3 file open for reading, even if it is truncated or damaged.

All rows are listed first, without their data, and sorted by time. Their data are read by one query
up to the first failure, then from the file's pages.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np

from ..files.remote import is_remote
from ..model.errors import BadBagError
from ..model.text import one_line
from .limits import FileLimits, LimitError
from .pieces import BagFile, FileBytes, Piece
from .sqlite_connection import GuardedConnection
from .sqlite_rows import QueriedRows
from .sqlite_scan import Pages
from .sqlite_topics import scanned_topics, stored_topics

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    import numpy.typing as npt

    from .findings import Findings
    from .pieces import FetchedPiece, NamedFile, StoredMessage
    from .sqlite_scan import MessageRow

_ROW = np.dtype([('id', '<i8'), ('topic_id', '<i8'), ('stamp_ns', '<i8')])
_ERRORS = (sqlite3.Error, TypeError, ValueError, OverflowError)


class SqliteFile(BagFile):
    """A .db3 file.

    Args:
        file: The file.
        findings: Damage is entered there.

    Attributes:
        channels: By the id of their row.
        pieces: All rows are one piece.
        compressions: Empty; rosbag2 compresses messages or whole files.

    Raises:
        BadBagError: The file is no rosbag2 database.
        OSError: The file cannot be read.
    """

    def __init__(self, file: NamedFile, findings: Findings) -> None:
        if is_remote(file.path):
            raise BadBagError(
                file.name,
                'is a sqlite3 bag, which is read from a local disk only',
                'an MCAP file or a ROS 1 bag at a URL; copy it to this machine first',
            )
        self._name = file.name
        self._findings = findings
        self._file = FileBytes(file)
        self._connection: sqlite3.Connection | None = None
        self._by_id: dict[int, MessageRow] | None = None
        self._left = ExitStack()
        self._is_whole = True
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
        known = np.isin(rows['topic_id'], list(self.channels))
        if not known.all():
            count = int(np.count_nonzero(~known))
            self._lose(f'{count} messages are of topics that are not described', count)
            rows = rows[known]
        # Stable: equal stamps stay in the order of ids.
        self._rows = rows[np.argsort(rows['stamp_ns'], kind='stable')]
        self.pieces = [self._piece()] if len(rows) else []

    def read(
        self,
        piece: Piece,
        wanted: Collection[int],
        since_ns: int,
        fetched: FetchedPiece | None = None,
    ) -> Iterator[StoredMessage]:
        """Yield the messages of some topics from a stamp on, in time order."""
        del piece, fetched  # there is only one piece, which is read row by row
        rows = self._rows[np.searchsorted(self._rows['stamp_ns'], since_ns) :]
        rows = rows[np.isin(rows['topic_id'], list(wanted))]
        done = 0
        for message in self._in_one_query(rows, wanted):
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
        self._findings.lose(f'{self._name}: {text}', messages)

    def _piece(self) -> Piece:
        stamps = self._rows['stamp_ns']
        ids, counts = np.unique(self._rows['topic_id'], return_counts=True)
        by_topic = dict(zip(ids.tolist(), counts.tolist(), strict=True))
        return Piece(int(stamps[0]), int(stamps[-1]), 0, len(stamps), by_topic)

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
            self._is_whole = False
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
        found = self._scanned()
        ids = np.array(sorted(found), dtype=np.int64)
        # Recorders number without gaps and delete nothing.
        for gap in np.flatnonzero(np.diff(ids) > 1).tolist():
            first, last = int(ids[gap]) + 1, int(ids[gap + 1]) - 1
            which = f'row {first}' if first == last else f'rows {first} to {last}'
            self._lose(f'{which} cannot be read', last - first + 1)
        rows = [(row_id, found[row_id].topic_id, found[row_id].stamp_ns) for row_id in ids.tolist()]
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
        self, rows: npt.NDArray[np.void], wanted: Collection[int]
    ) -> Iterator[StoredMessage]:
        """Yield the messages of rows by the fastest query, up to the first damage."""
        if self._connection is None or not len(rows):
            return
        with (
            suppress(sqlite3.Error),
            QueriedRows(
                self._connection,
                self._file,
                self._pages,
                self._size,
                in_pages=self._is_whole,
                is_start_enough=self.is_start_enough,
            ) as queried,
        ):
            yield from queried.read(rows, wanted)

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
