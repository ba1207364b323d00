# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of a store: asked for anew, written, removed; requests that fail are tried again."""

from __future__ import annotations

import base64
import hashlib
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..model.errors import OutputError, RemoteError, describe_error
from .filesystems import filesystem_of, key_of
from .remote_requests import attempt

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from .filesystems import FileSystem
    from .url_path import UrlPath

_ERRORS = (OSError, RemoteError)
_READ_ONLY = ('http', 'https')


@dataclass(frozen=True)
class StoredObject:
    """An object as a listing shows it.

    Attributes:
        size: In bytes.
        digest: MD5 of its content as hexadecimal digits, or that of S3's multipart uploads (MD5 of
            the parts' MD5, `-`, the number of parts); empty where the store has none.
    """

    size: int
    digest: str = ''


class StoreError(OutputError):
    """A store refuses a request about an output, or does not answer.

    Attributes:
        reason: What the store says.
    """

    def __init__(self, path: UrlPath, error: Exception, *, remains: str = '') -> None:
        self.reason = describe_error(error).removeprefix(f'{path}: ')
        super().__init__(
            path,
            f'cannot be written ({self.reason})',
            'check the address, the credentials and the network, and run it again',
        )
        if remains:
            self.leave(remains)


def refuse_read_only(path: UrlPath) -> None:
    """Refuse a URL that cannot be an output.

    Raises:
        OutputError: Its scheme cannot be written, or it names a whole bucket.
        UsageError: A package is missing, or the scheme is unknown.
    """
    if path.scheme in _READ_ONLY:
        raise OutputError(
            path, f'{path.scheme}:// is for reading', 'give a URL of a store, or a local path'
        )
    if not path.parent.name:
        raise OutputError(path, 'is a whole bucket', f'give a name in it, such as {path / "out"}')
    filesystem_of(path)


def objects_at(path: UrlPath) -> dict[str, StoredObject]:
    """Return the objects at and below a path, by the name below it; its own name is empty.

    Raises:
        StoreError: The store cannot be asked.
    """
    system, key = filesystem_of(path), key_of(path)

    def ask() -> Mapping[str, Any]:
        system.invalidate_cache()
        if hasattr(system, 'call_s3'):
            return dict(_listed_s3(system, key))
        # Of an object and a folder of one name, find shows the folder only.
        own = {key: system.info(key)} if system.isfile(key) else {}
        return {**system.find(key, detail=True), **own}

    try:
        found = attempt(path, ask)
    except FileNotFoundError:
        return {}
    except _ERRORS as error:
        raise StoreError(path, error) from error
    return {
        name[len(key) :].lstrip('/'): _stored(entry)
        for name, entry in found.items()
        if name == key or name.startswith(f'{key}/')
    }


def object_at(path: UrlPath) -> StoredObject | None:
    """Return one object; None if there is none of that name.

    Raises:
        StoreError: The store cannot be asked.
    """
    system, key = filesystem_of(path), key_of(path)

    def ask() -> Mapping[str, Any]:
        system.invalidate_cache()
        if hasattr(system, 'call_s3'):  # info asks twice
            bucket, name, _ = system.split_path(key)
            answer = system.call_s3('head_object', Bucket=bucket, Key=name)
            return {**answer, 'size': answer['ContentLength'], 'type': 'file'}
        entry: Mapping[str, Any] = system.info(key)
        return entry

    try:
        entry = attempt(path, ask)
    except FileNotFoundError:
        return None
    except _ERRORS as error:
        raise StoreError(path, error) from error
    return _stored(entry) if entry['type'] == 'file' else None


def read_object(path: UrlPath) -> bytes | None:
    """Return the content of a small object; None if there is none.

    Raises:
        StoreError: The store cannot be asked.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        return bytes(attempt(path, lambda: system.cat_file(key)))
    except FileNotFoundError:
        return None
    except _ERRORS as error:
        raise StoreError(path, error) from error


def write_object(path: UrlPath, data: bytes) -> None:
    """Write a small object.

    Raises:
        StoreError: The store refuses.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        attempt(path, lambda: system.pipe_file(key, data))
    except _ERRORS as error:
        raise StoreError(path, error) from error


def create_object(path: UrlPath, data: bytes) -> bool:
    """Write a small object unless there is one; return whether it is this one now.

    The store compares and writes in one step if it knows conditional requests (S3, Google Cloud
    Storage); for others two requests are needed, and another program may come in between.

    Raises:
        StoreError: The store refuses.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        attempt(path, lambda: system.pipe_file(key, data, mode='create'))
    except (*_ERRORS, TypeError):  # there is one, or conditions are unknown to the file system
        if read_object(path) is None:
            write_object(path, data)
    # The answer to a request that was carried out may have been lost.
    return read_object(path) == data


def remove_objects(paths: Iterable[UrlPath]) -> None:
    """Remove objects; those that are absent are no error.

    Raises:
        StoreError: The store refuses.
    """
    for path in paths:
        system, key = filesystem_of(path), key_of(path)
        try:
            with suppress(FileNotFoundError):
                attempt(path, lambda system=system, key=key: system.rm_file(key))  # type: ignore[misc]
        except _ERRORS as error:
            raise StoreError(path, error) from error


def md5_of(data: bytes) -> bytes:
    """Return the MD5 of bytes, which stores use as a checksum."""
    return hashlib.md5(data, usedforsecurity=False).digest()


def _listed_s3(system: FileSystem, key: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the objects at and below a key; more whose names begin like it."""
    bucket, prefix, _ = system.split_path(key)
    more: dict[str, str] = {}
    while True:
        page = system.call_s3('list_objects_v2', Bucket=bucket, Prefix=prefix, **more)
        for entry in page.get('Contents', ()):
            yield f'{bucket}/{entry["Key"]}', {**entry, 'size': entry['Size']}
            if entry['Key'] > f'{prefix}0':  # all of `prefix/...` come before
                return
        if not page.get('IsTruncated'):
            return
        more = {'ContinuationToken': page['NextContinuationToken']}


def _stored(entry: Mapping[str, Any]) -> StoredObject:
    return StoredObject(int(entry['size'] or 0), _digest(entry))


def _digest(entry: Mapping[str, Any]) -> str:
    """Return the digest in an entry of S3 (ETag) or Google Cloud Storage (md5Hash)."""
    if 'md5Hash' in entry:
        return base64.b64decode(entry['md5Hash']).hex()
    tag = str(entry.get('ETag', '')).strip('"').lower()
    return tag if len(tag.partition('-')[0]) == 32 else ''
