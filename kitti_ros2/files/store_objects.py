# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of a store: asked for anew, written, removed; each request is repeated if it fails.

fsspec's file systems repeat requests themselves where they know that the store failed. What they
pass on is tried again here, unless it is an answer: no permission, no such bucket.
"""

from __future__ import annotations

import base64
import hashlib
import random
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from ..model.errors import KittiRos2Error, OutputError
from .remote import filesystem_of, key_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from .remote import FileSystem, RemotePath

T = TypeVar('T')

ATTEMPTS = 4
FIRST_WAIT_S = 0.25
_ANSWERS = (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError)
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
    """A store refuses a request, or does not answer."""

    def __init__(self, path: RemotePath, error: Exception, *, remains: str = '') -> None:
        self.path = str(path)
        reason = ' '.join(str(error).split()) or type(error).__name__
        left = remains or 'nothing was left behind'
        KittiRos2Error.__init__(
            self,
            f'{path}: cannot be written ({reason}); {left}'
            f' (check the address, the credentials and the network, and run it again)',
        )
        self.reason = reason


def persistently(request: Callable[[], T]) -> T:
    """Return the result of a request; repeat it after errors that may pass.

    Raises:
        Exception: That of the last attempt.
    """
    for attempt in range(1, ATTEMPTS):
        try:
            return request()
        except (KittiRos2Error, *_ANSWERS):
            raise
        except Exception:  # noqa: BLE001 - file systems raise what their libraries raise
            time.sleep(FIRST_WAIT_S * 2**attempt * (0.5 + random.random() / 2))  # noqa: S311
    return request()


def refuse_read_only(path: RemotePath) -> None:
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


def objects_at(path: RemotePath) -> dict[str, StoredObject]:
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
        found = persistently(ask)
    except FileNotFoundError:
        return {}
    except KittiRos2Error:
        raise
    except Exception as error:
        raise StoreError(path, error) from error
    return {
        name[len(key) :].lstrip('/'): _stored(entry)
        for name, entry in found.items()
        if name == key or name.startswith(f'{key}/')
    }


def object_at(path: RemotePath) -> StoredObject | None:
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
        entry = persistently(ask)
    except FileNotFoundError:
        return None
    except Exception as error:
        raise StoreError(path, error) from error
    return _stored(entry) if entry['type'] == 'file' else None


def read_object(path: RemotePath) -> bytes | None:
    """Return the content of a small object; None if there is none.

    Raises:
        StoreError: The store cannot be asked.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        return bytes(persistently(lambda: system.cat_file(key)))
    except FileNotFoundError:
        return None
    except Exception as error:
        raise StoreError(path, error) from error


def write_object(path: RemotePath, data: bytes) -> None:
    """Write a small object.

    Raises:
        StoreError: The store refuses.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        persistently(lambda: system.pipe_file(key, data))
    except Exception as error:
        raise StoreError(path, error) from error


def create_object(path: RemotePath, data: bytes) -> bool:
    """Write a small object unless there is one; return whether it is this one now.

    The store compares and writes in one step if it knows conditional requests (S3, Google Cloud
    Storage); for others two requests are needed, and another program may come in between.

    Raises:
        StoreError: The store refuses.
    """
    system, key = filesystem_of(path), key_of(path)
    try:
        persistently(lambda: system.pipe_file(key, data, mode='create'))
    except FileExistsError:
        pass
    except Exception:  # noqa: BLE001 - a store without conditional requests
        if read_object(path) is None:
            write_object(path, data)
    # The answer to a request that was carried out may have been lost.
    return read_object(path) == data


def remove_objects(paths: Iterable[RemotePath]) -> None:
    """Remove objects; those that are absent are no error.

    Raises:
        StoreError: The store refuses.
    """
    for path in paths:
        system, key = filesystem_of(path), key_of(path)
        try:
            with suppress(FileNotFoundError):
                persistently(lambda system=system, key=key: system.rm_file(key))  # type: ignore[misc]
        except Exception as error:
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
