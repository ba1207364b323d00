# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Requests to HTTP servers that are not trusted: no body of a redirect is read."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import httpx

_MOST_REDIRECTS = 20
"""As httpx has it."""


class HttpClient:
    """Makes requests.

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

    def close(self) -> None:
        """Close all connections."""
        self._client.close()

    @contextmanager
    def stream(self, method: str, url: str, headers: Mapping[str, str]) -> Iterator[httpx.Response]:
        """Open the response to a request, behind all redirects; its body is not read.

        Raises:
            httpx.HTTPError, httpx.InvalidURL: There is none.
        """
        response = self._behind_redirects(method, url, headers)
        try:
            yield response
        finally:
            response.close()

    def _behind_redirects(
        self, method: str, url: str, headers: Mapping[str, str]
    ) -> httpx.Response:
        """Follow redirects here: httpx reads the body of each into memory, however long it is."""
        with self._valid_urls():
            request = self._client.build_request(method, url, headers=headers)
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
