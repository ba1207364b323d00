# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The proxy that viewers connect to, with limits on origins, connections and queues.

Foxglove's SDK accepts every handshake, keeps connections without one for ever, and queues a copy of
each message for each viewer. Its server is therefore behind the proxy, at a secret address. The SDK
also disconnects a viewer with a full queue of controls, and counts times as controls; the proxy
sends times itself.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import struct
import sys
import threading
from collections import OrderedDict, deque
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from websockets.asyncio.client import connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.frames import CloseCode
from websockets.typing import Subprotocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from websockets.asyncio.client import ClientConnection
    from websockets.http11 import Request, Response

    from .origin_check import OriginCheck


# The bounded queue of one viewer: its oldest messages are dropped, never a control.

MESSAGE_LIMIT = 8 << 20
"""Bytes of queued messages of one viewer: more than a frame of a drive with all topics."""

CONTROL_LIMIT = 4 << 20
"""Bytes of queued controls: channels with their definitions, states, answers."""

_MESSAGE, _TIME = b'\1', b'\2'
"""Opcodes of Foxglove's protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md"""

Data: TypeAlias = 'str | bytes'


class QueueFullError(Exception):
    """The queue of a viewer is full: it does not read."""


class SendQueue:
    """Messages in the order of their arrival; only the newest time is queued.

    Attributes:
        dropped: Number of dropped messages.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._waiting: OrderedDict[int, Data] = OrderedDict()
        self._messages: deque[int] = deque()
        self._message_bytes = 0
        self._control_bytes = 0
        self._number = 0
        self._time = 0
        self._has_ended = False
        self._changed = asyncio.Event()

    def put(self, data: Data) -> None:
        """Add a message of the server.

        Raises:
            QueueFullError: Too many controls are queued.
        """
        self._number += 1
        self._waiting[self._number] = data
        if _has_opcode(data, _TIME):
            self._waiting.pop(self._time, None)
            self._time = self._number
        elif _has_opcode(data, _MESSAGE):
            self._messages.append(self._number)
            self._message_bytes += len(data)
            while self._message_bytes > MESSAGE_LIMIT and len(self._messages) > 1:
                self._message_bytes -= len(self._waiting.pop(self._messages.popleft()))
                self.dropped += 1
        else:
            self._control_bytes += len(data)
            if self._control_bytes > CONTROL_LIMIT:
                raise QueueFullError(f'more than {CONTROL_LIMIT} bytes of controls wait')
        self._changed.set()

    def end(self) -> None:
        """Let get return None once the queue is empty."""
        self._has_ended = True
        self._changed.set()

    async def get(self) -> Data | None:
        """Wait for the next message and take it; None at the end."""
        await self._changed.wait()
        if not self._waiting:
            return None
        _, data = self._waiting.popitem(last=False)
        if _has_opcode(data, _MESSAGE):
            self._messages.popleft()
            self._message_bytes -= len(data)
        elif not _has_opcode(data, _TIME):
            self._control_bytes -= len(data)
        if not self._waiting and not self._has_ended:
            self._changed.clear()
        return data


def _has_opcode(data: Data, opcode: bytes) -> bool:
    return isinstance(data, bytes) and data.startswith(opcode)


# The connection of one viewer, with bounds that websockets does not have.

VIEWERS = 8
"""Most connected viewers."""

HANDSHAKES = 32
"""Most connections without a handshake; a further one replaces the oldest."""

HANDSHAKE_S = 10.0
"""Seconds from the connection to the end of its handshake."""

CLIENT_MESSAGE_LIMIT = 1 << 20
"""Bytes of a message of a viewer: subscriptions to some thousand topics."""

_LEAVING_S = 30.0
"""Seconds for a viewer to read its queue after the server has closed, and then close."""

_SERVER_CLOSING_S = 1.0

_BACKLOG = 128

_KEEPALIVE = (('TCP_KEEPIDLE', 30), ('TCP_KEEPINTVL', 10), ('TCP_KEEPCNT', 3))
"""Options that detect a vanished machine within a minute; pings would also disconnect a suspended
viewer."""

_SUBPROTOCOLS = [Subprotocol('foxglove.sdk.v1.1'), Subprotocol('foxglove.sdk.v1')]
"""Subprotocols of foxglove-sdk 0.30, which prefers the newer one."""

_MOST_REFUSALS = 20

_SILENT = logging.getLogger(__name__)
"""The logger of websockets, which would log every error of a client with a traceback."""
_SILENT.setLevel(logging.CRITICAL + 1)


class ViewerConnection(ServerConnection):
    """A connection to the proxy, with or without a handshake.

    Args:
        proxy: The proxy, which counts it.
        arguments: Arguments of websockets.
        options: Options of websockets.

    Attributes:
        sending: Size of the message being sent.
    """

    def __init__(
        self,
        proxy: ViewerProxy,
        *arguments: Any,  # noqa: ANN401 - the base class has them
        **options: Any,  # noqa: ANN401
    ) -> None:
        super().__init__(*arguments, **options)
        self.sending = 0
        self._proxy = proxy

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count the connection."""
        super().connection_made(transport)
        self._proxy.connected(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        super().connection_lost(exc)
        self._proxy.disconnected(self)

    def data_received(self, data: bytes) -> None:
        """Disconnect a viewer that sends too long a message, or pings without reading.

        websockets would wait for the viewer to close, and answers pings without a bound.
        """
        super().data_received(data)
        close = self.protocol.close_sent
        if close is not None and close.code == CloseCode.MESSAGE_TOO_BIG:
            self._proxy.disconnect(self, f'a message is longer than {CLIENT_MESSAGE_LIMIT} bytes')
        elif self.transport.get_write_buffer_size() > self.sending + CONTROL_LIMIT:
            self._proxy.disconnect(self, f'more than {CONTROL_LIMIT} bytes of answers wait')

    async def send_all(self, queue: SendQueue) -> None:
        """Send the messages of a queue, to its end."""
        while (data := await queue.get()) is not None:
            self.sending = len(data)
            await self.send(data)


# The server for viewers, with a connection to the SDK's server for each.


def hidden_address() -> str:
    """Return a random loopback address, which other processes cannot guess.

    Linux accepts all 2 ** 24 addresses of 127.0.0.0/8; with the port a page would have to guess
    about 38 bits. Other systems have 127.0.0.1 only.
    """
    if not sys.platform.startswith('linux'):
        return '127.0.0.1'
    return '.'.join(map(str, (127, *(1 + secrets.randbelow(254) for _ in range(3)))))


class ViewerProxy:
    """Listens for viewers and connects accepted ones, in a separate thread.

    Args:
        host: Address to listen on: an IP address or a name.
        port: TCP port; 0 takes a free one.
        origin_check: Decides about handshakes.
        warn: Called once with each reason for a refusal, from the proxy's thread.

    Attributes:
        host: The requested host.
        port: The port that it listens on.

    Raises:
        OSError: The address or the port is not available.
    """

    def __init__(
        self, host: str, port: int, origin_check: OriginCheck, warn: Callable[[str], None]
    ) -> None:
        self.host = host
        self._origin_check = origin_check
        self._warn = warn
        self._refusals: set[str] = set()
        self._opening: dict[ViewerConnection, None] = {}
        self._viewers: set[ViewerConnection] = set()
        self._queues: set[SendQueue] = set()
        self._listener = _listen(host, port)
        self.port = int(self._listener.getsockname()[1])
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(lambda *_: None)  # misbehaviour of clients is no error
        self._closing: asyncio.Future[float] = self._loop.create_future()
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """The address for viewers on this machine, or on others if bound to one of theirs."""
        host = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(self.host, self.host)  # noqa: S104
        return f'ws://[{host}]:{self.port}' if ':' in host else f'ws://{host}:{self.port}'

    def open(self, host: str, port: int) -> None:
        """Start to accept viewers, for the server at an address."""
        serving = self._serve(f'ws://{host}:{port}')
        self._thread = threading.Thread(
            target=self._loop.run_until_complete, args=(serving,), name='viewers', daemon=True
        )
        self._thread.start()

    def publish_time(self, stamp_ns: int) -> None:
        """Send a time to all viewers, nanoseconds since 1970; any thread may call it.

        Only the newest of the times that a viewer has not received is sent.
        """
        with suppress(RuntimeError):  # closed: no viewers
            self._loop.call_soon_threadsafe(self._send_time, stamp_ns)

    def close(self, seconds: float) -> None:
        """Stop listening, send queued messages for a time, and disconnect the viewers."""
        if self._thread is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._closing.set_result, seconds)
            self._thread.join()
        self._listener.close()
        self._loop.close()

    # In the thread.

    async def _serve(self, url: str) -> None:
        server = await serve(
            partial(self._forward, url),
            sock=self._listener,
            create_connection=cast('type[ServerConnection]', partial(ViewerConnection, self)),
            process_response=self._check,
            subprotocols=_SUBPROTOCOLS,
            compression=None,
            server_header=None,
            open_timeout=HANDSHAKE_S,
            close_timeout=_LEAVING_S,
            ping_interval=None,
            max_size=CLIENT_MESSAGE_LIMIT,
            max_queue=1,
            logger=_SILENT,
        )
        seconds = await self._closing
        self._loop.remove_reader(self._listener)
        await asyncio.sleep(0)  # asyncio fails for connections being accepted
        server.close(close_connections=False)
        self._close_oldest(0)
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(server.wait_closed(), seconds)
        for viewer in [*self._viewers]:
            viewer.transport.abort()
        await server.wait_closed()

    def connected(self, viewer: ViewerConnection) -> None:
        """Count a connection; too many drop the oldest without a handshake."""
        self._opening[viewer] = None
        self._close_oldest(0 if self._closing.done() else HANDSHAKES)

    def disconnected(self, viewer: ViewerConnection) -> None:
        """Remove a connection."""
        self._opening.pop(viewer, None)
        self._viewers.discard(viewer)

    def disconnect(self, viewer: ViewerConnection, reason: str) -> None:
        """Disconnect a viewer beyond a limit."""
        self._warn_once('limit', f'a viewer was disconnected: {reason}')
        viewer.transport.abort()

    def _close_oldest(self, most: int) -> None:
        while len(self._opening) > most:
            viewer = next(iter(self._opening))
            self.disconnected(viewer)
            viewer.transport.abort()

    def _check(
        self, connection: ServerConnection, request: Request, response: Response
    ) -> Response | None:
        """Return the response that refuses a handshake; None keeps that of websockets."""
        if response.status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            return None
        hosts = request.headers.get_all('Host')
        if len(hosts) != 1:
            return connection.respond(HTTPStatus.BAD_REQUEST, 'one header Host is required\n')
        origin = request.headers.get('Origin')
        reason = self._origin_check.refusal(hosts[0], origin, str(connection.local_address[0]))
        if reason is not None:
            self._warn_once(origin or hosts[0], f'connection refused: {reason}')
            return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
        if len(self._viewers) >= VIEWERS:
            reason = f'{VIEWERS} viewers are connected, which is the most; close one of them'
            self._warn_once('viewers', f'connection refused: {reason}')
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, f'{reason}\n')
        viewer = cast('ViewerConnection', connection)
        self._opening.pop(viewer, None)
        self._viewers.add(viewer)
        return None

    async def _forward(self, url: str, connection: ServerConnection) -> None:
        """Connect a viewer with the server until either closes."""
        viewer = cast('ViewerConnection', connection)
        with suppress(OSError, InvalidHandshake, ConnectionClosed):
            async with connect(
                url,
                subprotocols=[viewer.subprotocol or _SUBPROTOCOLS[0]],
                compression=None,
                proxy=None,
                close_timeout=_SERVER_CLOSING_S,
                ping_interval=None,
                max_size=None,
                logger=_SILENT,
            ) as server:
                await self._exchange(viewer, server)

    async def _exchange(self, viewer: ViewerConnection, server: ClientConnection) -> None:
        queue = SendQueue()
        tasks = [
            asyncio.create_task(self._from_server(server, viewer, queue)),
            asyncio.create_task(viewer.send_all(queue)),
            asyncio.create_task(self._from_viewer(viewer, server)),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._queues.discard(queue)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _from_server(
        self, server: ClientConnection, viewer: ViewerConnection, queue: SendQueue
    ) -> None:
        """Queue the server's messages; at the end give the viewer time to read them."""
        with suppress(ConnectionClosed):
            async for message in server:
                self._put(message, viewer, queue)
                self._queues.add(queue)  # viewers expect times only after this
        queue.end()
        await asyncio.sleep(_LEAVING_S)

    def _put(self, message: Data, viewer: ViewerConnection, queue: SendQueue) -> None:
        dropped = queue.dropped
        try:
            queue.put(message)
        except QueueFullError as error:
            self.disconnect(viewer, str(error))
        if queue.dropped > dropped:
            self._warn_once('slow', 'a viewer reads too slowly: it loses its oldest messages')

    async def _from_viewer(self, viewer: ViewerConnection, server: ClientConnection) -> None:
        """Forward a viewer's messages by fragments, without assembling them.

        The rest is discarded when the server has closed.
        """
        with suppress(ConnectionClosed):
            while True:
                await server.send(viewer.recv_streaming())
        async for _ in viewer:
            pass

    def _send_time(self, stamp_ns: int) -> None:
        for queue in self._queues:
            queue.put(_TIME + struct.pack('<Q', stamp_ns))

    def _warn_once(self, key: str, text: str) -> None:
        """Warn once for each key, up to a limit."""
        if key in self._refusals or len(self._refusals) > _MOST_REFUSALS:
            return
        self._refusals.add(key)
        if len(self._refusals) > _MOST_REFUSALS:
            text = f'{text}; further refusals are not shown'
        self._warn(text)


def _listen(host: str, port: int) -> socket.socket:
    """Listen on the first address of a name. Accepted sockets inherit the options."""
    infos = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, _, _, _, address = infos[0]
    listener = socket.create_server(address, family=family, backlog=_BACKLOG)
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # asyncio does not, for proto 0
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE:
        if hasattr(socket, name):
            listener.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return listener
