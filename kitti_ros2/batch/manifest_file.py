# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The SQLite file of a manifest: its tables, checks and errors."""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..model.errors import BadFileError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_VERSION = 1  # of the tables, in user_version
_BUSY_S = 30.0
_TABLES = """
CREATE TABLE units (
    name TEXT PRIMARY KEY,
    source TEXT NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('todo', 'running', 'done', 'failed')),
    input TEXT NOT NULL DEFAULT '',
    options TEXT NOT NULL DEFAULT '',
    version TEXT NOT NULL DEFAULT '',
    ours INTEGER NOT NULL DEFAULT 0,
    counts TEXT NOT NULL DEFAULT '{}',
    bad INTEGER NOT NULL DEFAULT 0,
    losses TEXT NOT NULL DEFAULT '[]',
    reason TEXT NOT NULL DEFAULT '',
    seconds REAL NOT NULL DEFAULT 0,
    attempts INTEGER NOT NULL DEFAULT 0,
    run INTEGER NOT NULL DEFAULT 0,
    ended REAL
) WITHOUT ROWID;
CREATE TABLE runs (
    run INTEGER PRIMARY KEY,
    command TEXT NOT NULL,
    jobs INTEGER NOT NULL,
    started REAL NOT NULL
);
"""


def connect(path: Path) -> sqlite3.Connection:
    """Open a file, or create it; transactions are begun and committed by the caller.

    Raises:
        OSError: It cannot be opened.
    """
    with manifest_errors(path):
        return sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)


def version_of(database: sqlite3.Connection) -> int:
    """Return the version of the tables; 0 before they are created."""
    (version,) = database.execute('PRAGMA user_version').fetchone()
    return int(version)


def create_tables(database: sqlite3.Connection) -> None:
    """Create the tables."""
    database.executescript(f'BEGIN IMMEDIATE; {_TABLES} PRAGMA user_version = {_VERSION}; COMMIT;')


def check(database: sqlite3.Connection, path: Path) -> None:
    """Refuse a database of others, or of another version of these tables."""
    tables = {name for (name,) in database.execute('SELECT name FROM sqlite_master')}
    version = version_of(database)
    if version not in {0, _VERSION} or (version == 0 and tables):
        raise _no_manifest(path, f'is a database of version {version}')
    if version and not {'units', 'runs'} <= tables:
        raise _no_manifest(path, 'lacks its tables')
    pages, page = (database.execute(f'PRAGMA page_{of}').fetchone()[0] for of in ('count', 'size'))
    if path.stat().st_size < pages * page:
        raise _no_manifest(path, 'is truncated')


@contextmanager
def manifest_errors(path: Path) -> Iterator[None]:
    """Convert errors of SQLite about a file to one line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        locked = 'locked' in str(error)
        remedy = (
            'close the program that has it open'
            if locked
            else ('check the room on the disk and the permissions of the folder')
        )
        raise OSError(0, f'{error} (SQLite); {remedy}', str(path)) from error
    except (sqlite3.DatabaseError, ValueError) as error:
        raise _no_manifest(path, str(error)) from error


def _no_manifest(path: Path, found: str) -> BadFileError:
    return BadFileError(
        path, found, 'the manifest of a collection', remedy='choose another OUT, or move it away'
    )
