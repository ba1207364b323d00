# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One viewer's connection: its handshake is checked, then frames go both ways, bounded."""

from __future__ import annotations

import socket
import time
from contextlib import suppress
from enum import Enum
from http import HTTPStatus
from selectors import EVENT_READ, EVENT_WRITE
from typing import TYPE_CHECKING

from .frames import FrameReader
from .handshake import END, HEAD_LIMIT, RefusedError, is_complete, parse
from .outbox import Outbox

if TYPE_CHECKING:
    from collections.abc import Callable

    from .handshake import Handshake

CLIENT_MESSAGE_LIMIT = 1 << 20
"""Bytes of a message of a viewer: subscriptions to some thousand topics."""

_KEEPALIVE = (('TCP_KEEPIDLE', 30), ('TCP_KEEPINTVL', 10), ('TCP_KEEPCNT', 3))
"""A viewer whose machine has vanished is noticed within a minute."""

HANDSHAKE_S = 10.0
"""Seconds from the connection to the end of its handshake."""

_REFUSED_S = 5.0
_LEAVING_S = 60.0
"""Seconds in which a viewer may read the rest after the server has closed the connection."""

_SWITCHING = b'HTTP/1.1 101 '
_DISCARD = 65536


class RelayStage(Enum):
    """How far a connection is."""

    HANDSHAKE = 'handshake'
    ANSWER = 'answer'
    OPEN = 'open'
    LEAVING = 'leaving'
    CLOSED = 'closed'


class Relay:
    """A connection of a viewer, and one to the server behind it. All sockets are non-blocking.

    Args:
        viewer: The accepted socket.
        admit: Called with the handshake; returns a connecting socket of the server, and raises
            RefusedError for a handshake that is refused.

    Attributes:
        viewer: The accepted socket.
        stage: How far it is.
        deadline: When it is closed unless it gets further, of time.monotonic; None for never.
        admitted: Whether the handshake was accepted.
        outbox: What the viewer has not read yet.
    """

    def __init__(self, viewer: socket.socket, admit: Callable[[Handshake], socket.socket]) -> None:
        self.viewer = viewer
        self.stage = RelayStage.HANDSHAKE
        self.deadline: float | None = time.monotonic() + HANDSHAKE_S
        self.admitted = False
        self.outbox = Outbox()
        self._server: socket.socket | None = None
        self._greeted = False
        self._admit = admit
        self._head = bytearray()
        self._from_server = FrameReader()
        self._from_viewer = FrameReader(CLIENT_MESSAGE_LIMIT)
        self._to_server = bytearray()
        viewer.settimeout(0.0)
        viewer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        viewer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in _KEEPALIVE:
            if hasattr(socket, name):
                viewer.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

    def interests(self) -> dict[socket.socket, int]:
        """Return the events that each socket waits for; 0 for none."""
        if self.stage is RelayStage.CLOSED:
            return {}
        reads = self.stage is not RelayStage.ANSWER and not self._to_server
        wanted = {self.viewer: reads * EVENT_READ | bool(self.outbox) * EVENT_WRITE}
        if self._server is not None:
            wanted[self._server] = EVENT_READ | bool(self._to_server) * EVENT_WRITE
        return wanted

    def handle(self, ready: socket.socket, events: int) -> None:
        """Receive and send once.

        Raises:
            OSError: A connection is broken.
            FrameError: The viewer breaks a limit.
        """
        with suppress(BlockingIOError, InterruptedError):
            if events & EVENT_WRITE:
                if ready is self.viewer:
                    self._send_to_viewer()
                else:
                    self._send_to_server()
        with suppress(BlockingIOError, InterruptedError):
            if events & EVENT_READ and self.stage is not RelayStage.CLOSED:
                if ready is self.viewer:
                    self._receive_from_viewer()
                elif ready is self._server:
                    self._receive_from_server(ready)

    def tell(self, frame: bytes) -> None:
        """Send a frame to the viewer, if the server behind has sent its own first one.

        Raises:
            OSError: The connection is broken.
            FrameError: The viewer breaks a limit.
        """
        if self._greeted and self.stage is RelayStage.OPEN:
            self.outbox.put(frame)
            self._send_to_viewer()

    def close(self) -> None:
        """Close both connections at once."""
        self.stage = RelayStage.CLOSED
        self._close_server()
        self.viewer.close()

    def _close_server(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None

    def _receive_from_viewer(self) -> None:
        if self.stage is RelayStage.OPEN:
            frames = self._from_viewer.receive(self.viewer)
            if frames is None:
                self.close()
                return
            for frame in frames:
                self._to_server += frame
            if frames:
                self._send_to_server()
            return
        data = self.viewer.recv(_DISCARD if self.stage is RelayStage.LEAVING else HEAD_LIMIT)
        if not data:
            self.close()
        elif self.stage is RelayStage.HANDSHAKE:
            self._shake(data)

    def _shake(self, data: bytes) -> None:
        self._head += data
        try:
            if not is_complete(self._head):
                return
            self._server = self._admit(parse(self._head))
        except RefusedError as error:
            self._refuse(error)
        else:
            self.admitted = True
            self.stage = RelayStage.ANSWER
            self._to_server, self._head = self._head, bytearray()

    def _refuse(self, error: RefusedError) -> None:
        self.outbox.put_control(error.answer())
        self._leave(_REFUSED_S)

    def _leave(self, seconds: float) -> None:
        """Send the rest, then wait until the viewer closes; closing first could lose the rest."""
        self._close_server()
        self._to_server.clear()
        self.stage = RelayStage.LEAVING
        self.deadline = time.monotonic() + seconds
        self._send_to_viewer()

    def _receive_from_server(self, server: socket.socket) -> None:
        if self.stage is RelayStage.ANSWER:
            self._receive_answer(server)
            return
        frames = self._from_server.receive(server)
        if frames is None:
            self._leave(_LEAVING_S)
            return
        for frame in frames:
            self.outbox.put(frame)
        if frames:
            self._greeted = True
            self._send_to_viewer()

    def _receive_answer(self, server: socket.socket) -> None:
        """Receive the answer up to its end: frames follow it."""
        seen = server.recv(HEAD_LIMIT, socket.MSG_PEEK)
        if not seen:
            self._refuse(RefusedError(HTTPStatus.BAD_GATEWAY, 'the server has closed'))
            return
        end = (self._head + seen).find(END)
        rest = len(seen) if end < 0 else end + len(END) - len(self._head)
        self._head += server.recv(rest)
        if end < 0:
            return
        self.outbox.put_control(bytes(self._head))
        if self._head.startswith(_SWITCHING):
            self.stage, self.deadline = RelayStage.OPEN, None
        else:
            self._leave(_REFUSED_S)

    def _send_to_server(self) -> None:
        if self._server is not None:
            with suppress(BlockingIOError):
                del self._to_server[: self._server.send(self._to_server)]

    def _send_to_viewer(self) -> None:
        with suppress(BlockingIOError):
            if self.outbox:
                self.outbox.send(self.viewer)
        if self.stage is RelayStage.LEAVING and not self.outbox:
            self.viewer.shutdown(socket.SHUT_WR)
