# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whole files of a store, the next ones of a folder read ahead while they are read in order."""

from __future__ import annotations

import errno
import os
from collections import OrderedDict
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING

from .background_reads import BACKGROUND
from .remote_listing import RemoteEntry, known_listing
from .remote_requests import fetch

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .url_path import UrlPath
    from .threads import ThreadTask

MOST_BYTES = 64 << 20
"""Read ahead and not asked for yet, of all folders."""
_MOST_FILES = 64
"""Read ahead in one folder."""
_MOST_FOLDERS = 64
_FIRST_FILES = 4
_UNKNOWN_BYTES = 1 << 20
"""Taken for the size of a file where listings have none."""
_TEXTS = ('.txt', '.xml')
_MOST_TEXT_BYTES = 16 << 20
_IDLE_READS = 64
"""After so many reads elsewhere, what was read ahead in a folder is dropped if memory is short."""
_OUT_OF_ORDER = 8
"""Threads that take turns read about so many files before or after the last one."""


class _ReadFolder:
    """What is read of a folder.

    Attributes:
        listing: Its entries by name.
        names: Of its files, in the order of the listing.
        places: Their places in it, by name.
        pending: Files that are read ahead, by place.
        last: Place of the file that was read last.
        step: From one file that is read to the next.
        window: How many files are read ahead; 0 while files are read in no order.
        ahead: Place of the last file that was read ahead.
        used: Count of all reads at the last one here.
    """

    def __init__(self, listing: Mapping[str, RemoteEntry]) -> None:
        self.listing = listing
        self.names = [name for name, entry in listing.items() if not entry.is_folder]
        self.places = {name: place for place, name in enumerate(self.names)}
        self.pending: dict[int, tuple[ThreadTask[bytes], int]] = {}
        self.last: int | None = None
        self.step = 1
        self.window = 0
        self.ahead = 0
        self.used = 0

    def note(self, place: int) -> None:
        """Follow the order of reading."""
        if self.last is None:
            self.last = self.ahead = place
            return
        moved, self.last = place - self.last, place
        near = abs(moved) <= _OUT_OF_ORDER * self.step and moved % self.step == 0
        if moved == self.step or (self.window and near):
            self.window = min(max(2 * self.window, _FIRST_FILES), _MOST_FILES)
            self.ahead = max(self.ahead, place)
        elif moved:
            self.window, self.step, self.ahead = 0, moved if moved > 0 else 1, place

    def drop(self, before: int | None = None) -> int:
        """Drop what was read ahead, or only before a place; return its size."""
        gone = [place for place in self.pending if before is None or place < before]
        size = 0
        for place in gone:
            task, held = self.pending.pop(place)
            task.cancel()
            size += held
        return size


class _Texts:
    """The text files that were read last: times and calibration are parsed, and carried whole."""

    def __init__(self) -> None:
        self._kept: OrderedDict[UrlPath, tuple[RemoteEntry, bytes]] = OrderedDict()
        self._size = 0

    def get(self, path: UrlPath, entry: RemoteEntry) -> bytes | None:
        """Return the content of a file, unless it is listed with another size or time."""
        known = self._kept.get(path)
        return known[1] if known is not None and known[0] == entry else None

    def keep(self, path: UrlPath, entry: RemoteEntry, data: bytes) -> None:
        """Keep a file if it is a text of moderate size."""
        if path.suffix not in _TEXTS or len(data) > _MOST_TEXT_BYTES // 8:
            return
        before = self._kept.pop(path, None)
        self._size += len(data) - (len(before[1]) if before else 0)
        self._kept[path] = entry, data
        while self._size > _MOST_TEXT_BYTES:
            self._size -= len(self._kept.popitem(last=False)[1][1])


class FilesAhead:
    """Reads whole files; keeps those that follow for their turn."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._folders: OrderedDict[UrlPath, _ReadFolder] = OrderedDict()
        self._held = 0
        self._reads = 0
        self._texts = _Texts()

    def read(self, path: UrlPath) -> bytes:
        """Read a file.

        Raises:
            OSError, RemoteError: It cannot be read.
        """
        with self._lock:
            if self._process != os.getpid():
                self._process, self._held = os.getpid(), 0
                self._folders.clear()
                self._texts = _Texts()
            folder = self._folder(path.parent)
            entry = None if folder is None else folder.listing.get(path.name)
            if folder is None:
                task = None
            elif entry is None:
                raise FileNotFoundError(errno.ENOENT, 'no such file or folder', str(path))
            elif (known := self._texts.get(path, entry)) is not None:
                return known
            else:
                task = self._take(path, folder)
        size = entry.size if entry is not None else None
        data = fetch(path, size) if task is None else task.result()
        if entry is not None:
            with self._lock:
                self._texts.keep(path, entry, data)
        return data

    def _take(self, path: UrlPath, folder: _ReadFolder) -> ThreadTask[bytes] | None:
        """Return a file that was read ahead, and begin to read those after it."""
        place = folder.places.get(path.name)
        if place is None:
            return None
        task, size = folder.pending.pop(place, (None, 0))
        self._held -= size
        folder.note(place)
        self._reads += 1
        folder.used = self._reads
        passed = place - _OUT_OF_ORDER * folder.step if folder.window else None
        self._held -= folder.drop(passed)
        self._begin(path.parent, folder)
        return task

    def _folder(self, path: UrlPath) -> _ReadFolder | None:
        listing, known = known_listing(path), self._folders.get(path)
        if known is not None and known.listing is not listing:  # listed again
            self._held -= known.drop()
            del self._folders[path]
        if listing is None:
            return None
        if path not in self._folders:
            self._folders[path] = _ReadFolder(listing)
            while len(self._folders) > _MOST_FOLDERS:
                self._held -= self._folders.popitem(last=False)[1].drop()
        self._folders.move_to_end(path)
        return self._folders[path]

    def _begin(self, path: UrlPath, folder: _ReadFolder) -> None:
        """Read ahead as far as the window and the memory allow."""
        end = min((folder.last or 0) + folder.window * folder.step + 1, len(folder.names))
        while folder.window and folder.ahead + folder.step < end:
            place = folder.ahead + folder.step
            file = path / folder.names[place]
            size = folder.listing[file.name].size
            held = _UNKNOWN_BYTES if size is None else size
            if self._held + held > MOST_BYTES and not self._make_room():
                break
            folder.ahead = place
            folder.pending[place] = (BACKGROUND.submit(partial(fetch, file, size)), held)
            self._held += held

    def _make_room(self) -> bool:
        """Drop what was read ahead in a folder that is not read any more; false without one."""
        for each in self._folders.values():
            if each.pending and self._reads - each.used > _IDLE_READS:
                self._held -= each.drop()
                each.window = 0
                return True
        return False


AHEAD = FilesAhead()
