# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a rosbag2 database as a query gives them.

Of large data the query tells the size only: they are read by the table's tree, unless that fails
where SQLite succeeds. Where their start is enough, threads read ahead. Whole data they would read
no faster: they would wait for each other's new memory.
"""

from __future__ import annotations

import sqlite3
import threading
from collections import deque
from contextlib import suppress
from itertools import repeat
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.workers import SpareThreads
from .decompressors import ZSTD_MAGIC
from .sqlite_tree import TableTree

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
    from typing import TypeGuard

    import numpy.typing as npt
    from typing_extensions import Self

    from ..files.threads import ThreadTask
    from .pieces import Buffer, FileBytes, StoredMessage
    from .sqlite_scan import Pages

# SQLite does not read data of which it needs type and length only.
_DATA = (
    "SELECT id, CASE WHEN typeof(data) = 'blob' AND length(data) >= 65536 THEN NULL ELSE data END,"
    ' length(data)'
    ' FROM messages {} WHERE topic_id IN ({}) AND timestamp >= ? ORDER BY {}'
)
_ONE = 'SELECT data FROM messages WHERE id = ?'
_ROOT = "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = 'messages'"
_IN_ORDER = _DATA.format('NOT INDEXED', '{}', 'id')
_TO_SORT = _DATA.format('', '{}', 'timestamp, id')
# A thread reads a batch at a time: handing one over costs as much as reading some 100 kB.
_BATCH_BYTES = 2**22
_AHEAD = 3
_LEAST_AHEAD = 400_000  # bytes; with less to read at once, threads wait for each other
_ROW_BYTES = 2**12  # of a row besides its data, generously
_ADVISED_BYTES = 2**22


class _FoundRow(NamedTuple):
    """A row without its data if they are large: None."""

    row_id: int
    topic_id: int
    stamp_ns: int
    size: int
    data: bytes | None


class QueriedRows:
    """The rows of a table of messages, by the fastest query; a context manager.

    Args:
        connection: To the database.
        file: The database.
        pages: Its pages.
        size: Of the file and the log beside it, in bytes.
        in_pages: Whether the file holds all of the table.
        is_start_enough: As in BagFile.

    Raises:
        sqlite3.Error: The database cannot be read.
    """

    def __init__(
        self,
        connection: sqlite3.Connection,
        file: FileBytes,
        pages: Pages,
        size: int,
        *,
        in_pages: bool,
        is_start_enough: Callable[[int], bool] | None,
    ) -> None:
        self._connection = connection
        self._file = file
        self._pages = pages
        self._size = size
        self._is_start_enough = is_start_enough or (lambda _: False)
        found = connection.execute(_ROOT).fetchone() if in_pages else None
        self._root: int | None = found[0] if found else None
        self._of_thread = threading.local()
        self._threads = SpareThreads()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.close()

    def read(self, rows: npt.NDArray[np.void], wanted: Collection[int]) -> Iterator[StoredMessage]:
        """Yield the messages of rows, up to the first damage.

        Args:
            rows: (N,) with id, topic_id and stamp_ns, in time order: those of some topics from a
                stamp on, one at least.
            wanted: The ids of the topics.

        Raises:
            sqlite3.Error: The damage, where SQLite finds it.
        """
        for row, read in self._in_turn(_batches(self._queried(rows, wanted))):
            data = self._data(row, read)
            if data is None:
                return
            yield row.stamp_ns, row.topic_id, data

    def _in_turn(
        self, batches: Iterable[Sequence[_FoundRow]]
    ) -> Iterator[tuple[_FoundRow, Buffer | None]]:
        """Yield rows with what threads have read of them, a few batches ahead.

        Their number grows with the batches taken: who wants the first message only does not wait
        for others.
        """
        waiting: deque[tuple[Sequence[_FoundRow], ThreadTask[list[Buffer | None]] | None]] = deque()
        most = 0
        for batch in batches:
            waiting.append((batch, self._request(batch) if most else None))
            if len(waiting) > most:
                yield from _with_data(*waiting.popleft())
                most = min(most + 1, _AHEAD)
        while waiting:
            yield from _with_data(*waiting.popleft())

    def _request(self, batch: Sequence[_FoundRow]) -> ThreadTask[list[Buffer | None]] | None:
        """Have a thread read the starts of the large data among rows, where these are enough."""
        wanted = [
            row
            if row.data is None and row.size >= _LEAST_AHEAD and self._is_start_enough(row.topic_id)
            else None
            for row in batch
        ]
        return self._threads.submit(self._read_starts, wanted) if any(wanted) else None

    def _read_starts(self, rows: Sequence[_FoundRow | None]) -> list[Buffer | None]:
        return [row and self._in_pages(row, start_only=True) for row in rows]

    def _queried(self, rows: npt.NDArray[np.void], wanted: Collection[int]) -> Iterator[_FoundRow]:
        """Yield rows as SQLite finds them, up to the first damage."""
        # The database's index sorts the rows, unless they are stored in order.
        query = _IN_ORDER if (np.diff(rows['id']) > 0).all() else _TO_SORT
        query = query.format(', '.join('?' * len(wanted)))
        done = advised = 0
        with suppress(sqlite3.Error):
            found = self._connection.execute(query, [*wanted, int(rows['stamp_ns'][0])])
            for (row_id, topic_id, stamp_ns), (found_id, data, size) in zip(
                rows.tolist(), found, strict=False
            ):
                if found_id != row_id or not isinstance(size, int):
                    return
                # Rows stored in order lie about as far in the file as their data together.
                done += size
                if done >= advised:
                    self._file.expect(done + _ADVISED_BYTES, _ADVISED_BYTES)
                    advised = done + _ADVISED_BYTES
                row = _FoundRow(row_id, topic_id, stamp_ns, size, data)
                if (data is None and size <= self._size) or self._is_sound(data):
                    yield row
                else:
                    return

    def _is_sound(self, data: object) -> TypeGuard[bytes]:
        """Whether SQLite gave data, and not zeros since the file was truncated meanwhile."""
        return isinstance(data, bytes) and not self._file.is_cut()

    def _data(self, row: _FoundRow, ahead: Buffer | None) -> Buffer | None:
        """Return the data of a row, or their MessageStart; None if they cannot be read.

        Args:
            row: The row.
            ahead: Its MessageStart, or all its data, as a thread has read them; None if none has.

        Raises:
            sqlite3.Error: They cannot be read.
            OSError: The disk refuses.
        """
        if row.data is not None:
            return row.data
        start_only = self._is_start_enough(row.topic_id)  # at its turn it may not be any more
        data = ahead if start_only else None
        if data is None:
            data = self._in_pages(row, start_only=start_only)
        if data is not None:
            return data
        found = self._connection.execute(_ONE, [row.row_id]).fetchone()
        return found[0] if found and self._is_sound(found[0]) else None

    def _in_pages(self, row: _FoundRow, *, start_only: bool) -> Buffer | None:
        """Read large data from the file's pages, on any thread; None if they are not there.

        Raises:
            OSError: The disk refuses.
        """
        if self._root is None:
            return None
        tree: TableTree | None = getattr(self._of_thread, 'tree', None)
        if tree is None:
            tree = self._of_thread.tree = TableTree(self._file, self._pages, self._root)
        with suppress(ValueError):
            start = tree.start(row.row_id, row.size) if start_only else None
            # What rosbag2 compressed is read whole.
            if start is None or start[:4] == ZSTD_MAGIC:
                return tree.blob(row.row_id, row.size)
            return start
        return None


def _with_data(
    batch: Sequence[_FoundRow], ahead: ThreadTask[list[Buffer | None]] | None
) -> Iterable[tuple[_FoundRow, Buffer | None]]:
    # What a thread could not read is tried again in turn, where errors are handled.
    read = ahead is not None and not ahead.error()
    return zip(batch, ahead.result() if ahead and read else repeat(None), strict=False)


def _batches(rows: Iterable[_FoundRow]) -> Iterator[Sequence[_FoundRow]]:
    """Split rows into batches: one row, then twice as much each time, up to a size in bytes."""
    batch: list[_FoundRow] = []
    size, least = 0, 1
    for row in rows:
        batch.append(row)
        size += row.size + _ROW_BYTES
        if size >= least:
            yield batch
            batch, size, least = [], 0, min(2 * size, _BATCH_BYTES)
    yield batch
