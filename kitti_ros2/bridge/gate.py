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
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING

from .admission import is_loopback, shown
from .frames import FrameError, time_frame
from .handshake import RefusedError
from .relay import Relay, RelayStage

if TYPE_CHECKING:
    from collections.abc import Callable

    from .admission import Admission
    from .handshake import Handshake

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
