# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The WebSocket protocol (RFC 6455): frames, the handshake, and which web pages may connect."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from enum import Enum
from http import HTTPStatus
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import TYPE_CHECKING, TypeAlias

from ..model.errors import UsageError

if TYPE_CHECKING:
    import socket


# WebSocket frames in a stream of bytes (RFC 6455 section 5.2), and which of them may be dropped.
#
# Opcodes of Foxglove's protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md


_RECEIVE = 65536
_SHORT, _LONG = 126, 127
_FIN_BINARY = 0x82
_MESSAGE_DATA, _TIME = 1, 2
_FIRST_CONTROL = 8
_TIME_FRAME = struct.Struct('<BBBQ')


class FrameKind(Enum):
    """What a frame of the server is for."""

    MESSAGE = 'message'
    TIME = 'time'
    CONTROL = 'control'


class FrameError(Exception):
    """A client sends a message that is too long, or a frame that is invalid."""


def kind_of(frame: bytes | bytearray) -> FrameKind:
    """Return the kind of a whole frame of the server, which is not masked."""
    if frame[0] == _FIN_BINARY:
        payload = 2 + {_SHORT: 2, _LONG: 8}.get(frame[1], 0)
        opcode = frame[payload] if len(frame) > payload else None
        if opcode == _MESSAGE_DATA:
            return FrameKind.MESSAGE
        if opcode == _TIME:
            return FrameKind.TIME
    return FrameKind.CONTROL


def time_frame(stamp_ns: int) -> bytes:
    """Return a frame of the server that tells a time, nanoseconds since 1970."""
    return _TIME_FRAME.pack(_FIN_BINARY, _TIME_FRAME.size - 2, _TIME, stamp_ns)


class FrameReader:
    """Splits what a socket receives into frames, headers included.

    Args:
        limit: Bytes of a message, all its frames together; None for a trusted sender.
    """

    def __init__(self, limit: int | None = None) -> None:
        self._limit = limit
        self._tail = b''
        self._partial: bytearray | None = None
        self._filled = 0
        self._fragments = 0

    def receive(self, connection: socket.socket) -> list[bytes | bytearray] | None:
        """Receive once from a readable socket.

        Returns:
            Complete frames, maybe none; None at the end of the stream.

        Raises:
            FrameError: A message is longer than the limit.
            OSError: The connection is broken.
        """
        if self._partial is not None:
            return self._fill(connection, self._partial)
        data = connection.recv(_RECEIVE)
        return self._split(self._tail + data) if data else None

    def _fill(self, connection: socket.socket, frame: bytearray) -> list[bytes | bytearray] | None:
        count = connection.recv_into(memoryview(frame)[self._filled :])
        if not count:
            return None
        self._filled += count
        if self._filled < len(frame):
            return []
        self._partial = None
        return [frame]

    def _split(self, data: bytes) -> list[bytes | bytearray]:
        frames: list[bytes | bytearray] = []
        start = 0
        self._tail = b''
        while start < len(data):
            size = _size(data, start)
            if size is None:
                self._tail = data[start:]
                break
            self._check(data[start], size)
            if start + size > len(data):
                self._partial = bytearray(size)
                self._filled = len(data) - start
                self._partial[: self._filled] = data[start:]
                break
            frames.append(data[start : start + size])
            start += size
        return frames

    def _check(self, first: int, size: int) -> None:
        """Count the bytes of a message, before memory is allocated for its frame."""
        if self._limit is None:
            return
        is_control = first & 0x0F >= _FIRST_CONTROL
        total = size if is_control else self._fragments + size
        if total > self._limit:
            raise FrameError(f'a message is longer than {self._limit} bytes')
        if not is_control:
            self._fragments = 0 if first & 0x80 else total


def _size(data: bytes, start: int) -> int | None:
    """Return the size of the frame at a position; None if its header is not complete."""
    if len(data) < start + 2:
        return None
    word = data[start + 1]
    length, mask = word & 0x7F, 4 if word & 0x80 else 0
    extra = {_SHORT: 2, _LONG: 8}.get(length, 0)
    if len(data) < start + 2 + extra:
        return None
    if extra:
        length = int.from_bytes(data[start + 2 : start + 2 + extra], 'big')
    return 2 + extra + mask + length


# The request of a WebSocket handshake (RFC 6455 section 4.2.1), and answers that refuse it.


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


# Which web pages may connect: the headers Origin and Host of a WebSocket handshake.
#
# Browsers let any page connect to any WebSocket, also on loopback addresses; the server must check
# the Origin, which pages cannot set (RFC 6455 section 10.2). A page that makes its own name resolve
# to a loopback address (DNS rebinding) is recognized by that name in Host.


Address: TypeAlias = IPv4Address | IPv6Address

KNOWN_ORIGINS = frozenset({'https://app.foxglove.dev', 'https://studio.foxglove.dev', 'file://'})
"""Viewers that are not served from this machine.

Foxglove in a browser, today (the SDK's WebSocketServer.app_url) and before 2024
(https://github.com/foxglove/studio). Desktop applications such as Lichtblick's are pages of a local
file (packages/suite-desktop/src/main/StudioWindow.ts of
https://github.com/lichtblick-suite/lichtblick). Lichtblick in a browser is hosted by its users, by
default at http://localhost:8080; pages of this machine are accepted anyway.
"""

_ORIGIN = re.compile(r'(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<host>\[[0-9a-f:.]+\]|[^/\s:@]*)(:\d+)?')
_HOST = re.compile(r'(?P<host>\[[0-9a-f:.]+\]|[^/\s:@]+)(:\d*)?')
_WEB = ('http', 'https')
_SHOWN = 100


def parse_origin(text: str) -> str:
    """Return an origin of an option as browsers write it.

    Raises:
        UsageError: It is not scheme://host or scheme://host:port.
    """
    origin = text.lower()
    if not origin.endswith('://'):
        origin = origin.removesuffix('/')
    if not _ORIGIN.fullmatch(origin):
        raise UsageError(
            f'--allow-origin takes scheme://host or scheme://host:port, such as'
            f' https://viewer.example.org, not {text!r}'
        )
    return origin


@dataclass(frozen=True)
class Admission:
    """Decides about handshakes.

    Args:
        bound: Address that the server is bound to, as requested: a name or an IP address.
        allowed: Further origins, as parse_origin returns them.
    """

    bound: str
    allowed: frozenset[str] = frozenset()

    def refusal(self, host: str, origin: str | None, local: str) -> str | None:
        """Return the reason to refuse a handshake, with the option that would accept it.

        Args:
            host: Header Host.
            origin: Header Origin; None if there is none, as for programs that are not browsers.
            local: Address of this machine that the client has connected to.

        Returns:
            One line; None for a handshake that is accepted.
        """
        if not self._is_ours(host, local):
            return (
                f'the host name {shown(host)} is not a name of this machine; to accept it:'
                f' --allow-origin http://{shown(host)}'
            )
        if origin is not None and not self._is_known(origin):
            return f'pages of {shown(origin)} may not connect; to accept them: {_remedy(origin)}'
        return None

    def _is_known(self, origin: str) -> bool:
        text = origin.lower()
        if text in KNOWN_ORIGINS or text in self.allowed:
            return True
        found = _ORIGIN.fullmatch(text)
        return found is not None and found['scheme'] in _WEB and is_loopback(found['host'])

    def _is_ours(self, host: str, local: str) -> bool:
        found = _HOST.fullmatch(host.lower())
        if found is None:
            return False
        name = found['host']
        if is_loopback(name) or name == self.bound.lower() or name in self._allowed_hosts():
            return True
        address, bound = _address(name), _address(self.bound)
        if address is None:
            return False
        # Rebinding needs a name: an address in Host is one that the user has typed. With all
        # addresses bound it may be one that a router or a container translates to this machine's.
        if bound is not None and bound.is_unspecified:
            return True
        return address in {bound, _address(local)}

    def _allowed_hosts(self) -> set[str]:
        found = (_ORIGIN.fullmatch(each) for each in self.allowed)
        return {each['host'] for each in found if each}


def is_loopback(host: str) -> bool:
    """Whether a name or an address, IPv6 also in brackets, is this machine's loopback.

    Names under localhost never leave the machine (RFC 6761 section 6.3).
    """
    name = host.lower().removesuffix('.')
    if name == 'localhost' or name.endswith('.localhost'):
        return True
    address = _address(name)
    return address is not None and address.is_loopback


def _address(text: str) -> Address | None:
    try:
        address = ip_address(text.strip('[]').partition('%')[0])
    except ValueError:
        return None
    return getattr(address, 'ipv4_mapped', None) or address


def _remedy(origin: str) -> str:
    if _ORIGIN.fullmatch(origin.lower()):
        return f'--allow-origin {shown(origin)}'
    return 'open the viewer from an address of its own, and give it to --allow-origin'


def shown(text: str) -> str:
    """Return text of a client for one line of output: printable, and not too long."""
    printable = ''.join(each if each.isprintable() else '?' for each in text)
    return printable if len(printable) <= _SHOWN else f'{printable[:_SHOWN]}...'
