# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to HTTP servers that are not trusted: no body of a redirect is read.

A time-out of httpx is one of silence. A server that sends its header a byte at a time is never
silent, so a timer ends the wait for it by shutting down the connections of the client.
"""

from __future__ import annotations

import socket
from contextlib import contextmanager, suppress
from threading import Lock, Timer
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import httpx

_MOST_REDIRECTS = 20
"""As httpx has it."""
_HEADER_TIMEOUTS = 2
"""A response begins within so many time-outs, all redirects and connections included."""


class HttpClient:
    """Makes requests, one at a time.

    Args:
        timeout_s: After so long a silence a request fails.

    Attributes:
        httpx: The module, which is imported by downloads only.

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
        self._client.close()

    @contextmanager
    def stream(self, method: str, url: str, headers: Mapping[str, str]) -> Iterator[httpx.Response]:
        """Open the response to a request, behind all redirects; its body is not read.

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
        """Follow redirects here: httpx reads the body of each into memory, however long it is."""
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
                # Its headers have the credentials if the server may have them.
                request = following
                response = self._client.send(request, auth=self.httpx.Auth(), stream=True)
        if response.next_request is None:
            return response
        response.close()
        raise self.httpx.TooManyRedirects('too many redirects', request=request)

    @contextmanager
    def _valid_urls(self) -> Iterator[None]:
        """Raise InvalidURL for all that a URL may be refused by: also idna and sockets do."""
        try:
            yield
        except (self.httpx.InvalidURL, ValueError, OverflowError) as error:
            raise self.httpx.InvalidURL(f'leads to an invalid URL ({error})') from error


class _Connections:
    """The connections of a client, which a timer can shut down."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._sockets: WeakSet[socket.socket] = WeakSet()
        self._number = 0
        self._ended = False

    def note(self, event: str, details: dict[str, Any]) -> None:
        """Keep the socket of a new connection; httpx calls it for each of its steps."""
        if event.endswith(('.connect_tcp.complete', '.start_tls.complete')):
            made = details['return_value'].get_extra_info('socket')
            with self._lock:
                self._sockets.add(made)
                if self._ended:
                    _shut_down(made)

    @contextmanager
    def ending_after(self, seconds: float) -> Iterator[Callable[[], bool]]:
        """Shut all down after some time in the context; yield whether it has passed."""
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
                for each in self._sockets:
                    _shut_down(each)


def _shut_down(connection: socket.socket) -> None:
    """End a connection that another thread may be reading from."""
    with suppress(OSError):  # it is closed
        # Of TLS only the connection below: the thread that reads uses its state.
        socket.socket.shutdown(connection, socket.SHUT_RDWR)
