# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sources of archives: HTTP servers and folders, read from any byte on."""

from __future__ import annotations

import re
import socket
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock, Timer, get_ident
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import unquote, urlsplit
from weakref import WeakSet

from ..files.remote_requests import is_passing
from ..model.errors import KittiRos2Error, UsageError, shown

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager

    import httpx


# Requests to untrusted HTTP servers: no body of a redirect is read.
#
# A time-out of httpx is one of silence. A server that sends its header byte by byte is never
# silent, so a timer ends the wait for it by shutting down the connections of the client.

_MOST_REDIRECTS = 20
"""The default of httpx."""
_HEADER_TIMEOUTS = 2
"""Time-outs until a response begins, with all redirects and connections."""


class HttpClient:
    """Makes requests, one at a time.

    Args:
        timeout_s: Seconds of silence after which a request fails.

    Attributes:
        httpx: The module, imported by downloads only.

    Raises:
        UsageError: httpx is missing.
    """

    def __init__(self, timeout_s: float) -> None:
        try:
            import httpx  # noqa: PLC0415 - it takes as long as everything else
        except ImportError:
            raise UsageError(
                'downloading needs httpx: pip install httpx, or apt install python3-httpx'
            ) from None
        self.httpx = httpx
        self._client = httpx.Client(timeout=timeout_s)
        self._timeout_s = timeout_s
        self._connections = _Connections()

    def close(self) -> None:
        """Close all connections."""
        with suppress(RuntimeError):  # httpcore before 1.0: a request is in flight, as interrupted
            self._client.close()

    @contextmanager
    def stream(self, method: str, url: str, headers: Mapping[str, str]) -> Iterator[httpx.Response]:
        """Open the response to a request, after all redirects; its body is not read.

        Raises:
            httpx.HTTPError, httpx.InvalidURL: There is none.
        """
        latest_s = _HEADER_TIMEOUTS * self._timeout_s
        with self._connections.ending_after(latest_s) as ended:
            try:
                response = self._behind_redirects(method, url, headers)
            except self.httpx.TransportError as error:
                if ended():
                    raise self.httpx.ReadTimeout(f'no response within {latest_s:g} s') from error
                raise
        try:
            yield response
        finally:
            response.close()

    def _behind_redirects(
        self, method: str, url: str, headers: Mapping[str, str]
    ) -> httpx.Response:
        """Follow redirects without their bodies: httpx reads each into memory."""
        with self._valid_urls():
            request = self._client.build_request(
                method, url, headers=headers, extensions={'trace': self._connections.note}
            )
            response = self._client.send(request, stream=True)
            for _ in range(_MOST_REDIRECTS):
                following = response.next_request
                if following is None:
                    return response
                response.close()
                # Its headers have the credentials that the server may have.
                request = following
                response = self._client.send(request, auth=self.httpx.Auth(), stream=True)
        if response.next_request is None:
            return response
        response.close()
        raise self.httpx.TooManyRedirects('too many redirects', request=request)

    @contextmanager
    def _valid_urls(self) -> Iterator[None]:
        """Raise InvalidURL also for errors of idna and sockets."""
        try:
            yield
        except (self.httpx.InvalidURL, ValueError, OverflowError) as error:
            raise self.httpx.InvalidURL(f'leads to an invalid URL ({error})') from error


class _Connections:
    """The connections of a client, shut down by a timer."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._sockets: WeakSet[socket.socket] = WeakSet()
        self._number = 0
        self._ended = False

    def note(self, event: str, details: dict[str, Any]) -> None:
        """Store the socket of a new connection; httpx calls this at each of its steps."""
        if event.endswith(('.connect_tcp.complete', '.start_tls.complete')):
            new_socket = details['return_value'].get_extra_info('socket')
            with self._lock:
                self._sockets.add(new_socket)
                if self._ended:
                    _shut_down(new_socket)

    @contextmanager
    def ending_after(self, seconds: float) -> Iterator[Callable[[], bool]]:
        """Shut all down after some time in the context; yield a check of that."""
        self._ended = False
        timer = Timer(seconds, self._end, (self._number,))
        timer.daemon = True
        timer.start()
        try:
            yield lambda: self._ended
        finally:
            timer.cancel()
            with self._lock:
                self._number += 1

    def _end(self, number: int) -> None:
        with self._lock:
            if number == self._number:
                self._ended = True
                for open_socket in self._sockets:
                    _shut_down(open_socket)


def _shut_down(connection: socket.socket) -> None:
    """End a connection that another thread may be reading."""
    with suppress(OSError):  # it is closed
        # Only the connection below TLS: the reading thread uses the state of TLS.
        socket.socket.shutdown(connection, socket.SHUT_RDWR)


# Sources of archives: HTTP servers and folders, read from any byte on.

_CHUNK_BYTES = 1 << 18
_MISSING = {403, 404, 410}
"""S3 replies 403 for a file that does not exist."""
_COUNT = '[0-9]{1,18}'
_LENGTH = re.compile(_COUNT)
_CONTENT_RANGE = re.compile(rf'bytes ({_COUNT})-{_COUNT}/({_COUNT}|\*)')
_ALL_OF = re.compile(rf'bytes \*/({_COUNT})')
_LONGEST_WAIT_S = 120.0
_HEADERS = {'Accept-Encoding': 'identity'}


class DownloadError(KittiRos2Error):
    """The archive cannot be downloaded; a retry does not help."""


class MissingArchiveError(DownloadError):
    """The archive is missing at a server or in a folder."""


class BrokenTransferError(Exception):
    """The transfer broke off, or the server is busy; a retry may help.

    Attributes:
        wait_s: Shortest wait that the server requests.
    """

    def __init__(self, reason: str, wait_s: float = 0.0) -> None:
        super().__init__(reason)
        self.wait_s = wait_s


class ChangedFileError(BrokenTransferError):
    """The file of the server changed; its download must begin again."""


@dataclass(frozen=True)
class Opened:
    """An open file.

    Attributes:
        start: First byte of the chunks: the requested one, or 0 for the whole file.
        size: Bytes of the whole file; None if unknown.
        validator: ETag or date, which changes with the file; empty without any.
        chunks: The content from start on.
    """

    start: int
    size: int | None
    validator: str
    chunks: Iterator[bytes]


class ArchiveSource(Protocol):
    """Opens files by URL."""

    def open(self, url: str, start: int, validator: str) -> AbstractContextManager[Opened]:
        """Open an unchanged file from a byte on, a changed one from its beginning.

        Raises:
            DownloadError: The file is missing or forbidden.
            BrokenTransferError: A retry may help; also from the chunks.
        """
        ...

    def size(self, url: str) -> int | None:
        """Return the size of a file; None if missing or unknown.

        Raises:
            BrokenTransferError: The server does not reply.
        """
        ...

    def close(self) -> None:
        """Break off all transfers."""
        ...


def without_password(url: str) -> str:
    """Return a URL without user and password."""
    parts = urlsplit(url)
    return parts._replace(netloc=parts.netloc.rpartition('@')[2]).geturl()


def make_source(base_url: str, timeout_s: float) -> ArchiveSource:
    """Return the source for a base URL.

    Raises:
        UsageError: The URL has an unsupported scheme, or httpx is missing.
    """
    scheme = urlsplit(base_url).scheme
    if scheme == 'file':
        return FolderSource()
    if scheme in {'http', 'https'}:
        return HttpSource(timeout_s)
    raise UsageError(
        f'base_url {without_password(base_url)} has an unsupported scheme;'
        f' give http://, https:// or file://'
    )


class FolderSource:
    """Files of a mirror on a disk."""

    @contextmanager
    def open(self, url: str, start: int, validator: str) -> Iterator[Opened]:
        """Open a file; see ArchiveSource."""
        path = Path(unquote(urlsplit(url).path))
        try:
            file = path.open('rb')
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError) as error:
            raise MissingArchiveError(f'{path}: no such file') from error
        with file:
            state = path.stat()
            current = f'{state.st_size} {state.st_mtime_ns}'
            start = start if validator == current else 0
            file.seek(start)
            chunks = iter(lambda: file.read(_CHUNK_BYTES), b'')
            yield Opened(start, state.st_size, current, chunks)

    def size(self, url: str) -> int | None:
        """Return the size of a file; see ArchiveSource."""
        path = Path(unquote(urlsplit(url).path))
        return path.stat().st_size if path.is_file() else None

    def close(self) -> None:
        """Do nothing: no file is open between two chunks."""


class HttpSource:
    """Files of an HTTP server.

    Raises:
        UsageError: httpx is missing.
    """

    def __init__(self, timeout_s: float) -> None:
        client = HttpClient(timeout_s)
        self._httpx = client.httpx
        self._timeout_s = timeout_s
        self._clients = {get_ident(): client}
        self._closed = False

    def size(self, url: str) -> int | None:
        """Return the size of a file; see ArchiveSource."""
        try:
            with self._client().stream('HEAD', url, _HEADERS) as response:
                for _ in response.iter_raw():  # empty; the connection stays open
                    pass
                return _declared_size(response) if response.status_code == 200 else None
        except self._httpx.InvalidURL:
            return None
        except self._httpx.HTTPError as error:
            raise BrokenTransferError(str(error)) from error

    def close(self) -> None:
        """Close all connections."""
        self._closed = True
        for client in list(self._clients.values()):
            client.close()

    def _client(self) -> HttpClient:
        """Return the client of this thread."""
        thread = get_ident()
        if thread not in self._clients:
            self._clients[thread] = HttpClient(self._timeout_s)
            if self._closed:
                self._clients[thread].close()
        return self._clients[thread]

    @contextmanager
    def open(self, url: str, start: int, validator: str) -> Iterator[Opened]:
        """Open a file; see ArchiveSource."""
        headers = _HEADERS
        if start:
            headers = headers | {'Range': f'bytes={start}-', 'If-Range': validator}
        try:
            with self._client().stream('GET', url, headers) as response:
                yield self._opened(response, url, start)
        except self._httpx.TooManyRedirects as error:
            raise DownloadError(f'{without_password(url)}: redirects without an end') from error
        except (self._httpx.UnsupportedProtocol, self._httpx.InvalidURL) as error:
            raise DownloadError(f'{without_password(url)}: {error}') from error
        except self._httpx.HTTPError as error:
            reason = str(error) or type(error).__name__
            raise BrokenTransferError(reason) from error

    def _opened(self, response: httpx.Response, url: str, start: int) -> Opened:
        if url.startswith('https:') and response.url.scheme != 'https':
            target = without_password(str(response.url))
            raise DownloadError(f'{url}: redirects to {target}, which is not encrypted')
        headers = response.headers
        validator = headers.get('ETag', '')
        if not validator or validator.startswith('W/'):  # If-Range takes strong validators only
            validator = headers.get('Last-Modified', '')
        code = response.status_code
        if code in {200, 206}:
            _check_coding(response, url)
        if code == 206:
            return _opened_part(response, validator, start)
        if code == 416:
            match = _ALL_OF.fullmatch(headers.get('Content-Range', ''))
            if match is not None and int(match[1]) == start:
                return Opened(start, start, validator, iter(()))
            raise ChangedFileError('the server has less than before')
        _check_status(response, url)
        return Opened(0, _declared_size(response), validator, response.iter_raw())


def _declared_size(response: httpx.Response) -> int | None:
    length = response.headers.get('Content-Length', '')
    return int(length) if _LENGTH.fullmatch(length) else None


def _opened_part(response: httpx.Response, validator: str, start: int) -> Opened:
    match = _CONTENT_RANGE.fullmatch(response.headers.get('Content-Range', ''))
    if match is None or int(match[1]) != start:
        raise BrokenTransferError('the server sent another part than was requested')
    size = None if match[2] == '*' else int(match[2])
    return Opened(start, size, validator, response.iter_raw())


def _check_coding(response: httpx.Response, url: str) -> None:
    """Check that the content is sent uncompressed.

    Compressed content has no known size, cannot be continued, and may expand a million times.
    Archives are compressed already, and no coding was requested.

    Raises:
        DownloadError: It is compressed.
    """
    coding = response.headers.get('Content-Encoding', '').strip()
    if coding.lower() not in {'', 'identity'}:
        raise DownloadError(
            f'{without_password(url)}: the server compresses the archive (Content-Encoding'
            f' {shown(coding)}), which was not requested; give another server by --base-url'
        )


def _check_status(response: httpx.Response, url: str) -> None:
    """Check that a response has the file.

    Raises:
        DownloadError: It does not.
        BrokenTransferError: It may, if the request is repeated.
    """
    code = response.status_code
    what = f'{without_password(url)}: the server replies {code} {response.reason_phrase}'.rstrip()
    if is_passing(code):
        wait = response.headers.get('Retry-After', '')
        wait_s = min(float(wait), _LONGEST_WAIT_S) if wait.isdecimal() else 0.0
        raise BrokenTransferError(what, wait_s)
    if code in _MISSING:
        raise MissingArchiveError(what)
    if code != 200:
        raise DownloadError(what)
