# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Listings of folders in stores, one request for each folder and process.

Whether a name exists, is a folder, and how long a file is, all come from the listing of its folder.
"""

from __future__ import annotations

import errno
import re
from contextlib import suppress
from datetime import datetime, timezone
from email.utils import parsedate_to_datetime
from threading import RLock
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote

from ..model.errors import RemoteError
from .filesystems import filesystem_of, key_of
from .remote_requests import attempt

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .url_path import UrlPath

_HTTP = ('http', 'https')
_SUFFIX = re.compile(r'\.[A-Za-z][A-Za-z0-9]{1,7}', re.ASCII)


class RemoteEntry(NamedTuple):
    """What a store says of a name.

    Attributes:
        is_folder: Whether it is a folder.
        size: Of a file, bytes; None where listings have none.
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
"""Of all listings that are kept; fsspec keeps about 1 KB for each."""


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


_KNOWN = _Listings()


def forget(path: UrlPath) -> None:
    """Forget what was listed at a path, below it, and in its folder: it may have changed."""
    files = filesystem_of(path)
    with _KNOWN.lock:
        gone = {each for each in _KNOWN.folders if path in each.parents} | {path, path.parent}
        for each in gone:
            _KNOWN.folders.pop(each, None)
            if each.names:
                files.invalidate_cache(key_of(each))
        for each in {each for each in _KNOWN.alone if path in {each, *each.parents}}:
            del _KNOWN.alone[each]
        _KNOWN.closed -= gone


def listing_of(folder: UrlPath) -> Mapping[str, RemoteEntry]:
    """Return the entries of a folder by name, sorted.

    Raises:
        FileNotFoundError: There is no such folder.
        NotADirectoryError: It is a file.
        OSError, RemoteError: The store cannot be asked, or has no listings.
    """
    with _KNOWN.lock:
        if not folder.names:
            return {}
        if folder not in _KNOWN.folders:
            above = _known_above(folder)
            if above is not None and not entry_of(folder).is_folder:
                raise NotADirectoryError(errno.ENOTDIR, 'is not a folder', str(folder))
            if above is None and _KNOWN.alone.get(folder, _FOLDER) is None:
                raise _missing(folder)
            try:
                found = _listed(folder)
            except FileNotFoundError:
                _KNOWN.alone[folder] = None
                raise
            if found is None:
                raise NotADirectoryError(errno.ENOTDIR, 'is not a folder', str(folder))
            _KNOWN.keep(folder, found)
        return _KNOWN.folders[folder]


def entry_of(path: UrlPath) -> RemoteEntry:
    """Return what the store says of a path.

    Raises:
        FileNotFoundError: There is nothing.
        OSError, RemoteError: The store cannot be asked.
    """
    with _KNOWN.lock:
        found = _entry_of(path)
    if found is None:
        raise _missing(path)
    return found


def _entry_of(path: UrlPath) -> RemoteEntry | None:
    if not path.names or path in _KNOWN.folders:
        return _FOLDER
    above = None if path.parameters else _known_above(path)
    if above is not None:
        for name in path.names[len(above.names) :]:
            entry = listing_of(above).get(name)
            above /= name
            if entry is None or not entry.is_folder:
                return entry if above == path else None
        return _FOLDER
    if path not in _KNOWN.alone:
        beside = any(each.parent == path.parent for each in _KNOWN.folders)
        if beside and path.parent not in _KNOWN.closed and not path.parameters:
            # More of the folder will be asked for: it is listed once.
            try:
                return listing_of(path.parent).get(path.name)
            except (OSError, RemoteError):
                _KNOWN.closed.add(path.parent)
        _KNOWN.alone[path] = _asked(path)
    return _KNOWN.alone[path]


def _known_above(path: UrlPath) -> UrlPath | None:
    """Return the nearest folder above whose listing is known."""
    return next((each for each in path.parents if each in _KNOWN.folders), None)


def _missing(path: UrlPath) -> FileNotFoundError:
    return FileNotFoundError(errno.ENOENT, 'no such file or folder', str(path))


def sized_entry_of(path: UrlPath) -> RemoteEntry:
    """Return what the store says of a path, with a file's size also where listings have none.

    Raises:
        FileNotFoundError: There is nothing.
        OSError, RemoteError: The store cannot be asked.
    """
    found = entry_of(path)
    if found.is_folder or found.size is not None:
        return found
    with _KNOWN.lock:
        known = _KNOWN.alone.get(path)
        if known is None:
            known = _KNOWN.alone[path] = _described(path)
    return known


def known_listing(folder: UrlPath) -> Mapping[str, RemoteEntry] | None:
    """Return the entries of a folder if it was listed; nothing is asked."""
    with _KNOWN.lock:
        return _KNOWN.folders.get(folder)


def _asked(path: UrlPath) -> RemoteEntry | None:
    """Ask for a path on its own: first what its name looks like, a file or a folder."""
    looks_like_file = bool(_SUFFIX.fullmatch(path.suffix)) or path.scheme in _HTTP
    try:
        if not looks_like_file:
            found = _listed(path)
            if found is not None:
                _KNOWN.keep(path, found)
                return _FOLDER
        entry = _described(path)
        if entry.is_folder:
            _KNOWN.keep(path, _listed(path) or {})
    except FileNotFoundError:
        return None
    return entry


def _described(path: UrlPath) -> RemoteEntry:
    """Ask a store for the description of a path; of a web server, a page with links is a folder."""
    files, key = filesystem_of(path), key_of(path)
    info = attempt(path, lambda: files.info(key))
    if path.scheme in _HTTP and info.get('mimetype') == 'text/html' and not path.parameters:
        with suppress(OSError, RemoteError):
            _KNOWN.keep(path, _listed(path) or {})
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
