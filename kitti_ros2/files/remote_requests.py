# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to stores by fsspec: tried again when they fail for a moment, their errors as ours.

What is missing or forbidden stays an OSError with the URL as its file name, as of a local disk, so
that readers skip and count it. A store that fails again and again raises RemoteError, which ends
the run: all that follows would be lost, too.
"""

from __future__ import annotations

import base64
import errno
import hashlib
import math
import os
import random
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from ..model.errors import OutputError, RemoteError, UsageError, describe_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from .url_path import UrlPath


FileSystem: TypeAlias = Any
"""fsspec's AbstractFileSystem, which has no types."""

_PACKAGES = {'gs': 'gcsfs', 'gcs': 'gcsfs', 'abfs': 'adlfs', 'az': 'adlfs', 'sftp': 'paramiko'}
"""Packages of schemes that the extra does not install."""


def filesystem_of(path: UrlPath) -> FileSystem:
    """Return fsspec's file system of a path, the same for all paths of one store.

    Raises:
        UsageError: A package is missing, or the scheme is unknown.
    """
    return _filesystem(path.scheme, path.names[0] if path.names else '', os.getpid())


@lru_cache(maxsize=64)
def _filesystem(scheme: str, host: str, process: int) -> FileSystem:  # noqa: ARG001 - not shared
    root = f'{scheme}://{host}'
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415 - for URLs only
        from fsspec.registry import known_implementations, registry  # noqa: PLC0415 - as above
    except ImportError:
        raise UsageError(
            f'{root}: URLs need fsspec, which is not installed; run pip install'
            f" 'kitti_ros2[remote]'"
        ) from None
    if scheme not in known_implementations and scheme not in registry:
        raise UsageError(f'{root}: unknown scheme {scheme}://; known are s3, gs, http and https')
    try:
        return url_to_fs(root, **_options(scheme))[0]
    except ImportError as error:
        package = _PACKAGES.get(scheme)
        install = f'pip install {package}' if package else "pip install 'kitti_ros2[remote]'"
        reason = ' '.join(str(error).split())
        raise UsageError(f'{root}: needs a package, run {install} ({reason})') from None


def _options(scheme: str) -> dict[str, Any]:
    """Return the options of a file system.

    Raises:
        ImportError: A package is missing.
    """
    if scheme not in {'http', 'https'}:
        return {}
    from .http_session import open_session  # noqa: PLC0415 - it needs aiohttp

    return {'get_client': open_session}


def key_of(path: UrlPath) -> str:
    """Return the name that the methods of fsspec's file system take."""
    return str(filesystem_of(path)._strip_protocol(path.whole))  # noqa: SLF001 - fsspec's own way


# Requests to stores: tried again when they fail for a moment, their errors as ours.
#
# What is missing or forbidden stays an OSError with the URL as its file name, as of a local disk,
# so that readers skip and count it. A store that fails again and again raises RemoteError, which
# ends the run: all that follows would be lost, too.

T = TypeVar('T')

TRIES = 5
_OUTER_TRIES = 2
"""Tries with a file system of fsspec that tries again itself, as those of S3 and GCS do."""
_FIRST_WAIT_S = 0.2
_LONGEST_WAIT_S = 60.0
_PASSING = frozenset(
    getattr(errno, name)
    for name in (
        'EIO', 'EREMOTEIO', 'EBUSY', 'EAGAIN', 'ETIMEDOUT', 'ECONNRESET', 'ECONNABORTED',
        'ECONNREFUSED', 'EPIPE', 'ENETUNREACH', 'ENETDOWN', 'EHOSTUNREACH',
    )
    if hasattr(errno, name)
)  # fmt: skip
_BUSY = (408, 425, 429)
_KINDS: dict[int | None, type[OSError]] = {
    401: PermissionError,
    403: PermissionError,
    404: FileNotFoundError,
    410: FileNotFoundError,
}
_PASSING_NAMES = frozenset({
    'ClientPayloadError', 'ConnectionClosedError', 'ConnectTimeoutError', 'EndpointConnectionError',
    'HTTPClientError', 'IncompleteRead', 'IncompleteReadError', 'ReadTimeoutError',
    'ResponseParserError', 'ServerDisconnectedError', 'ServerTimeoutError', 'ClientConnectorError',
    'ClientOSError', 'ClientConnectionError', 'ConnectionError', 'ChunkedEncodingError',
    'TransferEncodingError', 'ContentLengthError', 'FSTimeoutError', 'TimeoutError',
})  # fmt: skip
"""Errors of aiohttp, botocore, urllib3, requests and gcsfs, none of which need be installed."""
_CREDENTIALS = frozenset({
    'NoCredentialsError', 'PartialCredentialsError', 'CredentialRetrievalError',
    'DefaultCredentialsError', 'ProfileNotFound', 'TokenRetrievalError', 'SSOTokenLoadError',
})  # fmt: skip


class ShortBodyError(OSError):
    """Fewer bytes came than the store lists for the file."""

    def __init__(self, got: int, expected: int) -> None:
        super().__init__(errno.EIO, f'{got} of {expected} bytes came')


def attempt(path: UrlPath, request: Callable[[], T]) -> T:
    """Make a request to a store, again after a pause while it fails for a moment.

    Args:
        path: The file or folder.
        request: Makes it; called up to TRIES times.

    Raises:
        FileNotFoundError, PermissionError, OSError: With the URL as file name.
        RemoteError: It failed each time, or for a reason that is not of this file.
    """
    tries = _OUTER_TRIES if hasattr(filesystem_of(path), 'retries') else TRIES
    number = 0
    while True:
        number += 1
        try:
            return request()
        except Exception as error:  # noqa: BLE001 - of any package; what is not known is not hidden
            failure = _failure(path, error)
        if not isinstance(failure, _PassingError):
            raise failure
        if number == tries:
            raise RemoteError(path, f'{failure.reason}, {tries} times', 'try again later')
        wait(retry_wait_s(number, _FIRST_WAIT_S))


def retry_wait_s(attempt: int, first_s: float) -> float:
    """Return the seconds after a failed attempt, the first of which is 1, until the next one.

    They are doubled each time, up to a minute, and varied so that clients do not collide.
    """
    spread = random.uniform(0.5, 1.5)  # noqa: S311 - no secret
    return min(math.ldexp(first_s, attempt - 1), _LONGEST_WAIT_S) * spread


def is_passing(status: int) -> bool:
    """Return whether the same request may get another status later."""
    return status >= 500 or status in _BUSY


def wait(seconds: float) -> None:
    """Wait before the next try."""
    time.sleep(seconds)


def fetch(path: UrlPath, size: int | None = None) -> bytes:
    """Read a whole file.

    Args:
        path: The file.
        size: In bytes, as its folder lists it; None if unknown.

    Raises:
        OSError, RemoteError: As attempt.
    """
    files, key = filesystem_of(path), key_of(path)

    def request() -> bytes:
        data = bytes(files.cat_file(key))
        if size is not None and len(data) != size:
            # It may have been replaced since it was listed.
            now = _size_now(files, key)
            if now is not None and len(data) != now:
                raise ShortBodyError(len(data), now)
        return data

    return attempt(path, request)


def fetch_range(path: UrlPath, start: int, end: int) -> bytes:
    """Read the bytes from start up to end, which is at most the size of the file.

    A web server without ranges returns more: the whole file.

    Raises:
        OSError, RemoteError: As attempt.
    """
    files, key = filesystem_of(path), key_of(path)

    def request() -> bytes:
        data = bytes(files.cat_file(key, start=start, end=end))
        if len(data) < end - start:
            raise ShortBodyError(len(data), end - start)
        return data

    return attempt(path, request)


def _size_now(files: object, key: str) -> int | None:
    """Ask a store for the size of a file, past its cache."""
    files.invalidate_cache(files._parent(key))  # type: ignore[attr-defined] # noqa: SLF001 - fsspec's own way
    size = files.info(key).get('size')  # type: ignore[attr-defined]
    return None if size is None else int(size)


class _PassingError(Exception):
    """A failure that may pass."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def _failure(path: UrlPath, error: Exception) -> Exception:
    """Return what to raise for the error of a request: _PassingError if it may pass."""
    reason = _reason(error)
    for cause in _causes(error):
        if isinstance(cause, RemoteError):
            return cause
        if type(cause).__name__ in _CREDENTIALS:
            return RemoteError(
                path,
                f'no credentials ({reason})',
                'set those of the store in the environment, such as AWS_ACCESS_KEY_ID and'
                ' AWS_SECRET_ACCESS_KEY',
            )
        status = _status(cause)
        if status in _KINDS:
            return _os_error(_KINDS[status], path, reason)
        if _may_pass(cause, status):
            return _PassingError(_reason(cause))
    for kind in (PermissionError, FileNotFoundError, IsADirectoryError, NotADirectoryError):
        if isinstance(error, kind):
            return _os_error(kind, path, reason)
    return RemoteError(path, reason)


def _causes(error: Exception) -> list[BaseException]:
    """Return an error and its causes, the first cause first.

    A file system of fsspec may turn any error of a server into FileNotFoundError.
    """
    causes: list[BaseException] = [error]
    while causes[0].__cause__ is not None:
        causes.insert(0, causes[0].__cause__)
    return causes


def _may_pass(error: BaseException, status: int | None) -> bool:
    """Return whether a request may succeed when it is made again."""
    if status is not None:
        return is_passing(status)
    if isinstance(error, OSError) and error.errno in _PASSING:
        return True
    return isinstance(error, (TimeoutError, ConnectionError)) or any(
        kind.__name__ in _PASSING_NAMES for kind in type(error).__mro__
    )


def _os_error(kind: type[OSError], path: UrlPath, reason: str) -> OSError:
    """Return an error of the operating system with the URL as file name."""
    if kind is PermissionError:
        return kind(errno.EACCES, f'access denied ({reason})', str(path))
    if kind is FileNotFoundError:
        no_bucket = 'bucket does not exist' in reason or 'NoSuchBucket' in reason
        return kind(
            errno.ENOENT, 'no such bucket' if no_bucket else 'no such file or folder', str(path)
        )
    return kind(errno.EIO, reason, str(path))


def _status(error: BaseException) -> int | None:
    """Return the status of HTTP in an error of a package, if it has one."""
    status = getattr(error, 'status', None) or getattr(error, 'code', None)
    response = getattr(error, 'response', None)
    if isinstance(response, dict):
        status = response.get('ResponseMetadata', {}).get('HTTPStatusCode')
    try:
        return int(status) if status is not None else None
    except (TypeError, ValueError):
        return None


def _reason(error: BaseException) -> str:
    """Return the text of an error in one line, without what may be secret."""
    text = ' '.join(str(getattr(error, 'strerror', None) or error).split())
    if isinstance(error, TimeoutError) or type(error).__name__ == 'FSTimeoutError':
        return f'no answer in time ({text})' if text else 'no answer in time'
    return _masked(text) or type(error).__name__


def _masked(text: str) -> str:
    """Return a text without the parameters of URLs, which may be signatures."""
    words = text.split(' ')
    return ' '.join(
        word.partition('?')[0] + '?...' if '://' in word and '?' in word else word for word in words
    )


# Objects of a store: asked for anew, written, removed; requests that fail are tried again.

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
        reason: The reason that the store gives.
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
        entries = attempt(path, ask)
    except FileNotFoundError:
        return {}
    except _ERRORS as error:
        raise StoreError(path, error) from error
    return {
        name[len(key) :].lstrip('/'): _stored(entry)
        for name, entry in entries.items()
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
