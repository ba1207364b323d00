# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reads from stores: listings of folders, globs, bytes by position, and whole files read ahead."""

from __future__ import annotations

import errno
import io
import os
import re
from collections import OrderedDict
from contextlib import suppress
from datetime import datetime, timezone
from email.utils import parsedate_to_datetime
from fnmatch import fnmatchcase
from functools import partial
from glob import has_magic
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from urllib.parse import unquote

from ..model.errors import RemoteError
from .remote_requests import attempt, fetch, fetch_range, filesystem_of, key_of
from .threads import Threads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from .threads import ThreadTask
    from .url_path import UrlPath


# Threads that wait for stores; what they have not begun is dropped when the process ends.

THREADS = 16
"""Requests at the same time; they wait, most of the time."""


class BackgroundReads:
    """Threads that read; they are never closed."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._threads = Threads(THREADS, 'read')

    def submit(self, read: Callable[[], bytes]) -> ThreadTask[bytes]:
        """Read when a thread is free; cancel the task if it is not needed any more."""
        with self._lock:
            if self._process != os.getpid():  # threads are not forked
                self._process, self._threads = os.getpid(), Threads(THREADS, 'read')
            return self._threads.submit(read)


BACKGROUND = BackgroundReads()


# Listings of folders in stores, one request for each folder and process.
#
# Whether a name exists, is a folder, and how long a file is, all come from the listing of its
# folder.

_HTTP = ('http', 'https')
_SUFFIX = re.compile(r'\.[A-Za-z][A-Za-z0-9]{1,7}', re.ASCII)


class RemoteEntry(NamedTuple):
    """The entry of a name in a store.

    Attributes:
        is_folder: Whether it is a folder.
        size: Bytes of a file; None where listings have none.
        changed_ns: Time of the last change since 1970 UTC; 0 if unknown.
        tag: Changes with the content (ETag); empty if unknown.
    """

    is_folder: bool
    size: int | None = None
    changed_ns: int = 0
    tag: str = ''


_CHANGED = (
    'LastModified', 'mtime', 'Last-Modified', 'updated', 'modified', 'last_modified', 'created'
)  # fmt: skip
_TAGS = ('ETag', 'etag')
_FOLDER = RemoteEntry(is_folder=True)
_MOST_ENTRIES = 200_000
"""Limit of all cached listings; fsspec has about 1 KB for each."""


class _Listings:
    """The listings of this process.

    Attributes:
        folders: Entries by name, by folder.
        alone: Entries of paths whose folder is not listed; None for what does not exist.
        closed: Folders that cannot be listed.
    """

    def __init__(self) -> None:
        self.lock = RLock()
        self.folders: dict[UrlPath, Mapping[str, RemoteEntry]] = {}
        self.alone: dict[UrlPath, RemoteEntry | None] = {}
        self.closed: set[UrlPath] = set()

    def keep(self, folder: UrlPath, entries: Mapping[str, RemoteEntry]) -> None:
        """Keep a listing; the oldest ones are dropped where there are too many entries."""
        self.folders[folder] = entries
        while len(self.folders) > 1 and sum(map(len, self.folders.values())) > _MOST_ENTRIES:
            oldest = next(iter(self.folders))
            del self.folders[oldest]
            filesystem_of(oldest).invalidate_cache(key_of(oldest))


_LISTINGS = _Listings()


def forget(path: UrlPath) -> None:
    """Forget what was listed at a path, below it, and in its folder: it may have changed."""
    files = filesystem_of(path)
    with _LISTINGS.lock:
        below = {folder for folder in _LISTINGS.folders if path in folder.parents}
        stale = below | {path, path.parent}
        for url in stale:
            _LISTINGS.folders.pop(url, None)
            if url.names:
                files.invalidate_cache(key_of(url))
        for url in {url for url in _LISTINGS.alone if path in {url, *url.parents}}:
            del _LISTINGS.alone[url]
        _LISTINGS.closed -= stale


def listing_of(folder: UrlPath) -> Mapping[str, RemoteEntry]:
    """Return the entries of a folder by name, sorted.

    Raises:
        FileNotFoundError: There is no such folder.
        NotADirectoryError: It is a file.
        OSError, RemoteError: The store cannot be asked, or has no listings.
    """
    with _LISTINGS.lock:
        if not folder.names:
            return {}
        if folder not in _LISTINGS.folders:
            above = _known_above(folder)
            if above is not None and not entry_of(folder).is_folder:
                raise NotADirectoryError(errno.ENOTDIR, 'is not a folder', str(folder))
            if above is None and _LISTINGS.alone.get(folder, _FOLDER) is None:
                raise _missing(folder)
            try:
                entries = _listed(folder)
            except FileNotFoundError:
                _LISTINGS.alone[folder] = None
                raise
            if entries is None:
                raise NotADirectoryError(errno.ENOTDIR, 'is not a folder', str(folder))
            _LISTINGS.keep(folder, entries)
        return _LISTINGS.folders[folder]


def entry_of(path: UrlPath) -> RemoteEntry:
    """Return the entry of a path.

    Raises:
        FileNotFoundError: There is nothing.
        OSError, RemoteError: The store cannot be asked.
    """
    with _LISTINGS.lock:
        entry = _entry_of(path)
    if entry is None:
        raise _missing(path)
    return entry


def _entry_of(path: UrlPath) -> RemoteEntry | None:
    if not path.names or path in _LISTINGS.folders:
        return _FOLDER
    above = None if path.parameters else _known_above(path)
    if above is not None:
        for name in path.names[len(above.names) :]:
            entry = listing_of(above).get(name)
            above /= name
            if entry is None or not entry.is_folder:
                return entry if above == path else None
        return _FOLDER
    if path not in _LISTINGS.alone:
        beside = any(folder.parent == path.parent for folder in _LISTINGS.folders)
        if beside and path.parent not in _LISTINGS.closed and not path.parameters:
            # More of the folder will be asked for: it is listed once.
            try:
                return listing_of(path.parent).get(path.name)
            except (OSError, RemoteError):
                _LISTINGS.closed.add(path.parent)
        _LISTINGS.alone[path] = _asked(path)
    return _LISTINGS.alone[path]


def _known_above(path: UrlPath) -> UrlPath | None:
    """Return the nearest folder above whose listing is known."""
    return next((parent for parent in path.parents if parent in _LISTINGS.folders), None)


def _missing(path: UrlPath) -> FileNotFoundError:
    return FileNotFoundError(errno.ENOENT, 'no such file or folder', str(path))


def sized_entry_of(path: UrlPath) -> RemoteEntry:
    """Return the entry of a path, with a file's size also where listings have none.

    Raises:
        FileNotFoundError: There is nothing.
        OSError, RemoteError: The store cannot be asked.
    """
    entry = entry_of(path)
    if entry.is_folder or entry.size is not None:
        return entry
    with _LISTINGS.lock:
        sized = _LISTINGS.alone.get(path)
        if sized is None:
            sized = _LISTINGS.alone[path] = _described(path)
    return sized


def known_listing(folder: UrlPath) -> Mapping[str, RemoteEntry] | None:
    """Return the entries of a folder if it was listed; nothing is asked."""
    with _LISTINGS.lock:
        return _LISTINGS.folders.get(folder)


def _asked(path: UrlPath) -> RemoteEntry | None:
    """Ask for a path on its own: first as its name suggests, a file or a folder."""
    looks_like_file = bool(_SUFFIX.fullmatch(path.suffix)) or path.scheme in _HTTP
    try:
        if not looks_like_file:
            entries = _listed(path)
            if entries is not None:
                _LISTINGS.keep(path, entries)
                return _FOLDER
        entry = _described(path)
        if entry.is_folder:
            _LISTINGS.keep(path, _listed(path) or {})
    except FileNotFoundError:
        return None
    return entry


def _described(path: UrlPath) -> RemoteEntry:
    """Ask a store for the description of a path; of a web server, a page with links is a folder."""
    files, key = filesystem_of(path), key_of(path)
    info = attempt(path, lambda: files.info(key))
    if path.scheme in _HTTP and info.get('mimetype') == 'text/html' and not path.parameters:
        with suppress(OSError, RemoteError):
            _LISTINGS.keep(path, _listed(path) or {})
            return _FOLDER
    return _entry(info)


def _listed(folder: UrlPath) -> Mapping[str, RemoteEntry] | None:
    """List a folder; None if it is a file.

    Raises:
        FileNotFoundError: There is nothing.
        OSError, RemoteError: As attempt.
    """
    files, key = filesystem_of(folder), key_of(folder)
    is_http = folder.scheme in _HTTP
    infos = attempt(folder, lambda: files.ls(f'{key}/' if is_http else key, detail=True))
    own = key.strip('/')
    entries: dict[str, RemoteEntry] = {}
    for info in infos:
        whole = str(info['name']).strip('/')
        if whole == own:
            if info.get('type') != 'directory' and len(infos) == 1:
                return None
            continue  # the mark of an empty folder
        name = whole.removeprefix(f'{own}/')
        if is_http:
            name = unquote(name)
        if '/' not in name and '?' not in name and name not in {'', '.', '..'}:
            entries[name] = _entry(info)
    if is_http and not entries:
        raise RemoteError(
            folder,
            'the server shows no list of the files in this folder',
            'give the URL of a bag, or use a server that lists its folders',
        )
    return dict(sorted(entries.items()))


def _entry(info: Mapping[str, Any]) -> RemoteEntry:
    """Return the entry of fsspec's description."""
    if info.get('type') == 'directory':
        return _FOLDER
    size = info.get('size')
    changed = next((info[name] for name in _CHANGED if info.get(name)), None)
    size = None if size is None else int(size)
    tag = next((str(info[name]) for name in _TAGS if info.get(name)), '')
    return RemoteEntry(is_folder=False, size=size, changed_ns=_nanoseconds(changed), tag=tag)


def _nanoseconds(changed: object) -> int:
    """Return a time as a store gives it in nanoseconds since 1970; 0 if it is of no known form."""
    with suppress(ValueError, TypeError, OverflowError):
        if isinstance(changed, str):
            is_iso = changed[:4].isdecimal()
            changed = (
                datetime.fromisoformat(changed.replace('Z', '+00:00'))
                if is_iso
                else parsedate_to_datetime(changed)
            )
        if isinstance(changed, datetime):
            if changed.tzinfo is None:
                changed = changed.replace(tzinfo=timezone.utc)
            since = changed - datetime(1970, 1, 1, tzinfo=timezone.utc)
            return (since.days * 86400 + since.seconds) * 10**9 + since.microseconds * 1000
        if isinstance(changed, (int, float)):
            return int(changed * 10**9)
    return 0


# Globs over the folders of stores, by one listing of each folder that a pattern can match in.

_ALL_LEVELS = '**'


def matches_of(pattern: UrlPath) -> list[UrlPath]:
    """Return what matches a URL with *, ? or [...] in its names, or ** for folders of all levels.

    Names that begin with a point match only patterns that do, as in a shell.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """
    names = pattern.names
    matches: Iterable[UrlPath] = [pattern.parents[-1]]
    for position, name in enumerate(names):
        if name == _ALL_LEVELS:
            matches = [level for folder in matches for level in _levels(folder)]
        elif has_magic(name):
            matches = [folder / child for folder in matches for child in _matching(folder, name)]
        else:
            matches = [folder / name for folder in matches]
            if any(map(has_magic, names[:position])):
                matches = [path for path in matches if path.exists()]
    return sorted(set(matches))


def _matching(folder: UrlPath, pattern: str) -> Iterator[str]:
    for name in _names(folder):
        if name.startswith('.') == pattern.startswith('.') and fnmatchcase(name, pattern):
            yield name


def _levels(folder: UrlPath) -> Iterator[UrlPath]:
    """Yield a folder and all folders below it."""
    yield folder
    for name, is_folder in _names(folder).items():
        if is_folder and not name.startswith('.'):
            yield from _levels(folder / name)


def _names(folder: UrlPath) -> dict[str, bool]:
    try:
        return {name: entry.is_folder for name, entry in listing_of(folder).items()}
    except (FileNotFoundError, NotADirectoryError):
        return {}


# Bytes of a file in a store by position: read ahead, neighbouring ranges in one request.

_BLOCK = 1 << 16
_MOST_REQUEST = 4 << 20
"""Longer ranges are read by several requests at the same time."""
_MOST_BYTES = 96 << 20
"""Kept of all files."""
_MOST_AHEAD = 16 << 20
_FIRST_AHEAD = 1 << 20
_NEAR = 1 << 17
"""A read so far behind the last one's end follows it."""
_TAIL = 1 << 18
"""Read of the end of a file when it is opened: most summaries of bags fit in."""


class _Range(NamedTuple):
    """Blocks of a file that one request reads.

    Attributes:
        start: Offset of the first block, in bytes.
        data: The bytes, once they are there.
        length: Their number.
    """

    start: int
    data: ThreadTask[bytes]
    length: int


_Version: TypeAlias = 'tuple[UrlPath, int, int]'
"""A file with its size in bytes and the time of its change."""


class _Blocks:
    """The blocks of all files that are being read, the last used ones."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._of: dict[tuple[_Version, int], _Range] = {}
        self._ranges: OrderedDict[tuple[_Version, int], _Range] = OrderedDict()
        self._size = 0

    def want(self, file: _Version, start: int, end: int) -> list[_Range]:
        """Return the ranges with the bytes from start to end; what is missing is requested."""
        with self._lock:
            if self._process != os.getpid():
                self._process, self._size = os.getpid(), 0
                self._of.clear()
                self._ranges.clear()
            ranges: list[_Range] = []
            first = block = start // _BLOCK
            last = -(-end // _BLOCK)
            while block < last:
                block_range = self._of.get((file, block))
                if block_range is not None and block_range.data.has_failed():
                    self._drop((file, block_range.start // _BLOCK))
                    block_range = None
                if block_range is None:
                    first, most = block, block + _MOST_REQUEST // _BLOCK
                    while block < min(last, most) and (file, block) not in self._of:
                        block += 1
                    block_range = self._request(file, first, block)
                self._ranges.move_to_end((file, block_range.start // _BLOCK))
                ranges.append(block_range)
                block = (block_range.start + block_range.length - 1) // _BLOCK + 1
            self._shrink(len(ranges))
            return ranges

    def _request(self, file: _Version, first: int, end: int) -> _Range:
        start, stop = first * _BLOCK, min(end * _BLOCK, file[1])
        data = BACKGROUND.submit(partial(_fetch, *file[:2], start, stop))
        block_range = _Range(start, data, stop - start)
        self._ranges[file, first] = block_range
        self._size += block_range.length
        for block in range(first, end):
            self._of[file, block] = block_range
        return block_range

    def _shrink(self, needed: int) -> None:
        """Drop the ranges that were not used for longest."""
        while self._size > _MOST_BYTES and len(self._ranges) > needed:
            self._drop(next(iter(self._ranges)))

    def _drop(self, key: tuple[_Version, int]) -> None:
        file, first = key
        dropped = self._ranges.pop(key)
        dropped.data.cancel()
        self._size -= dropped.length
        for block in range(first, (dropped.start + dropped.length - 1) // _BLOCK + 1):
            del self._of[file, block]


_BLOCKS = _Blocks()


def _fetch(path: UrlPath, size: int, start: int, end: int) -> bytes:
    data = fetch_range(path, start, end)
    if len(data) == end - start:
        return data
    if len(data) == size <= _MOST_REQUEST:
        return data[start:end]
    raise RemoteError(
        path,
        'the server sends whole files only, not the requested part',
        'use a server that supports ranges, or download the file',
    )


class RemoteBytes:
    """A file of a store, by position.

    Attributes:
        size: In bytes, when it was opened.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    def __init__(self, path: UrlPath) -> None:
        entry = sized_entry_of(path)
        if entry.is_folder:
            raise IsADirectoryError(errno.EISDIR, 'Is a directory', str(path))
        if entry.size is None:
            raise RemoteError(path, 'the server does not say how long the file is', 'download it')
        self.size = entry.size
        self._file = path, entry.size, entry.changed_ns
        self._last_end = -1
        self._ahead = 0

    def read(self, position: int, length: int) -> bytes:
        """Read `length` bytes, fewer at the end of the file, none outside of it.

        Raises:
            OSError, RemoteError: The store refuses.
        """
        end = min(position + length, self.size)
        if length <= 0 or not 0 <= position < end:
            return b''
        if self._last_end < 0 and position == 0:
            self.expect(max(self.size - _TAIL, 0), _TAIL)
        ranges = _BLOCKS.want(self._file, position, end)
        self._read_ahead(position, end)
        parts = []
        for block_range in ranges:
            data, at = block_range.data.result(), block_range.start
            parts.append(data[max(position - at, 0) : end - at])
        return parts[0] if len(parts) == 1 else b''.join(parts)

    def _read_ahead(self, position: int, end: int) -> None:
        """Request what follows, more and more of it, while the file is read in order."""
        if 0 <= position - self._last_end + _BLOCK <= _NEAR + _BLOCK:
            self._ahead = min(max(2 * self._ahead, _FIRST_AHEAD), _MOST_AHEAD)
            self.expect(end, self._ahead)
        elif position != self._last_end:
            self._ahead = 0
        self._last_end = end

    def expect(self, position: int, length: int) -> None:
        """Request bytes that will be read."""
        end = min(position + length, self.size)
        if 0 <= position < end:
            _BLOCKS.want(self._file, position, end)


class RemoteFile(io.RawIOBase):
    """A file of a store opened for reading.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    def __init__(self, path: UrlPath) -> None:
        super().__init__()
        self._bytes = RemoteBytes(path)
        self._position = 0
        self.name = str(path)

    def readable(self) -> bool:
        """Return true."""
        return True

    def seekable(self) -> bool:
        """Return true."""
        return True

    def tell(self) -> int:
        """Return the position."""
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Move to a position."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._bytes.size}
        self._position = max(base[whence] + offset, 0)
        return self._position

    def readinto(self, target: bytearray | memoryview, /) -> int:  # type: ignore[override]
        """Read into a buffer."""
        view = memoryview(target).cast('B')
        data = self._bytes.read(self._position, len(view))
        view[: len(data)] = data
        self._position += len(data)
        return len(data)


# Whole files of a store, the next ones of a folder read ahead while they are read in order.

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
    """The files of a folder that are read, and read ahead.

    Attributes:
        listing: Its entries by name.
        names: Names of its files, in the order of the listing.
        indices: Their indices in it, by name.
        pending: Files that are read ahead, by index.
        last: Index of the file that was read last.
        step: From one file that is read to the next.
        window: Number of files that are read ahead; 0 while files are read in no order.
        ahead: Index of the last file that was read ahead.
        used: Count of all reads at the last one here.
    """

    def __init__(self, listing: Mapping[str, RemoteEntry]) -> None:
        self.listing = listing
        self.names = [name for name, entry in listing.items() if not entry.is_folder]
        self.indices = {name: index for index, name in enumerate(self.names)}
        self.pending: dict[int, tuple[ThreadTask[bytes], int]] = {}
        self.last: int | None = None
        self.step = 1
        self.window = 0
        self.ahead = 0
        self.used = 0

    def note(self, index: int) -> None:
        """Follow the order of reading."""
        if self.last is None:
            self.last = self.ahead = index
            return
        moved, self.last = index - self.last, index
        near = abs(moved) <= _OUT_OF_ORDER * self.step and moved % self.step == 0
        if moved == self.step or (self.window and near):
            self.window = min(max(2 * self.window, _FIRST_FILES), _MOST_FILES)
            self.ahead = max(self.ahead, index)
        elif moved:
            self.window, self.step, self.ahead = 0, moved if moved > 0 else 1, index

    def drop(self, before: int | None = None) -> int:
        """Drop what was read ahead, or only before an index; return its size."""
        dropped = [index for index in self.pending if before is None or index < before]
        size = 0
        for index in dropped:
            task, length = self.pending.pop(index)
            task.cancel()
            size += length
        return size


class _Texts:
    """The text files that were read last: times and calibration are parsed, and carried whole."""

    def __init__(self) -> None:
        self._cached: OrderedDict[UrlPath, tuple[RemoteEntry, bytes]] = OrderedDict()
        self._size = 0

    def get(self, path: UrlPath, entry: RemoteEntry) -> bytes | None:
        """Return the content of a file, unless it is listed with another size or time."""
        cached = self._cached.get(path)
        return cached[1] if cached is not None and cached[0] == entry else None

    def keep(self, path: UrlPath, entry: RemoteEntry, data: bytes) -> None:
        """Keep a file if it is a text of moderate size."""
        if path.suffix not in _TEXTS or len(data) > _MOST_TEXT_BYTES // 8:
            return
        before = self._cached.pop(path, None)
        self._size += len(data) - (len(before[1]) if before else 0)
        self._cached[path] = entry, data
        while self._size > _MOST_TEXT_BYTES:
            self._size -= len(self._cached.popitem(last=False)[1][1])


class FilesAhead:
    """Reads whole files, and those that follow ahead of their turn."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._folders: OrderedDict[UrlPath, _ReadFolder] = OrderedDict()
        self._size = 0
        self._reads = 0
        self._texts = _Texts()

    def read(self, path: UrlPath) -> bytes:
        """Read a file.

        Raises:
            OSError, RemoteError: It cannot be read.
        """
        with self._lock:
            if self._process != os.getpid():
                self._process, self._size = os.getpid(), 0
                self._folders.clear()
                self._texts = _Texts()
            folder = self._folder(path.parent)
            entry = None if folder is None else folder.listing.get(path.name)
            if folder is None:
                task = None
            elif entry is None:
                raise FileNotFoundError(errno.ENOENT, 'no such file or folder', str(path))
            elif (text := self._texts.get(path, entry)) is not None:
                return text
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
        index = folder.indices.get(path.name)
        if index is None:
            return None
        task, size = folder.pending.pop(index, (None, 0))
        self._size -= size
        folder.note(index)
        self._reads += 1
        folder.used = self._reads
        passed = index - _OUT_OF_ORDER * folder.step if folder.window else None
        self._size -= folder.drop(passed)
        self._begin(path.parent, folder)
        return task

    def _folder(self, path: UrlPath) -> _ReadFolder | None:
        listing, cached = known_listing(path), self._folders.get(path)
        if cached is not None and cached.listing is not listing:  # listed again
            self._size -= cached.drop()
            del self._folders[path]
        if listing is None:
            return None
        if path not in self._folders:
            self._folders[path] = _ReadFolder(listing)
            while len(self._folders) > _MOST_FOLDERS:
                self._size -= self._folders.popitem(last=False)[1].drop()
        self._folders.move_to_end(path)
        return self._folders[path]

    def _begin(self, path: UrlPath, folder: _ReadFolder) -> None:
        """Read ahead as far as the window and the memory allow."""
        end = min((folder.last or 0) + folder.window * folder.step + 1, len(folder.names))
        while folder.window and folder.ahead + folder.step < end:
            index = folder.ahead + folder.step
            file = path / folder.names[index]
            size = folder.listing[file.name].size
            length = _UNKNOWN_BYTES if size is None else size
            if self._size + length > MOST_BYTES and not self._make_room():
                break
            folder.ahead = index
            folder.pending[index] = (BACKGROUND.submit(partial(fetch, file, size)), length)
            self._size += length

    def _make_room(self) -> bool:
        """Drop what was read ahead in a folder that is not read any more; false without one."""
        for folder in self._folders.values():
            if folder.pending and self._reads - folder.used > _IDLE_READS:
                self._size -= folder.drop()
                folder.window = 0
                return True
        return False


AHEAD = FilesAhead()
