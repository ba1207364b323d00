# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Local outputs that exist either completely or not at all.

Everything is written inside the hidden directory ``.{name}.partial`` beside the output, which is
locked while its writer runs, and renamed to the output when complete. The lock ends with the
process: a partial directory without a lock is left over from a killed run, and the next run
removes it.

Against a power cut, the content is on the disk before it gets the output's name, and the name
before what it replaces is deleted.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import secrets
import shutil
import tempfile
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..model.errors import NotDurableError, OutputError, OutputExistsError, UsageError
from .local_files import sync_folders, sync_tree
from .remote import is_remote
from .threads import deferred_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


# Atomic swap of two names of a file system (Linux's renameat2).

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
# Of systems and file systems without it, such as NFS.
_NOT_THERE = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP)


def atomic_swap(one: Path, other: Path) -> bool:
    """Swap the names of two existing files or folders; return False where that is impossible.

    Raises:
        OSError: The file system refuses.
    """
    function = _renameat2()
    if function is None:
        return False
    names = os.fsencode(one), os.fsencode(other)
    if function(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NOT_THERE:
        return False
    raise OSError(code, os.strerror(code), str(other))


@lru_cache(maxsize=1)
def _renameat2() -> Any:  # noqa: ANN401 - a foreign function, or None
    return getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)


# Names of outputs and the folders that they need.


def named_output(path: Path) -> Path:
    """Return the path of an output with its name, also for `.` and paths that end with `..`.

    Raises:
        UsageError: The path has no name.
    """
    if path.name in {'', '..'}:
        path = Path(os.path.realpath(path))
    if not path.name:
        raise UsageError(f'{path} is no place for a bag; give the name of a file or folder to make')
    return path


def make_parents(folder: Path) -> list[Path]:
    """Make a folder and those above it; return the folders that were made, the topmost first.

    Raises:
        OSError: One cannot be made; none is left behind.
    """
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    created: list[Path] = []
    try:
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            created.append(path)
    except BaseException:
        for path in reversed(created):
            with suppress(OSError):
                path.rmdir()
        raise
    return created


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, all of which outlast a power cut.

    Raises:
        OSError: One cannot be made; none is left behind.
    """
    created = make_parents(folder)
    if created:
        sync_folders(path.parent for path in created)
    elif not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))


_CONTENT = 'content'
_REPLACED = 'replaced'
NAMED = 'named'
"""Folder of a file that is written under its own name."""
_OWN = {_CONTENT, _REPLACED, NAMED}
_TAKING_OVER: ContextVar[tuple[type[OutputError], ...]] = ContextVar('taking_over', default=())
_FULL = (errno.ENOSPC, errno.EDQUOT)
_FORBIDDEN = (errno.EACCES, errno.EPERM, errno.EROFS)
# Errors of file systems without locks; there a concurrent second run is not detected.
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.EBADF, errno.EINVAL)


def output_error(path: Path, error: OSError) -> OutputError:
    """Convert an error of the operating system about an output to a one-line error."""
    reason = error.strerror or str(error)
    if is_remote(path):
        remedy = f'it is made in {tempfile.gettempdir()}: make room, or set TMPDIR to another disk'
        return OutputError(path, f'cannot be made ({reason})', remedy)
    if error.errno in _FULL:
        return OutputError(path, f'the disk is full ({reason})', 'make room, or write elsewhere')
    if error.errno in _FORBIDDEN:
        return OutputError(
            path, f'cannot be written ({reason})', 'choose a folder you may write to'
        )
    return OutputError(path, f'cannot be written ({reason})', 'check the path and the disk')


def refuse_link(path: Path) -> None:
    """Refuse an output that is a symbolic link.

    Raises:
        OutputExistsError: It is one.
    """
    if path.is_symlink():
        raise OutputExistsError(path, 'it is a symbolic link; give the path it points to')


@contextmanager
def reported(path: Path) -> Iterator[None]:
    """Convert errors of the operating system about an output to OutputError."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error


class Staging:
    """A temporary directory for an output until it is complete.

    Attributes:
        path: The output.
        content: The path to write to, inside the partial directory; it does not exist yet.

    Args:
        path: The output.
        refusal: Returns the reason why an existing output is kept, None if it may be replaced.
        fsync: Whether a published output outlasts a power cut.

    Raises:
        OutputExistsError: The output exists and may not be replaced.
        OutputError: Another run is writing it, or the disk refuses.
        UsageError: The path cannot be an output.
    """

    def __init__(
        self, path: Path, refusal: Callable[[Path], str | None], *, fsync: bool = True
    ) -> None:
        self.path = named_output(path)
        self._fsync = fsync
        self._refusal = refusal
        self._partial = _partial_of(self.path)
        # Unique: a writer that is taken over, or not locked out, never publishes another's content.
        self.content = self._partial / f'{_CONTENT}-{secrets.token_hex(4)}'
        self._created: list[Path] = []
        self._lock = -1
        self._made = False
        try:
            self._check_free()
        except OutputExistsError:
            self._remove_leftovers()
            raise
        try:
            with reported(self.path):
                self._created = make_parents(self.path.parent)
                self._acquire()
                self._clear()
        except BaseException as error:
            self.discard()
            if self._made or isinstance(error, (KeyboardInterrupt, SystemExit)):
                # It may have been created and not locked.
                with suppress(OSError):
                    self._partial.rmdir()
            if self._made:
                self.note_remains(error)
            raise

    def publish(self) -> None:
        """Rename the complete content to the output.

        Raises:
            OutputExistsError: The output was created meanwhile, or may not be replaced.
            OutputError: The disk refuses.
            NotDurableError: The output is published, and the disk does not confirm its name.
        """
        self._check_free()
        with reported(self.path):
            self.content.lstat()  # raises if another writer has taken over
            if self._fsync:
                sync_tree(self.content)
            if self.path.is_dir() or (self.content.is_dir() and self.path.exists()):
                self._replace()
            else:
                self.content.rename(self.path)
        try:
            self._sync_names(self.path.parent, *(folder.parent for folder in self._created))
        except OSError as error:
            raise NotDurableError(self.path, error) from error
        finally:
            self._created.clear()
        self.discard()

    def keep(self, path: Path) -> None:
        """Rename content that is not complete to another path, which must be free.

        Raises:
            OSError: The disk refuses.
        """
        self.content.rename(path)
        created, self._created = self._created, []
        with suppress(OSError):  # it is worth more than nothing
            if self._fsync:
                sync_tree(path)
            self._sync_names(path.parent, *(folder.parent for folder in created))

    def _replace(self) -> None:
        """Replace what a rename cannot; without a swap the output is briefly absent."""
        if not atomic_swap(self.content, self.path):
            self.path.rename(self._partial / _REPLACED)
            # A run after a power cut must find it there.
            self._sync_names(self._partial, self.path.parent)
            self.content.rename(self.path)

    def _sync_names(self, *folders: Path) -> None:
        if self._fsync:
            sync_folders(folders)

    def discard(self) -> None:
        """Remove the content and release the lock; never raises OSError."""
        with deferred_signals():
            self._remove_all()

    def _remove_all(self) -> None:
        lock, self._lock = self._lock, -1
        if lock >= 0:
            with suppress(OSError):
                self._restore()
            # Delete before unlocking: another run must not find a partly deleted directory.
            for entry in (self.content, self._partial / _REPLACED, self._partial / NAMED):
                _remove(entry)
            with suppress(OSError):  # it holds the content of a writer that has taken over
                self._partial.rmdir()
            os.close(lock)
        for folder in reversed(self._created):
            with suppress(OSError):
                folder.rmdir()
        self._created.clear()

    def note_remains(self, error: BaseException) -> None:
        """Correct the text of an OutputError where the partial directory could not be removed."""
        if isinstance(error, OutputError) and may_exist(self._partial):
            error.note_remains(self._partial)

    def _check_free(self) -> None:
        with reported(self.path):
            if not os.path.lexists(self.path):
                return
            refuse_link(self.path)
            refusal = self._refusal(self.path)
            if refusal is not None:
                raise OutputExistsError(self.path, refusal)

    def _remove_leftovers(self) -> None:
        """Remove what a run left that was killed after its output was complete."""
        if os.path.lexists(self._partial):
            with suppress(OSError, OutputError):
                self._acquire()
                self._clear()
            self.discard()

    def _acquire(self) -> None:
        """Create the partial directory and lock it."""
        while True:
            with suppress(FileExistsError):
                self._partial.mkdir()
                self._made = True
            if self._partial.is_symlink() or not self._partial.is_dir():
                raise OutputError(
                    self.path,
                    f'{self._partial} is in the way and is no folder',
                    'move it away, or choose another name',
                )
            fd = os.open(self._partial, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                with suppress(*_TAKING_OVER.get()):
                    lock_exclusively(fd, self.path)
                # Its owner may have removed the directory between our open and our lock.
                if os.path.samestat(os.fstat(fd), os.lstat(self._partial)):
                    self._lock = fd
                    return
            except FileNotFoundError:
                pass
            except BaseException:
                if self._lock != fd:
                    os.close(fd)
                raise
            os.close(fd)

    def _clear(self) -> None:
        self._restore()
        names = {entry.name for entry in self._partial.iterdir()}
        foreign = {name for name in names if name.partition('-')[0] not in _OWN}
        if foreign:
            # Neither this method nor discard may delete them.
            os.close(self._lock)
            self._lock = -1
            raise OutputError(
                self.path,
                f'{self._partial} is in the way and holds {min(foreign)}',
                'move it away, or choose another name',
            )
        for name in names:
            _remove(self._partial / name)

    def _restore(self) -> None:
        # A run that was killed between its two renames has moved the old bag here.
        replaced = self._partial / _REPLACED
        if os.path.lexists(replaced) and not os.path.lexists(self.path):
            replaced.rename(self.path)


def remove_leftovers(path: Path) -> None:
    """Remove the partial directory of a local output, unless a run is writing it.

    What cannot be removed stays; never raises OSError.
    """
    if os.path.lexists(_partial_of(path)):
        with suppress(OSError, OutputError, UsageError):
            Staging(path, lambda _: None).discard()


def _partial_of(path: Path) -> Path:
    return path.with_name(f'.{path.name}.partial')


@contextmanager
def taking_over() -> Iterator[None]:
    """Let outputs be begun although another process seems to be writing them.

    For the second attempt of work whose process is given up, but may still run, such as one behind
    a broken network. The first attempt cannot publish anything afterwards.
    """
    before = _TAKING_OVER.set((OutputError,))
    try:
        yield
    finally:
        _TAKING_OVER.reset(before)


def _remove(entry: Path) -> None:
    """Remove a file or a folder if it is there."""
    with suppress(OSError):
        entry.unlink()
    shutil.rmtree(entry, ignore_errors=True)


def may_exist(path: Path) -> bool:
    """Return whether a path exists, or cannot be examined."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except OSError:
        pass
    return True


def lock_exclusively(fd: int, path: Path) -> None:
    """Lock an open folder until it is closed.

    Raises:
        OutputError: Another run is writing to the output, path.
        OSError: The disk refuses.
    """
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise OutputError(
            path, 'another run is writing this', 'wait for it, or choose another name'
        ) from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
