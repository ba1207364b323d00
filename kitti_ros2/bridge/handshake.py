# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The request of a WebSocket handshake (RFC 6455 section 4.2.1), and answers that refuse it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from http import HTTPStatus

END = b'\r\n\r\n'
HEAD_LIMIT = 16384
"""Bytes of a request. Browsers send about 600, more with the cookies of localhost."""

_VERSION = '13'
_METHOD = b'GET '
_REQUEST_LINE = re.compile(r'GET [!-~]+ HTTP/1\.1')
_HEADER = re.compile(r"([!#$%&'*+.^_`|~0-9A-Za-z-]+):[ \t]*(.*?)[ \t]*")
_ONCE = ('host', 'origin', 'sec-websocket-key', 'sec-websocket-version')


class RefusedError(Exception):
    """A handshake that is answered with an error.

    Args:
        status: Of the answer.
        reason: One line, the body of the answer.
    """

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status = status
        self.reason = reason

    def answer(self) -> bytes:
        """Return the HTTP response; it allows no page to read it (no CORS header)."""
        body = f'{self.reason}\n'.encode()
        version = ''
        if self.status is HTTPStatus.UPGRADE_REQUIRED:
            version = f'Upgrade: websocket\r\nSec-WebSocket-Version: {_VERSION}\r\n'
        head = (
            f'HTTP/1.1 {self.status.value} {self.status.phrase}\r\n'
            f'Content-Type: text/plain; charset=utf-8\r\nContent-Length: {len(body)}\r\n'
            f'{version}Connection: close\r\n\r\n'
        )
        return head.encode() + body


@dataclass(frozen=True)
class Handshake:
    """The headers that decide about a handshake.

    Attributes:
        host: Host, with its port if it has one.
        origin: Origin; None from programs that are not browsers.
    """

    host: str
    origin: str | None


def is_complete(received: bytes | bytearray) -> bool:
    """Whether a request has been received to its end.

    Raises:
        RefusedError: It cannot become a handshake: too long, or not HTTP.
    """
    if not _METHOD.startswith(received[: len(_METHOD)]):
        raise RefusedError(
            HTTPStatus.BAD_REQUEST, 'this is a WebSocket server without TLS: ws://, and GET only'
        )
    end = received.find(END)
    if end < 0 and len(received) < HEAD_LIMIT:
        return False
    if end < 0 or end > HEAD_LIMIT:
        raise RefusedError(
            HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
            f'the headers are longer than {HEAD_LIMIT} bytes',
        )
    if end + len(END) != len(received):
        raise _malformed('data before the answer to the handshake')
    return True


def parse(received: bytes | bytearray) -> Handshake:
    """Parse a complete request.

    Raises:
        RefusedError: It is no handshake of WebSocket version 13.
    """
    first, *lines = bytes(received[: -len(END)]).decode('latin-1').split('\r\n')
    if not _REQUEST_LINE.fullmatch(first):
        raise _malformed('the request line is not GET PATH HTTP/1.1')
    headers: dict[str, str] = {}
    for line in lines:
        found = _HEADER.fullmatch(line)
        if found is None:
            raise _malformed('a line is not NAME: VALUE')
        name = found[1].lower()
        if name in headers and name in _ONCE:
            raise _malformed(f'the header {name} is repeated')
        headers[name] = f'{headers[name]}, {found[2]}' if name in headers else found[2]
    if headers.get('upgrade', '').lower() != 'websocket':
        raise RefusedError(
            HTTPStatus.UPGRADE_REQUIRED, 'this is a WebSocket server; open its address in a viewer'
        )
    if headers.get('sec-websocket-version') != _VERSION:
        raise RefusedError(HTTPStatus.UPGRADE_REQUIRED, 'WebSocket version 13 is required')
    if not headers.get('host'):
        raise _malformed('the header host is missing')
    return Handshake(headers['host'], headers.get('origin'))


def _malformed(what: str) -> RefusedError:
    return RefusedError(HTTPStatus.BAD_REQUEST, f'invalid handshake: {what}')
