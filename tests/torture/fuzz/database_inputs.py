# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""SQLite databases as rosbag2 writes them: large rows, logs beside them, and damaged pages."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from functools import cache
from typing import TYPE_CHECKING

from .target import place

if TYPE_CHECKING:
    from pathlib import Path

_PAGE = 512
_LARGE = 66_000
_TOPICS = (
    'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,'
    ' offered_qos_profiles TEXT)'
)
_MESSAGES = (
    'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)'
)
_A_TOPIC = "INSERT INTO topics VALUES (1, '/t', 'std_msgs/msg/String', 'cdr', '')"
_ROW = 'INSERT INTO messages VALUES (?, 1, ?, ?)'


def _filled(path: Path, *pragmas: str, page: int = _PAGE) -> sqlite3.Connection:
    """A new database with a large row and many small ones, over inner pages."""
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path, isolation_level=None)
    for each in (f'page_size = {page}', *pragmas):
        database.execute(f'PRAGMA {each}').fetchall()
    database.execute('BEGIN')
    for each in (_TOPICS, _MESSAGES, _A_TOPIC):
        database.execute(each)
    hello = b'\0\1\0\0\6\0\0\0hello\0'
    rows = [(1, 1, bytes(_LARGE)), *((number, number, hello) for number in range(2, 300))]
    database.executemany(_ROW, rows)
    database.execute('COMMIT')
    return database


@cache
def large_rows(page: int = _PAGE) -> bytes:
    """Rows over many pages, which are read from the pages themselves."""
    path = place('large.db3')
    with closing(_filled(path, page=page)):
        pass
    return path.read_bytes()


def with_log(database: bytes, log: bytes) -> bytes:
    """A database and the log beside it as one input."""
    return struct.pack('<I', len(database)) + database + log


def without_log(data: bytes) -> tuple[bytes, bytes]:
    """The inverse of with_log."""
    (size,) = struct.unpack_from('<I', data.ljust(4, b'\0'))
    return data[4 : 4 + size], data[4 + size :]


def logged() -> list[bytes]:
    """Databases whose recorder did not close them, with a log that adds rows."""
    path = place('logged.db3')
    with closing(_filled(path, 'journal_mode = WAL', 'wal_autocheckpoint = 0')) as database:
        database.execute('PRAGMA wal_checkpoint')
        database.execute(_ROW, (1000, 1000, b'\0\1\0\0\1\0\0\0\0'))
        log = path.with_name(f'{path.name}-wal').read_bytes()
        return [with_log(path.read_bytes(), log), with_log(path.read_bytes(), log[:-9])]


def damaged() -> list[bytes]:
    """Databases with damage in the tree of messages, and in the chain of pages of the large row."""
    whole = large_rows()
    pages = [whole[at : at + _PAGE] for at in range(0, len(whole), _PAGE)]
    inner = [number for number, page in enumerate(pages) if number and page[0] == 5]
    chain = [number for number, page in enumerate(pages) if page[4:] == bytes(_PAGE - 4)]
    made = []
    for number in inner:
        for at, values in ((0, b'\x0d'), (0, b'\x02'), (3, b'\xff\xff'), (8, bytes(4)),
                           (12, b'\xff\xff'), (8, struct.pack('>I', number + 1))):  # fmt: skip
            made.append(_changed(whole, number * _PAGE + at, values))
    made += [
        _changed(whole, number * _PAGE, struct.pack('>I', link))
        for number in (chain[0], chain[len(chain) // 2], chain[-1])
        for link in (0, 1, number + 1, len(pages) + 9, 2**31)
    ]
    return [*made, whole[:-_PAGE], whole[: len(whole) // 2], _changed(whole, 120, b'\xff' * 9)]


def _changed(data: bytes, at: int, values: bytes) -> bytes:
    return data[:at] + values + data[at + len(values) :]


def _varint(value: int) -> bytes:
    found = [value & 0x7F]
    while value := value >> 7:
        found.append(value & 0x7F | 0x80)
    return bytes(reversed(found))


def endless(size: int) -> bytes:
    """A database with a row of any size, in bytes, whose last page is followed by itself."""
    path = place('endless.db3')
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute(f'PRAGMA page_size = {_PAGE}').fetchall()
        for each in (_TOPICS, _MESSAGES, _A_TOPIC):
            database.execute(each)
        database.execute(_ROW, (1, 1, b'\0' * 700))
        (root,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ).fetchone()
    data = path.read_bytes()
    kinds = b'\0\1\1' + _varint(12 + 2 * size)
    payload = _varint(len(kinds) + 1) + kinds + b'\1\1'
    total = len(payload) + size
    least = (_PAGE - 12) * 32 // 255 - 23
    local = least + (total - least) % (_PAGE - 4)
    local = local if local <= _PAGE - 35 else least
    circle = len(data) // _PAGE  # the last page, which becomes its own successor
    cell = _varint(total) + b'\1' + payload.ljust(local, b'\0') + struct.pack('>I', circle)
    start = _PAGE - len(cell)
    leaf = struct.pack('>BHHHBH', 13, 0, 1, start, 0, start)
    data = _changed(data, (root - 1) * _PAGE, leaf.ljust(start, b'\0') + cell)
    return _changed(data, (circle - 1) * _PAGE, struct.pack('>I', circle))
