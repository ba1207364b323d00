# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Frames that wait for one viewer, bounded: its oldest messages are dropped, never a control."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, TypeAlias

from .frames import FrameError, FrameKind, kind_of

if TYPE_CHECKING:
    import socket

MESSAGE_LIMIT = 8 << 20
"""Bytes of messages that wait for one viewer: more than a frame of a drive with all topics."""

CONTROL_LIMIT = 4 << 20
"""Bytes of controls that wait: channels with their definitions, states, answers."""

_BATCH = 1 << 18
_MOST_BUFFERS = 64

Numbered: TypeAlias = 'tuple[int, bytes | bytearray]'


class Outbox:
    """A queue of whole frames, sent in the order in which they were put.

    Of times only the newest waits. A frame that is being sent is always sent to its end.

    Attributes:
        dropped: Count of dropped messages.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._messages: deque[Numbered] = deque()
        self._controls: deque[Numbered] = deque()
        self._times: deque[Numbered] = deque(maxlen=1)
        self._message_bytes = 0
        self._control_bytes = 0
        self._number = 0
        self._sending: deque[memoryview] = deque()

    def __bool__(self) -> bool:
        return bool(self._sending or self._messages or self._controls or self._times)

    def put(self, frame: bytes | bytearray) -> None:
        """Add a frame of the server.

        Raises:
            FrameError: More controls wait than any viewer needs: nobody reads.
        """
        self._number += 1
        kind = kind_of(frame)
        if kind is FrameKind.TIME:
            self._times.append((self._number, frame))
        elif kind is FrameKind.MESSAGE:
            self._messages.append((self._number, frame))
            self._message_bytes += len(frame)
            while self._message_bytes > MESSAGE_LIMIT and len(self._messages) > 1:
                self._message_bytes -= len(self._messages.popleft()[1])
                self.dropped += 1
        else:
            self.put_control(frame)

    def put_control(self, data: bytes | bytearray) -> None:
        """Add a control, or other bytes that must not be dropped.

        Raises:
            FrameError: As put does.
        """
        self._control_bytes += len(data)
        if self._control_bytes > CONTROL_LIMIT:
            raise FrameError(f'more than {CONTROL_LIMIT} bytes of controls wait')
        self._number += 1
        self._controls.append((self._number, data))

    def send(self, connection: socket.socket) -> None:
        """Send once to a writable socket.

        Raises:
            OSError: The connection is broken.
        """
        self._take()
        sent = connection.sendmsg(self._sending)
        while self._sending and sent >= len(self._sending[0]):
            sent -= len(self._sending.popleft())
        if sent:
            self._sending[0] = self._sending[0][sent:]

    def _take(self) -> None:
        """Move frames to those that are being sent, up to a batch."""
        size = sum(map(len, self._sending))
        while size < _BATCH and len(self._sending) < _MOST_BUFFERS:
            waiting = [each for each in (self._messages, self._controls, self._times) if each]
            if not waiting:
                return
            queue = min(waiting, key=lambda each: each[0][0])
            frame = queue.popleft()[1]
            if queue is self._messages:
                self._message_bytes -= len(frame)
            elif queue is self._controls:
                self._control_bytes -= len(frame)
            self._sending.append(memoryview(frame))
            size += len(frame)
