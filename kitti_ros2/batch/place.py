# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The place of a collection's outputs and manifest: a local folder, or a folder of a store.

SQLite needs a file. The manifest of a collection in a store is kept in a local state folder,
fetched from OUT/manifest.sqlite at the start, and put back every few seconds and at the end. Where
the state folder has what this machine put there last, it is newer than the store: a run that was
killed goes on from it.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
import tempfile
import time
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.output_paths import make_folder
from ..files.remote import is_remote
from ..files.staging import lock_exclusively, reported, sweep
from ..files.store_objects import (
    objects_at,
    read_object,
    refuse_read_only,
    write_object,
)
from ..model.errors import MissingPathError, OutputError
from .manifest import MANIFEST

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from ..files.remote import RemotePath
    from ..files.store_lock import StoreLock

_LOCK = f'.{MANIFEST}.lock'
_PUT_BACK = 'put_back'
"""File of the state folder: SHA-256 of the manifest as this machine put it into the store last."""
_COPY = f'{MANIFEST}.copy'
_SAVE_S = 10.0
_LOCK_WAIT_S = 5.0
_LOCK_POLL_S = 0.05


class LocalPlace:
    """A local folder of outputs, locked against other runs.

    Attributes:
        folder: Where the manifest is.
        lock: The descriptor that holds the lock; it ends with the last process that has it open.
    """

    def __init__(self, folder: Path, lock: int) -> None:
        self.folder = folder
        self.lock = lock

    def has(self, out: Path) -> bool:
        """Whether there is something at an output."""
        return os.path.lexists(out)

    def sweep(self, out: Path) -> None:
        """Remove what an earlier run has left beside an output that it made, or gave up."""
        sweep(out)

    def absent(self, outs: Iterable[Path]) -> list[Path]:  # noqa: ARG002 - as StorePlace
        """Return the outputs that a run may claim beforehand; here a start is recorded at once."""
        return []

    def make_room(self, out: Path) -> None:
        """Make the folder of an output.

        Raises:
            OutputError: The disk refuses.
        """
        with reported(out):
            # Here, as a worker that fails would remove a folder that another one counts on.
            make_folder(out.parent)

    def changed(self) -> None:
        """Take note that the manifest has changed."""

    def save(self) -> None:
        """Save the manifest; here it is where it belongs."""


class StorePlace(LocalPlace):
    """A folder of a store, locked against other runs as well as the store allows.

    Args:
        out: The folder.
        folder: The local state folder.
        lock: As LocalPlace.lock.
        held: The lock in the store.
    """

    def __init__(self, out: RemotePath, folder: Path, lock: int, held: StoreLock) -> None:
        super().__init__(folder, lock)
        self._out = out
        self._held = held
        self._saved = time.monotonic()
        self._names = _complete_names(objects_at(out))
        self._fetch()

    def has(self, out: Path) -> bool:
        """Whether there is something at an output, as listed at the start of the run."""
        return out.relative_to(self._out).as_posix() in self._names

    def sweep(self, out: Path) -> None:
        """Do nothing: what is in a store without its marker is complete."""

    def absent(self, outs: Iterable[Path]) -> list[Path]:
        """Return the outputs that are not there.

        The store may get the manifest some time after an output, so that all that this run may
        write are recorded as its own beforehand.
        """
        return [out for out in outs if not self.has(out)]

    def make_room(self, out: Path) -> None:
        """Do nothing: stores have no folders."""

    def changed(self) -> None:
        """Put the manifest back, not too often.

        Raises:
            OutputError: The store refuses, or another run has taken the lock.
        """
        self._held.check()
        if time.monotonic() - self._saved >= _SAVE_S:
            self.save()

    def save(self) -> None:
        """Put the manifest back.

        Raises:
            OutputError: The store refuses, or another run has taken the lock.
        """
        self._held.check()
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
        known = put_back.read_text() if put_back.is_file() else ''
        if data is not None and local.is_file() and hashlib.sha256(data).hexdigest() == known:
            return
        for path in (local, local.with_name(f'{MANIFEST}-journal'), put_back):
            path.unlink(missing_ok=True)
        if data is not None:
            local.write_bytes(data)


@contextmanager
def open_place(out: Path) -> Iterator[LocalPlace]:
    """Lock a folder of outputs, with its manifest in a local folder.

    In a store, the manifest is put back at the end, also of a run that fails.

    Args:
        out: The folder; a local one is made.

    Raises:
        OutputError: Another run is writing there, or the disk or the store refuses.
    """
    if not is_remote(out):
        with reported(out):
            make_folder(out)
        with _locked(out, out) as lock:
            yield LocalPlace(out, lock)
        return
    refuse_read_only(out)
    folder = _state_folder(out)
    from ..files.store_lock import locked_in_store  # noqa: PLC0415 - for URLs only

    with _locked(folder, out) as lock, locked_in_store(out / _LOCK) as held:
        place = StorePlace(out, folder, lock, held)
        try:
            yield place
        except BaseException:
            with suppress(OutputError):
                place.save()
            raise
        place.save()


@contextmanager
def manifest_folder(out: Path) -> Iterator[Path]:
    """Yield a local folder with the manifest of a folder of outputs, for reading.

    Raises:
        MissingPathError: There is none.
        StoreError: The store cannot be asked.
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
    """Return the names of objects and folders without those whose upload was not completed."""
    names: set[str] = set()
    for name in objects:
        while name and name not in names:
            names.add(name)
            name = name.rpartition('/')[0]  # noqa: PLW2901 - up to the top
    return {each for each in names if _marker_name(each) not in names}


def _marker_name(name: str) -> str:
    folder, slash, last = name.rpartition('/')
    return f'{folder}{slash}.{last}.partial'


def _snapshot(path: Path) -> bytes | None:
    """Return a database as of its last transaction; None if it is being written, or absent."""
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
    """Return the folder of this user for a URL, made if needed."""
    home = os.environ.get('XDG_STATE_HOME') or Path.home() / '.local' / 'state'
    name = hashlib.sha256(str(out).encode()).hexdigest()[:16]
    folder = Path(home, 'kitti_ros2', 'collections', name)
    with reported(folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / 'url').write_text(f'{out}\n')
    return folder


@contextmanager
def _locked(folder: Path, out: Path) -> Iterator[int]:
    """Lock a folder against other runs; yield the descriptor that holds the lock."""
    with reported(folder):
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        _wait_for(lambda: lock_exclusively(lock, out))
        yield lock
    finally:
        os.close(lock)


def _wait_for(acquire: Callable[[], None]) -> None:
    """Acquire a lock that the workers of a killed run hold for another moment."""
    end = time.monotonic() + _LOCK_WAIT_S
    while True:
        try:
            return acquire()
        except OutputError:
            if time.monotonic() > end:
                raise
        time.sleep(_LOCK_POLL_S)
