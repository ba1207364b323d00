# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Append frames to an object set atomically.

The new frames are built in a folder of the set that loaders ignore. Then a journal is written, the
files are moved to their targets, the lists of frames last, and the journal is renamed: that commits
the append. If the process ends earlier, the next run undoes what the journal lists. Each step is on
the disk before the next one begins, which covers killed processes, full disks and power cuts.
"""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..files.local_files import sync_folders, sync_tree
from ..files.local_staging import lock_exclusively, may_exist, refuse_link, reported
from ..files.remote import is_remote
from ..files.staging import staged
from ..files.threads import deferred_signals
from ..model.errors import (
    KittiRos2Error,
    NotDurableError,
    OutputError,
    OutputExistsError,
    UsageError,
    format_numbers,
)
from . import names
from .object_set import (
    BEFORE,
    COMMITTED,
    CONTENT,
    FOLDER,
    JOURNAL,
    AppendJournal,
    find_journal,
    format_journal,
    parse_journal,
)
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_NEW_JOURNAL = 'journal.new'
_OURS = {CONTENT, BEFORE, JOURNAL, COMMITTED, _NEW_JOURNAL}


@dataclass(frozen=True)
class Appending:
    """An append in progress.

    Attributes:
        stage: The folder to build the new frames in, as if it were the set.
        first: The number of the first new frame.
        notes: Treatment of an earlier, interrupted append.
    """

    stage: Path
    first: int
    notes: tuple[str, ...] = ()


@contextmanager
def appended(out: Path, split: str, *, fsync: bool = True) -> Iterator[Appending]:
    """Build frames that are added to an object set on success only.

    Args:
        out: The set's folder; a new set is made where it is absent or empty.
        split: training or testing.
        fsync: Whether the frames, once appended, outlast a power cut.

    Raises:
        OutputExistsError: out is not a folder, or a file of a new frame appeared meanwhile.
        OutputError: Another run is writing to it, or it cannot be written.
        NotDurableError: The frames are in the set, and the disk does not confirm it.
        UsageError: out is a URL, contains no object set, or has symbolic links where frames go.
    """
    _refuse_url(out)
    if not os.path.lexists(out) or (out.is_dir() and not any(out.iterdir())):
        with staged(out, fsync=fsync) as stage:
            yield Appending(stage, 0)
        return
    refuse_link(out)
    if not out.is_dir():
        raise OutputExistsError(out, 'it is no folder; choose another name')
    with reported(out), _locked(out), _noting_remains(out):
        notes = _recover(out)
        _refuse_links(out, split)
        first = next_number(out, split)
        try:
            stage = out / FOLDER / CONTENT
            stage.mkdir(parents=True)
            yield Appending(stage, first, notes)
            _commit(out, split, fsync=fsync)
        finally:
            # The next run removes the rest.
            with suppress(OSError, MemoryError), deferred_signals():
                _recover(out)
            if os.path.lexists(out / FOLDER / JOURNAL):
                raise KittiRos2Error(
                    f'{out}: the append failed, and so did undoing it; the next to-kitti --append'
                    f' undoes it before it begins'
                )


def mend(out: Path) -> tuple[str, ...]:
    """Undo an append that was interrupted, or remove what is left of it.

    Returns:
        What was done, a line each.

    Raises:
        OutputError: Another run is writing to the set, or it cannot be written.
        BadFileError: The journal is damaged.
        UsageError: out is a URL.
    """
    _refuse_url(out)
    if out.is_symlink() or not os.path.lexists(out / FOLDER):
        return ()
    with reported(out), _locked(out):
        return _recover(out)


def _refuse_url(out: Path) -> None:
    if is_remote(out):
        raise UsageError(f'{out}: --append continues local folders only; give one')


def next_number(out: Path, split: str) -> int:
    """Return the number after the last frame of an object set.

    Raises:
        UsageError: The folder contains something else.
    """
    folders = [out / split / name for name in STORE.names(out / split)]
    numbers = [
        int(name[: names.FRAME_DIGITS])
        for folder in folders
        for name in STORE.names(folder)
        if name[: names.FRAME_DIGITS].isdecimal() and len(name) == names.FRAME_DIGITS + 4
    ]
    if not numbers:
        raise UsageError(
            f'{out}: holds no object set to append to; expected {split}/ with frames of'
            f' {names.FRAME_DIGITS} digits'
        )
    return max(numbers) + 1


@contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Hold the lock of a set; the system releases it when the process ends."""
    folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        lock_exclusively(folder, out)
        yield
    finally:
        os.close(folder)


@contextmanager
def _noting_remains(out: Path) -> Iterator[None]:
    """Convert errors of the operating system, as reported; note the remains in the text."""
    try:
        with reported(out):
            yield
    except OutputError as error:
        if may_exist(out / FOLDER):
            error.note_remains(out / FOLDER)
        raise


def _refuse_links(out: Path, split: str) -> None:
    """Refuse symbolic links, which may lead to the files of another set.

    Raises:
        UsageError: The split or the lists of frames are, or hold, a symbolic link.
    """
    folders = [out / split, out / names.IMAGE_SETS]
    link = next((folder for folder in folders if folder.is_symlink()), None)
    while folders and link is None:
        folder = folders.pop()
        if not folder.is_dir():
            continue
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_symlink():
                    link = folder / entry.name
                elif entry.is_dir():
                    folders.append(folder / entry.name)
    if link is not None:
        raise UsageError(
            f'{link}: is a symbolic link, which --append does not follow or replace; put what it'
            f' points to in its place'
        )


def _commit(out: Path, split: str, *, fsync: bool) -> None:
    """Move the staged files into the set; can be undone until all are moved."""
    work = out / FOLDER
    journal = _plan(out, split)
    STORE.write_text(work / _NEW_JOURNAL, format_journal(journal))
    if fsync:
        sync_tree(work)
    (work / _NEW_JOURNAL).rename(work / JOURNAL)
    if fsync:
        sync_folders([work, out])
    for folder in journal.folders:
        (out / folder).mkdir()
    for path in (*journal.files, *journal.lists):
        (work / CONTENT / path).rename(out / path)
    if fsync:
        moved = (*journal.files, *journal.lists)
        sync_folders(out / parent for path in moved for parent in path.parents)
    (work / JOURNAL).rename(work / COMMITTED)
    if fsync:
        try:
            sync_folders([work])
        except OSError as error:  # too late to undo: the frames are in the set
            raise NotDurableError(out, error) from error


def _plan(out: Path, split: str) -> AppendJournal:
    """Make the journal of all moves; lists are staged whole, and backed up."""
    content = out / FOLDER / CONTENT
    staged_files = [
        PurePosixPath(path.relative_to(content).as_posix())
        for path in content.rglob('*')
        if path.is_file()
    ]
    # Frame by frame; lists have no number in their name.
    staged_files.sort(key=lambda path: (path.parts[0] == names.IMAGE_SETS, path.name, path))
    _refuse_links(out, split)
    lists = [
        path
        for path in staged_files
        if path.parts[0] == names.IMAGE_SETS and os.path.lexists(out / path)
    ]
    files = [path for path in staged_files if path not in lists]
    for path in files:
        if os.path.lexists(out / path):
            raise OutputExistsError(out / path, 'another program wrote it meanwhile; run again')
    lists = [path for path in lists if _continue_list(out, path)]
    parents = {parent for path in files for parent in path.parents if parent.parts}
    folders = sorted(folder for folder in parents if not (out / folder).is_dir())
    return AppendJournal(split, tuple(files), tuple(lists), tuple(folders))


def _continue_list(out: Path, path: PurePosixPath) -> bool:
    """Prepend the existing entries of a list to the staged ones; return whether any were added."""
    staged_list = out / FOLDER / CONTENT / path
    earlier, added = STORE.read_text(out / path), STORE.read_text(staged_list)
    STORE.write_text(out / FOLDER / BEFORE / path, earlier)
    if earlier and not earlier.endswith('\n'):
        earlier += '\n'
    STORE.write_text(staged_list, earlier + added)
    return bool(added)


def _recover(out: Path) -> tuple[str, ...]:
    """Undo an incomplete append, and remove the remains of any append.

    Returns:
        What was done, a line each.
    """
    work = out / FOLDER
    if not os.path.lexists(work):
        return ()
    entries = {entry.name for entry in work.iterdir()} if not work.is_symlink() else {work.name}
    if entries - _OURS:
        raise OutputExistsError(work, f'it holds {min(entries - _OURS)}; move it away')
    journal = find_journal(out)
    if journal is not None:
        _undo(out, journal)
        outcome = f'has been undone, and frames {format_numbers(journal.numbers)} removed again'
    elif COMMITTED in entries:
        path = work / COMMITTED
        numbers = parse_journal(STORE.read_text(path), path).numbers
        outcome = f'had been complete: frames {format_numbers(numbers)} are in the set'
    else:
        outcome = 'had not added a frame yet, and its files have been removed'
    for name in (CONTENT, BEFORE):
        if name in entries:
            shutil.rmtree(work / name)
    for name in (_NEW_JOURNAL, COMMITTED):
        (work / name).unlink(missing_ok=True)
    work.rmdir()
    return (f'{out}: an append that was interrupted {outcome}',)


def _undo(out: Path, journal: AppendJournal) -> None:
    """Restore a set to its state before an append; may be repeated from any point."""
    work = out / FOLDER
    _refuse_links(out, journal.split)
    for path in journal.lists:
        if (work / BEFORE / path).exists():
            (work / BEFORE / path).replace(out / path)
    for path in reversed(journal.files):
        if not (work / CONTENT / path).exists():
            (out / path).unlink(missing_ok=True)
    for folder in reversed(journal.folders):
        with suppress(OSError):  # contains files of others
            (out / folder).rmdir()
    touched = {parent for path in (*journal.files, *journal.lists) for parent in path.parents}
    sync_folders(out / parent_path for parent_path in touched if (out / parent_path).is_dir())
    (work / JOURNAL).unlink()
    sync_folders([work])
