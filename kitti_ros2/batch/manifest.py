# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of a collection: a SQLite file in the output folder, one row for each job.

One process writes it, with a rollback journal: a write-ahead log needs shared memory, which network
file systems do not have. Changes are transactions, so that a killed process leaves the state before
or after one. The end of a job and the start of the next are one transaction, and the journal is
truncated, not removed: this takes 2 calls of fdatasync for a job, not 6.

After a power cut the file is whole: with synchronous = NORMAL, SQLite syncs the journal before it
changes the file, and the file before it truncates the journal. Only the truncation is not synced,
so that the last transaction may be undone, and its job is run again. Closing syncs the folder:
then the journal is gone for good, and nothing can be undone. Source: sqlite.org/atomiccommit.html.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import tempfile
import time
from collections import Counter
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.local_files import sync_folders
from ..files.local_staging import lock_exclusively, make_folder, remove_leftovers, reported
from ..files.remote import is_remote
from ..files.remote_requests import objects_at, read_object, refuse_read_only, write_object
from ..model.errors import BadFileError, MissingPathError, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from typing_extensions import Self

    from ..files.remote import RemotePath
    from ..files.uploads import StoreLock
    from .pool import JobResult


# The SQLite file of a manifest: its tables, checks and errors.

_VERSION = 1  # version of the tables, in user_version
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
    """Refuse a database of another program, or of another version of these tables."""
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


def _no_manifest(path: Path, reason: str) -> BadFileError:
    return BadFileError(
        path, reason, 'the manifest of a collection', remedy='choose another OUT, or move it away'
    )


MANIFEST = 'manifest.sqlite'
TODO, RUNNING, DONE, FAILED = STATES = ('todo', 'running', 'done', 'failed')


@dataclass(frozen=True)
class Identity:
    """The inputs of the output of a job.

    Attributes:
        source: The folder of the job.
        input: Fingerprint of its files.
        options: The command with its options, as JSON.
        version: Version of this package.
    """

    source: str
    input: str
    options: str
    version: str


@dataclass(frozen=True)
class JobRecord:
    """The row of a job.

    Attributes:
        name: Name of the job.
        state: State, one of STATES.
        identity: Identity of the last run of the job.
        ours: True if a run in this manifest wrote its output.
        counts: Number of written frames, messages, bytes.
        bad: Number of skipped samples and files.
        losses: First few reasons for skipping.
        reason: Reason of failure.
        seconds: Time taken.
        attempts: Number of starts with this identity.
        run: Number of the last run with a change of it.
        ended: Time of the end or failure, seconds since 1970; None before.
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

    def begin(self, command: str, workers: int) -> None:
        """Begin a run; jobs left running by a killed run are to do again."""
        with self._transaction():
            cursor = self._database.execute(
                'INSERT INTO runs (command, jobs, started) VALUES (?, ?, ?)',
                (command, workers, time.time()),
            )
            self._run = cursor.lastrowid or 0
            self._database.execute('UPDATE units SET state = ? WHERE state = ?', (TODO, RUNNING))

    def add(self, jobs: Mapping[str, str]) -> None:
        """Add jobs, name to source; existing ones are unchanged."""
        with self._transaction():
            self._database.executemany(
                'INSERT OR IGNORE INTO units (name, source, state) VALUES (?, ?, ?)',
                [(name, source, TODO) for name, source in jobs.items()],
            )

    def claim(self, names: Iterable[str]) -> None:
        """Record that the outputs of jobs are absent, so that later ones are of a known run."""
        with self._transaction():
            self._database.executemany(
                'UPDATE units SET ours = 1 WHERE name = ?', [(name,) for name in names]
            )

    def records(self) -> dict[str, JobRecord]:
        """Return all jobs by name."""
        with manifest_errors(self._path):
            return _records(self._database)

    def start(self, name: str, identity: Identity, *, attempt: int, ours: bool) -> None:
        """Record the start of a job, and commit all results."""
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

    def end(self, name: str, result: JobResult) -> None:
        """Record the result of a job; the next start, flush or release commits it."""
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
        """Commit the results of jobs that have ended."""
        if self._database.in_transaction:
            with self._transaction():
                pass

    def release(self) -> None:
        """Record that no job is running: the rest is to do."""
        with self._transaction():
            self._database.execute('UPDATE units SET state = ? WHERE state = ?', (TODO, RUNNING))

    def close(self) -> None:
        """Close the file and remove the empty journal; commits outlast a power cut.

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
        """Begin a transaction, or continue the open one."""
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


def read_manifest(folder: Path) -> tuple[list[JobRecord], CollectionRun | None]:
    """Return the jobs in the manifest of a folder by name, and its last run.

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


def _records(database: sqlite3.Connection) -> dict[str, JobRecord]:
    rows = database.execute(
        'SELECT name, state, source, input, options, version, ours, counts, bad, losses, reason,'
        ' seconds, attempts, run, ended FROM units ORDER BY name'
    )
    return {row[0]: _record(row) for row in rows}


def _record(row: tuple[Any, ...]) -> JobRecord:
    name, state, *identity, ours, counts, bad, losses, reason, seconds, attempts, run, ended = row
    return JobRecord(
        name, state, Identity(*identity), bool(ours), json.loads(counts), bad,
        tuple(json.loads(losses)), reason, seconds, attempts, run, ended,
    )  # fmt: skip


# The progress and pace of a collection.


@dataclass(frozen=True)
class Pace:
    """The progress and pace of a collection.

    Attributes:
        states: Number of jobs by state, for all STATES.
        lossy: Number of jobs that are done with losses.
        bad: Number of skipped samples and files.
        frames, messages, bytes: Sums over jobs that are done.
        unit_seconds: Sum of the times of jobs, also of parallel ones.
        recent: Number of jobs ended by the last run.
        recent_seconds: Time from the start of the last run to the end of its last job.
        recent_bytes: Bytes written by these.
        seconds_left: Estimate for the remaining jobs; None without a measured one.
    """

    states: dict[str, int]
    lossy: int
    bad: int
    frames: int
    messages: int
    bytes: int
    unit_seconds: float
    recent: int
    recent_seconds: float
    recent_bytes: int
    seconds_left: float | None

    @property
    def left(self) -> int:
        """Number of jobs that are neither done nor failed."""
        return self.states[TODO] + self.states[RUNNING]


def measure_pace(records: Sequence[JobRecord], run: CollectionRun | None) -> Pace:
    """Summarize the jobs of a manifest and its last run."""
    states = dict.fromkeys((TODO, RUNNING, DONE, FAILED), 0)
    states.update(Counter(record.state for record in records))
    totals: Counter[str] = Counter()
    for record in records:
        totals.update(record.counts)
    recent = [record for record in records if run and record.run == run.number and record.ended]
    ends = [record.ended for record in recent if record.ended is not None]
    # A clock set back gives no rate.
    seconds = max(0.0, max(ends) - run.started) if run and ends else 0.0
    remaining = states[TODO] + states[RUNNING]
    return Pace(
        states=states,
        lossy=sum(record.state == DONE and record.bad > 0 for record in records),
        bad=totals_bad(records),
        frames=totals['frames'],
        messages=totals['messages'],
        bytes=totals['bytes'],
        unit_seconds=sum(record.seconds for record in records),
        recent=len(recent),
        recent_seconds=seconds,
        recent_bytes=sum(record.counts.get('bytes', 0) for record in recent),
        seconds_left=remaining * seconds / len(recent) if recent and seconds else None,
    )


def totals_bad(records: Sequence[JobRecord]) -> int:
    """Return the number of skipped samples and files."""
    return sum(record.bad for record in records)


# The folder of a collection's outputs and manifest, local or in a store.
#
# SQLite needs a file. The manifest of a collection in a store is kept in a local state folder,
# fetched from OUT/manifest.sqlite at the start, and put back every few seconds and at the end.
# If the store has the manifest that this machine put there last, the state folder is newer: a run
# after a killed one continues from it.

_LOCK = f'.{MANIFEST}.lock'
_PUT_BACK = 'put_back'
"""File of the state folder: SHA-256 of the manifest as this machine put it into the store last."""
_COPY = f'{MANIFEST}.copy'
_SAVE_S = 10.0
_LOCK_WAIT_S = 5.0
_LOCK_POLL_S = 0.05


class OutFolder:
    """A local folder of outputs, locked against other runs.

    Attributes:
        folder: Folder of the manifest.
        lock: Descriptor of the lock, which ends with the last process that has it open.
    """

    def __init__(self, folder: Path, lock: int) -> None:
        self.folder = folder
        self.lock = lock

    def has(self, out: Path) -> bool:
        """Return whether an output exists."""
        return os.path.lexists(out)

    def remove_leftovers(self, out: Path) -> None:
        """Remove temporary files of an earlier run beside an output."""
        remove_leftovers(out)

    def absent(self, outs: Iterable[Path]) -> list[Path]:  # noqa: ARG002 - as StoreOutFolder
        """Return the outputs to claim beforehand: none, as starts are recorded at once."""
        return []

    def make_room(self, out: Path) -> None:
        """Make the folder of an output.

        Raises:
            OutputError: The disk refuses.
        """
        with reported(out):
            # Here, as a failing worker would remove a folder that another one needs.
            make_folder(out.parent)

    def changed(self) -> None:
        """Handle a change of the manifest."""

    def save(self) -> None:
        """Do nothing: the manifest is in its folder."""


class StoreOutFolder(OutFolder):
    """A folder of a store, locked against other runs as far as the store allows.

    Args:
        out: The folder.
        folder: The local state folder.
        lock: Descriptor, as OutFolder.lock.
        store_lock: The lock in the store.
    """

    def __init__(self, out: RemotePath, folder: Path, lock: int, store_lock: StoreLock) -> None:
        super().__init__(folder, lock)
        self._out = out
        self._store_lock = store_lock
        self._saved = time.monotonic()
        self._names = _complete_names(objects_at(out))
        self._fetch()

    def has(self, out: Path) -> bool:
        """Return whether an output existed at the start of the run."""
        return out.relative_to(self._out).as_posix() in self._names

    def remove_leftovers(self, out: Path) -> None:
        """Do nothing: objects without a marker are complete."""

    def absent(self, outs: Iterable[Path]) -> list[Path]:
        """Return the absent outputs.

        The store may get the manifest some time after an output, so all outputs of this run are
        recorded as its own beforehand.
        """
        return [out for out in outs if not self.has(out)]

    def make_room(self, out: Path) -> None:
        """Do nothing: stores have no folders."""

    def changed(self) -> None:
        """Put the manifest back, at intervals.

        Raises:
            OutputError: The store refuses, or another run has taken the lock.
        """
        self._store_lock.check()
        if time.monotonic() - self._saved >= _SAVE_S:
            self.save()

    def save(self) -> None:
        """Put the manifest back.

        Raises:
            OutputError: The store refuses, or another run has taken the lock.
        """
        self._store_lock.check()
        data = _snapshot(self.folder / MANIFEST)
        if data is None:
            return
        write_object(self._out / MANIFEST, data)
        (self.folder / _PUT_BACK).write_text(hashlib.sha256(data).hexdigest())
        self._saved = time.monotonic()

    def _fetch(self) -> None:
        """Take the manifest from the store, unless this machine's is newer."""
        local, put_back = self.folder / MANIFEST, self.folder / _PUT_BACK
        data = read_object(self._out / MANIFEST)
        digest = put_back.read_text() if put_back.is_file() else ''
        if data is not None and local.is_file() and hashlib.sha256(data).hexdigest() == digest:
            return
        for path in (local, local.with_name(f'{MANIFEST}-journal'), put_back):
            path.unlink(missing_ok=True)
        if data is not None:
            local.write_bytes(data)


@contextmanager
def open_out_folder(out: Path) -> Iterator[OutFolder]:
    """Lock a folder of outputs; its manifest is in a local folder.

    In a store, the manifest is put back at the end, also of a failed run.

    Args:
        out: The folder; a local one is created.

    Raises:
        OutputError: Another run is writing there, or the disk or the store refuses.
    """
    if not is_remote(out):
        with reported(out):
            make_folder(out)
        with _locked(out, out) as lock:
            yield OutFolder(out, lock)
        return
    refuse_read_only(out)
    folder = _state_folder(out)
    from ..files.uploads import locked_in_store  # noqa: PLC0415 - for URLs only

    with _locked(folder, out) as lock, locked_in_store(out / _LOCK) as store_lock:
        out_folder = StoreOutFolder(out, folder, lock, store_lock)
        try:
            yield out_folder
        except BaseException:
            with suppress(OutputError):
                out_folder.save()
            raise
        out_folder.save()


@contextmanager
def manifest_folder(out: Path) -> Iterator[Path]:
    """Yield a local folder with the manifest of a folder of outputs, for reading.

    Raises:
        MissingPathError: The manifest is missing.
        StoreError: The store does not respond.
    """
    if not is_remote(out):
        yield out
        return
    data = read_object(out / MANIFEST)
    if data is None:
        raise MissingPathError(out / MANIFEST)
    with tempfile.TemporaryDirectory(prefix='kitti_ros2-') as name:
        folder = Path(name)
        (folder / MANIFEST).write_bytes(data)
        yield folder


def _complete_names(objects: Iterable[str]) -> set[str]:
    """Return the names of objects and folders with complete uploads."""
    names: set[str] = set()
    for name in objects:
        while name and name not in names:
            names.add(name)
            name = name.rpartition('/')[0]  # noqa: PLW2901 - up to the top
    return {name for name in names if _marker_name(name) not in names}


def _marker_name(name: str) -> str:
    folder, slash, last = name.rpartition('/')
    return f'{folder}{slash}.{last}.partial'


def _snapshot(path: Path) -> bytes | None:
    """Return a database as of its last transaction; None if absent or being written."""
    if not path.is_file():
        return None
    target = path.with_name(_COPY)
    target.unlink(missing_ok=True)
    with (
        suppress(sqlite3.OperationalError),
        closing(sqlite3.connect(path, timeout=0)) as source,
        closing(sqlite3.connect(target)) as copy,
    ):
        source.backup(copy)
        copy.close()
        return target.read_bytes()
    return None


def _state_folder(out: RemotePath) -> Path:
    """Return the user's state folder for a URL, created if needed."""
    home = os.environ.get('XDG_STATE_HOME') or Path.home() / '.local' / 'state'
    name = hashlib.sha256(str(out).encode()).hexdigest()[:16]
    folder = Path(home, 'kitti_ros2', 'collections', name)
    with reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'url').write_text(f'{out}\n')
    return folder


@contextmanager
def _locked(folder: Path, out: Path) -> Iterator[int]:
    """Lock a folder against other runs; yield the descriptor of the lock."""
    with reported(folder):
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        _wait_for(lambda: lock_exclusively(lock, out))
        yield lock
    finally:
        os.close(lock)


def _wait_for(acquire: Callable[[], None]) -> None:
    """Acquire a lock that workers of a killed run may hold for a short time."""
    end = time.monotonic() + _LOCK_WAIT_S
    while True:
        try:
            return acquire()
        except OutputError:
            if time.monotonic() > end:
                raise
        time.sleep(_LOCK_POLL_S)
