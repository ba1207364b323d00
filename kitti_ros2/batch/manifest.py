# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of a collection: a SQLite file in the output folder, one row for each unit.

One process writes it. A rollback journal, not a write-ahead log: that needs shared memory, which
network file systems do not have. Changes are transactions, so that a killed process leaves the
state before or after one. The end of a unit and the start of the next are one transaction, and the
journal is truncated, not removed: this takes 2 calls of fdatasync for a unit, not 6.

After a power cut the file is whole: with synchronous = NORMAL, SQLite syncs the journal before it
changes the file, and the file before it truncates the journal. Only the truncation is not synced,
so that the last transaction may be undone, and its unit is run again. Closing syncs the folder:
then the journal is gone for good, and nothing can be undone. Source: sqlite.org/atomiccommit.html.
"""

from __future__ import annotations

import json
import sqlite3
import time
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..files.durability import sync_folders
from ..model.errors import MissingPathError
from .manifest_file import check, connect, create_tables, manifest_errors, version_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from typing_extensions import Self

    from .results import UnitResult

MANIFEST = 'manifest.sqlite'
TODO, RUNNING, DONE, FAILED = STATES = ('todo', 'running', 'done', 'failed')


@dataclass(frozen=True)
class Identity:
    """What the output of a unit depends on.

    Attributes:
        source: The folder of the unit.
        input: Fingerprint of its files.
        options: The command with its options, as JSON.
        version: Of this package.
    """

    source: str
    input: str
    options: str
    version: str


@dataclass(frozen=True)
class UnitRecord:
    """The row of a unit.

    Attributes:
        name: Of the unit.
        state: One of STATES.
        identity: Of the last run of the unit.
        ours: Whether what is at its output was written by a run that this manifest knows.
        counts: What was written: frames, messages, bytes.
        bad: Number of samples and files that were skipped.
        losses: What was skipped, the first few reasons.
        reason: Why it failed.
        seconds: Time taken.
        attempts: How often it was begun with this identity.
        run: Number of the last run that changed it.
        ended: When it was done or failed, seconds since 1970; None before.
    """

    name: str
    state: str
    identity: Identity
    ours: bool = False
    counts: Mapping[str, int] = field(default_factory=dict)
    bad: int = 0
    losses: tuple[str, ...] = ()
    reason: str = ''
    seconds: float = 0.0
    attempts: int = 0
    run: int = 0
    ended: float | None = None


@dataclass(frozen=True)
class CollectionRun:
    """A run over the collection: number, command, worker processes, start (seconds since 1970)."""

    number: int
    command: str
    jobs: int
    started: float


class Manifest:
    """The manifest of an output folder, open for writing by one process.

    Args:
        folder: The output folder.

    Raises:
        BadFileError: The file is no manifest.
        OSError: It cannot be written, or another program has locked it.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / MANIFEST
        self._run = 0
        self._database = connect(self._path)
        try:
            with manifest_errors(self._path):
                self._database.execute('PRAGMA journal_mode = TRUNCATE')
                self._database.execute('PRAGMA synchronous = NORMAL')
                self._create()
        except BaseException:
            self._database.close()
            raise

    @property
    def command(self) -> str | None:
        """The command of the last run; None before the first."""
        with manifest_errors(self._path):
            row = self._database.execute('SELECT command FROM runs ORDER BY run DESC').fetchone()
        return None if row is None else str(row[0])

    def begin(self, command: str, jobs: int) -> None:
        """Begin a run. Units that a killed run left running are to do again."""
        with self._transaction():
            cursor = self._database.execute(
                'INSERT INTO runs (command, jobs, started) VALUES (?, ?, ?)',
                (command, jobs, time.time()),
            )
            self._run = cursor.lastrowid or 0
            self._database.execute('UPDATE units SET state = ? WHERE state = ?', (TODO, RUNNING))

    def add(self, units: Mapping[str, str]) -> None:
        """Add units, name to source; those that are known stay as they are."""
        with self._transaction():
            self._database.executemany(
                'INSERT OR IGNORE INTO units (name, source, state) VALUES (?, ?, ?)',
                [(name, source, TODO) for name, source in units.items()],
            )

    def claim(self, names: Iterable[str]) -> None:
        """Record that nothing is at the outputs of units: what will be there is of a known run."""
        with self._transaction():
            self._database.executemany(
                'UPDATE units SET ours = 1 WHERE name = ?', [(name,) for name in names]
            )

    def records(self) -> dict[str, UnitRecord]:
        """Return all units by name."""
        with manifest_errors(self._path):
            return _records(self._database)

    def start(self, name: str, identity: Identity, *, attempt: int, ours: bool) -> None:
        """Record that a unit is running, with all results that are not yet committed."""
        with self._transaction():
            self._database.execute(
                'UPDATE units SET state = ?, source = ?, input = ?, options = ?, version = ?,'
                " ours = ?, attempts = ?, run = ?, counts = '{}', bad = 0, losses = '[]',"
                " reason = '', seconds = 0, ended = NULL WHERE name = ?",
                (
                    RUNNING, identity.source, identity.input, identity.options, identity.version,
                    ours, attempt, self._run, name,
                ),
            )  # fmt: skip

    def end(self, name: str, result: UnitResult) -> None:
        """Record the result of a unit; the next start, flush or release commits it."""
        with self._transaction(commit=False):
            self._database.execute(
                'UPDATE units SET state = ?, ours = (ours OR ?), counts = ?, bad = ?, losses = ?,'
                ' reason = ?, seconds = ?, ended = ?, run = ? WHERE name = ?',
                (
                    FAILED if result.failed else DONE, not result.failed,
                    json.dumps(dict(result.counts)), result.bad, json.dumps(result.losses),
                    result.reason, result.seconds, time.time(), self._run, name,
                ),
            )  # fmt: skip

    def flush(self) -> None:
        """Commit the results of units that have ended."""
        if self._database.in_transaction:
            with self._transaction():
                pass

    def release(self) -> None:
        """Record that no unit is running any more: the rest is to do."""
        with self._transaction():
            self._database.execute('UPDATE units SET state = ? WHERE state = ?', (TODO, RUNNING))

    def close(self) -> None:
        """Close the file and remove the empty journal; what was committed outlasts a power cut.

        Raises:
            OSError: The disk refuses.
        """
        try:
            with suppress(sqlite3.Error):
                self._database.execute('PRAGMA journal_mode = DELETE')
        finally:
            self._database.close()
        sync_folders([self._path.parent])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _create(self) -> None:
        check(self._database, self._path)
        if version_of(self._database) == 0:
            create_tables(self._database)

    @contextmanager
    def _transaction(self, *, commit: bool = True) -> Iterator[None]:
        """Begin a transaction, or continue the one that is open."""
        with manifest_errors(self._path):
            if not self._database.in_transaction:
                self._database.execute('BEGIN IMMEDIATE')
            try:
                yield
                if commit:
                    self._database.execute('COMMIT')
            except BaseException:
                if self._database.in_transaction:  # SQLite may have rolled back, as on a full disk
                    self._database.execute('ROLLBACK')
                raise


def read_manifest(folder: Path) -> tuple[list[UnitRecord], CollectionRun | None]:
    """Return the units in the manifest of a folder by name, and its last run.

    Raises:
        MissingPathError: The folder has no manifest.
        BadFileError: The file is no manifest.
        OSError: Another program has locked it, or the disk refuses.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise MissingPathError(path)
    with (
        manifest_errors(path),
        closing(connect(path)) as database,
    ):
        check(database, path)
        if version_of(database) == 0:
            return [], None
        row = database.execute(
            'SELECT run, command, jobs, started FROM runs ORDER BY run DESC LIMIT 1'
        ).fetchone()
        return list(_records(database).values()), None if row is None else CollectionRun(*row)


def _records(database: sqlite3.Connection) -> dict[str, UnitRecord]:
    rows = database.execute(
        'SELECT name, state, source, input, options, version, ours, counts, bad, losses, reason,'
        ' seconds, attempts, run, ended FROM units ORDER BY name'
    )
    return {row[0]: _record(row) for row in rows}


def _record(row: tuple[Any, ...]) -> UnitRecord:
    name, state, *identity, ours, counts, bad, losses, reason, seconds, attempts, run, ended = row
    return UnitRecord(
        name, state, Identity(*identity), bool(ours), json.loads(counts), bad,
        tuple(json.loads(losses)), reason, seconds, attempts, run, ended,
    )  # fmt: skip
