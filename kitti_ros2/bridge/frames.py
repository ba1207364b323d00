# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""WebSocket frames in a stream of bytes (RFC 6455 section 5.2), and which of them may be dropped.

Opcodes of Foxglove's protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import socket

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
