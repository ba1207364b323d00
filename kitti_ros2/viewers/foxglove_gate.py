# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The port that viewers connect to: who may, how many, and how much waits for each.

Foxglove's SDK accepts every handshake, keeps connections without one for ever, and queues a copy of
each message for each viewer. Its server is therefore behind this one, at an address that is not
told to anybody. The SDK also disconnects a viewer for whom a queue of controls is full, and counts
times as such; the gate sends these itself.
"""

from __future__ import annotations

import errno
import secrets
import selectors
import socket
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from enum import Enum
from functools import partial
from http import HTTPStatus
from selectors import EVENT_READ, EVENT_WRITE
from typing import TYPE_CHECKING, TypeAlias

from .websocket import (
    END,
    HEAD_LIMIT,
    FrameError,
    FrameKind,
    FrameReader,
    RefusedError,
    is_complete,
    is_loopback,
    kind_of,
    parse,
    shown,
    time_frame,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from .websocket import Admission, Handshake


# Frames that wait for one viewer, bounded: its oldest messages are dropped, never a control.


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


# One viewer's connection: its handshake is checked, then frames go both ways, bounded.


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


VIEWERS = 8
"""Connected viewers."""

HANDSHAKES = 32
"""Connections whose handshake is not done; a further one replaces the oldest."""

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_PAUSE_S = 0.05
_TOLD = 20
_BACKLOG = 128
_WAKES = 4096
_INNER_BUFFER = 1 << 18
"""Bytes between the SDK and the outbox: more would only be older messages."""


def hidden_address() -> str:
    """Return a random loopback address for a server that only this process shall find.

    Linux accepts all 2 ** 24 addresses of 127.0.0.0/8; with the port a page would have to guess
    about 38 bits. Other systems have 127.0.0.1 only.
    """
    if not sys.platform.startswith('linux'):
        return '127.0.0.1'
    return '.'.join(map(str, (127, *(1 + secrets.randbelow(254) for _ in range(3)))))


class Gate:
    """Listens for viewers and relays those that are admitted; runs in a thread of its own.

    Args:
        host: Address to listen on: an IP address or a name.
        port: TCP port; 0 takes a free one.
        admission: Decides about handshakes.
        complain: Called with each reason for a refusal once, from the gate's thread.

    Attributes:
        host: As given.
        port: The port that it listens on.

    Raises:
        OSError: The address or the port is not available.
    """

    def __init__(
        self, host: str, port: int, admission: Admission, complain: Callable[[str], None]
    ) -> None:
        self.host = host
        self._admission = admission
        self._complain = complain
        self._told: set[str] = set()
        self._inner = ('', 0)
        self._relays: dict[Relay, dict[socket.socket, int]] = {}
        self._closing: float | None = None
        self._listener = _listen(host, port)
        self.port = int(self._listener.getsockname()[1])
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._woken, self._waker = socket.socketpair()
        self._woken.settimeout(0.0)
        self._waker.settimeout(0.0)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._times: deque[bytes] = deque(maxlen=1)
        self._thread = threading.Thread(target=self._run, name='gate', daemon=True)

    @property
    def url(self) -> str:
        """The address for viewers on this machine, or on others if it is bound to one of them."""
        host = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(self.host, self.host)  # noqa: S104
        return f'ws://[{host}]:{self.port}' if ':' in host else f'ws://{host}:{self.port}'

    def open(self, host: str, port: int) -> None:
        """Start to accept viewers, for the server at an address."""
        self._inner = (host, port)
        self._thread.start()

    def tell_time(self, stamp_ns: int) -> None:
        """Send a time to all viewers, nanoseconds since 1970; any thread may call it.

        Of several that a viewer has not received yet, only the newest is sent.
        """
        self._times.append(time_frame(stamp_ns))
        self._wake()

    def close(self, seconds: float) -> None:
        """Stop listening, send what waits for viewers for a time, and disconnect them."""
        self._closing = time.monotonic() + seconds
        if self._thread.ident is None:
            self._end()
        else:
            self._wake()
            self._thread.join()
        self._woken.close()
        self._waker.close()

    def _wake(self) -> None:
        with suppress(OSError):  # full: it wakes anyway; closed: nobody is left to be told
            self._waker.send(b'.')

    def _run(self) -> None:
        try:
            while not self._is_done():
                for key, events in self._selector.select(self._patience()):
                    self._handle(key, events)
                self._close_late()
        finally:
            self._end()

    def _end(self) -> None:
        for relay in [*self._relays]:
            self._drop(relay)
        self._selector.close()
        self._listener.close()

    def _is_done(self) -> bool:
        if self._closing is None:
            return False
        watched = any(relay.admitted for relay in self._relays)
        return not watched or time.monotonic() > self._closing

    def _patience(self) -> float | None:
        deadlines = [each.deadline for each in self._relays if each.deadline is not None]
        if self._closing is not None:
            deadlines.append(self._closing)
        return max(0.0, min(deadlines) - time.monotonic()) if deadlines else None

    def _handle(self, key: selectors.SelectorKey, events: int) -> None:
        if key.fileobj is self._listener:
            self._accept()
        elif key.fileobj is self._woken:
            self._awake()
        else:
            relay = key.data
            if relay.stage is not RelayStage.CLOSED and isinstance(key.fileobj, socket.socket):
                self._advance(relay, partial(relay.handle, key.fileobj, events))

    def _awake(self) -> None:
        self._woken.recv(_WAKES)
        if self._times:  # only this thread takes one
            frame = self._times.pop()
            for relay in [*self._relays]:
                self._advance(relay, partial(relay.tell, frame))
        if self._closing is not None:
            self._selector.unregister(self._woken)
            self._selector.unregister(self._listener)
            self._listener.close()

    def _accept(self) -> None:
        try:
            viewer, _ = self._listener.accept()
        except OSError as error:
            if error.errno in _EXHAUSTED:  # it stays ready: make room, and do not spin
                self._close_oldest(0)
                time.sleep(_PAUSE_S)
            return
        self._close_oldest(HANDSHAKES - 1)
        self._register(Relay(viewer, lambda handshake: self._admit(handshake, viewer)))

    def _close_oldest(self, most: int) -> None:
        waiting = [each for each in self._relays if not each.admitted]
        waiting.sort(key=lambda each: each.deadline or 0.0)
        for relay in waiting[: max(0, len(waiting) - most)]:
            self._drop(relay)

    def _close_late(self) -> None:
        now = time.monotonic()
        for relay in [each for each in self._relays if each.deadline and each.deadline < now]:
            self._drop(relay)

    def _advance(self, relay: Relay, step: Callable[[], None]) -> None:
        dropped = relay.outbox.dropped
        try:
            step()
        except (OSError, FrameError) as error:
            if isinstance(error, FrameError):
                self._tell('limit', f'a viewer was disconnected: {error}')
            self._drop(relay)
            return
        if relay.outbox.dropped > dropped:
            self._tell('slow', 'a viewer reads too slowly: it loses its oldest messages')
        self._register(relay)

    def _drop(self, relay: Relay) -> None:
        relay.close()
        self._register(relay)

    def _register(self, relay: Relay) -> None:
        """Let the selector wait for what a relay waits for; forget a closed one."""
        known = self._relays.pop(relay, {})
        wanted = {each: events for each, events in relay.interests().items() if events}
        for each in known.keys() - wanted.keys():
            self._selector.unregister(each)
        for each, events in wanted.items():
            if each not in known:
                self._selector.register(each, events, relay)
            elif events != known[each]:
                self._selector.modify(each, events, relay)
        if relay.stage is not RelayStage.CLOSED:
            self._relays[relay] = wanted

    def _admit(self, handshake: Handshake, viewer: socket.socket) -> socket.socket:
        """Connect to the server behind, or raise RefusedError."""
        local = str(viewer.getsockname()[0])
        reason = self._admission.refusal(handshake.host, handshake.origin, local)
        if reason is not None:
            self._tell(handshake.origin or handshake.host, f'connection refused: {reason}')
            raise RefusedError(HTTPStatus.FORBIDDEN, reason)
        if sum(each.admitted for each in self._relays) >= VIEWERS:
            reason = f'{VIEWERS} viewers are connected, which is the most; close one of them'
            self._tell('viewers', f'connection refused: {reason}')
            raise RefusedError(HTTPStatus.SERVICE_UNAVAILABLE, reason)
        server = socket.socket()
        try:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _INNER_BUFFER)
            server.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            server.settimeout(0.0)
            with suppress(BlockingIOError):
                server.connect(self._inner)
        except OSError:
            server.close()
            raise
        return server

    def _tell(self, key: str, text: str) -> None:
        """Complain once for each key, and not about endlessly many."""
        if key in self._told or len(self._told) > _TOLD:
            return
        self._told.add(key)
        if len(self._told) > _TOLD:
            text = f'{text}; further refusals are not shown'
        self._complain(text)


def _listen(host: str, port: int) -> socket.socket:
    """Listen on the first address that a name has."""
    infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, _, _, _, address = infos[0]
    listener = socket.create_server(address, family=family, backlog=_BACKLOG)
    listener.settimeout(0.0)
    return listener


def exposure(host: str, url: str) -> str | None:
    """Return a warning for a server that other machines can reach; None for loopback."""
    if is_loopback(host):
        return None
    return (
        f'{shown(host)} is not a loopback address: everyone in its network can watch and control'
        f' the playback at {url}, without a password and without encryption'
    )
