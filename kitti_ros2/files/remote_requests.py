# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to stores: tried again when they fail for a moment, their errors as ours.

What is missing or forbidden stays an OSError with the URL as its file name, as of a local disk, so
that readers skip and count it. A store that fails again and again raises RemoteError, which ends
the run: all that follows would be lost, too.
"""

from __future__ import annotations

import errno
import random
import time
from typing import TYPE_CHECKING, TypeVar

from ..model.errors import RemoteError
from .filesystems import filesystem_of, key_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from .url_path import UrlPath

T = TypeVar('T')

TRIES = 5
_OUTER_TRIES = 2
"""Where the file system of fsspec makes several tries itself, as those of S3 and GCS do."""
_FIRST_WAIT_S = 0.2
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
"""Of aiohttp, botocore, urllib3, requests and gcsfs, none of which need be installed."""
_CREDENTIALS = frozenset({
    'NoCredentialsError', 'PartialCredentialsError', 'CredentialRetrievalError',
    'DefaultCredentialsError', 'ProfileNotFound', 'TokenRetrievalError', 'SSOTokenLoadError',
})  # fmt: skip


class ShortBodyError(OSError):
    """Fewer bytes came than the store says that the file has."""

    def __init__(self, got: int, expected: int) -> None:
        super().__init__(errno.EIO, f'{got} of {expected} bytes came')


def attempt(path: UrlPath, request: Callable[[], T]) -> T:
    """Make a request to a store, again after a pause while it fails for a moment.

    Args:
        path: What it is about.
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
        wait(_FIRST_WAIT_S * 2 ** (number - 1) * (0.5 + random.random()))  # noqa: S311 - spread


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
    for each in _causes(error):
        if isinstance(each, RemoteError):
            return each
        if type(each).__name__ in _CREDENTIALS:
            return RemoteError(
                path,
                f'no credentials ({reason})',
                'set those of the store in the environment, such as AWS_ACCESS_KEY_ID and'
                ' AWS_SECRET_ACCESS_KEY',
            )
        status = _status(each)
        if status in _KINDS:
            return _os_error(_KINDS[status], path, reason)
        if _may_pass(each, status):
            return _PassingError(_reason(each))
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
    """Whether a request may succeed when it is made again."""
    if status is not None:
        return status >= 500 or status in _BUSY
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
