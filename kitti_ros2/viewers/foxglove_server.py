# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's WebSocket server: viewers display and control a session."""

from __future__ import annotations

import errno
import logging
import os
import socket
import threading
import time
from collections import Counter, deque
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import foxglove
from foxglove import Context, StatusLevel, start_server
from foxglove.websocket import (
    Capability,
    PlaybackCommand,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from ..messages.ros_types import TYPESTORE
from ..model.bag_formats import DIAGNOSTICS, Channel
from ..model.errors import UsageError, one_line
from ..options.outputs import RATES, Stamps
from ..player.bag_program import STATE, describe, open_program, reserved_by_viewers
from ..player.session import Audience, Session, Transport, encode_state, favour_what_is_due
from ..player.terminal import play_to_the_end
from .foxglove_proxy import ViewerProxy, hidden_address
from .origin_check import exposure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from foxglove.websocket import ChannelView, Client, PlaybackControlRequest, WebSocketServer

    from ..messages.ros_types import Typestore
    from ..options.table import PlaySettings
    from ..player.playback import Playback
    from ..player.program import Program
    from ..player.terminal import StopRequest, Terminal
    from .origin_check import OriginCheck


# The topics of a program as WebSocket channels: CDR with its ros2msg definition.
#
# Latched messages are stored and sent to each new subscriber, as a transient local publisher does.

_RESEND_AFTER_NS = 100_000_000
_LAST_WAIT_S = 0.3


class ViewerChannels(Transport):
    """The Transport of a session: a channel per topic, and one for the player's state.

    Every channel has the definition of its type, so that all topics can be published. Publishing
    never blocks: a slow viewer loses its oldest messages.

    Args:
        program: The program with the topics.
        context: The SDK's context of the server.
        publish_time: Sends the recording's time to viewers, nanoseconds since 1970.
        publish_jump: Sends the target of a seek to viewers.
    """

    def __init__(
        self,
        program: Program,
        context: Context,
        publish_time: Callable[[int], None],
        publish_jump: Callable[[int], None],
    ) -> None:
        state = Channel(STATE, DIAGNOSTICS, latched=True, depth=1)
        super().__init__([*program.channels, state])
        self._publish_time = publish_time
        self._publish_jump = publish_jump
        self._channels = [
            _open(channel, program.typestore, context) for channel in program.channels
        ]
        self._channels.append(_open(state, TYPESTORE, context))
        self._state = len(program.channels)
        self._index = {channel.topic: index for index, channel in enumerate(self.channels)}
        self._lock = threading.Lock()
        self._latched: dict[int, deque[tuple[bytes, int]]] = {
            index: deque(maxlen=channel.depth)
            for index, channel in enumerate(self.channels)
            if channel.latched
        }
        self._resend_ns: int | None = None

    def query_wanted(self) -> frozenset[int]:
        """Return the on-demand outlets with a subscriber; resend latched messages after a seek."""
        if self._resend_ns is not None and time.monotonic_ns() >= self._resend_ns:
            self._resend()
        return super().query_wanted()

    def audience(self) -> Audience:
        """Count the channels with a viewer; the server does not count viewers."""
        watched = sum(channel.has_sinks() for channel in self._channels)
        return Audience(int(watched > 0), watched)

    def has_subscriber(self, outlet: int) -> bool:
        """Return whether a viewer subscribes to an outlet."""
        return bool(self._channels[outlet].has_sinks())

    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data."""
        latched = self._latched.get(outlet)
        if latched is not None:
            with self._lock:
                latched.append((data, stamp_ns))
            if self._resend_ns is not None:
                return
        self._channels[outlet].log(data, log_time=stamp_ns)

    def publish_state(self, data: bytes, stamp_ns: int) -> None:
        """Publish a DiagnosticArray on the channel STATE."""
        with self._lock:
            self._latched[self._state].append((data, stamp_ns))
        self._channels[self._state].log(data, log_time=stamp_ns)

    def subscribed(self, topic: str) -> None:
        """Handle a new subscription: query again, and send latched messages; from any thread.

        Other subscribers receive them again: the server cannot address a single one.
        """
        self._queried_ns = 0
        outlet = self._index.get(topic)
        if outlet is not None:
            self._send_latched(outlet)

    def publish_time(self, stamp_ns: int) -> None:
        """Send the recording's time."""
        self._publish_time(stamp_ns)

    def jump(self, stamp_ns: int) -> None:
        """Send a seek, for which viewers drop their messages; resend latched ones after a delay.

        Seeks and messages have separate queues, so either may arrive first.
        """
        with self._lock:
            for outlet, latched in self._latched.items():
                if outlet != self._state:
                    latched.clear()
        if self._resend_ns is None:
            self._resend_ns = time.monotonic_ns() + _RESEND_AFTER_NS
        self._publish_jump(stamp_ns)

    def _resend(self) -> None:
        self._resend_ns = None
        for outlet in self._latched:
            self._send_latched(outlet)

    def _send_latched(self, outlet: int) -> None:
        with self._lock:
            latched = list(self._latched.get(outlet, ()))
        for data, stamp_ns in latched:
            self._channels[outlet].log(data, log_time=stamp_ns)

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait a fixed time for queued messages; the server does not report their delivery."""
        if self._resend_ns is not None:
            self._resend()
        if any(channel.has_sinks() for channel in self._channels):
            time.sleep(min(seconds, _LAST_WAIT_S))
        return ()

    def close(self) -> None:
        """Remove the channels."""
        for channel in self._channels:
            channel.close()


def _open(channel: Channel, typestore: Typestore, context: Context) -> foxglove.Channel:
    """Open a viewer's channel with the schema of the topic in a bag."""
    text, _ = typestore.generate_msgdef(channel.msgtype, ros_version=2)
    schema = foxglove.Schema(name=channel.msgtype, encoding='ros2msg', data=text.encode())
    return foxglove.Channel(channel.topic, message_encoding='cdr', schema=schema, context=context)


NAME = '/kitti_player'

_GOODBYE_S = 1.0
_BACKLOG = 64
"""Messages that the SDK queues for each viewer, a quarter of a second of a drive with all topics.

It queues a copy for each viewer. The proxy always reads; messages of a slow viewer are in its
SendQueue, whose bound is in bytes.
"""

_WEB_VIEWER = 'https://app.foxglove.dev'

_SETTLED_NS = 100_000_000
"""Time in which a viewer has subscribed to all its topics."""

_STATE_EVERY_NS = 200_000_000


class ViewerServer(ServerListener):
    """Serves one program; playback is paused until the first viewer has subscribed.

    Args:
        program: The program; closed by stop.
        settings: Playback settings; with start_paused it also waits for a viewer's play button.
        port: TCP port; 0 takes a free one.
        warn: Called once with each reason for unpublished data or a refused connection.
        origin_check: The address to bind to, and the web pages that may connect.

    Attributes:
        session: The session.
        ended: Set when the session has ended or was stopped.
        on_ended: Called at its end, from the session's thread.
        error: The error that ended the session, if any.

    Raises:
        UsageError: The port is not available.
    """

    def __init__(
        self,
        program: Program,
        settings: PlaySettings,
        port: int,
        warn: Callable[[str], None],
        origin_check: OriginCheck,
    ) -> None:
        self.ended = threading.Event()
        self.on_ended: Callable[[], None] = lambda: None
        self.error: BaseException | None = None
        self._warn = warn
        self._waits = not settings.playback.start_paused
        self._asked_ns: int | None = None
        self._asked_to_seek = False
        self._sent: tuple[Any, float] | None = None
        self._state_ns = 0
        self._stopped = False
        self._context = Context()  # the SDK has no reference to it
        self._channels = ViewerChannels(
            program, self._context, self.publish_time, self._publish_jump
        )
        self.session = Session(
            program, settings, lambda _: self._channels, self._warn_all, self._publish_changes
        )
        self._proxy = _open_proxy(port, origin_check, warn)
        self._server = self._serve(program, with_clock=settings.playback.clock_hz > 0)

    def _serve(self, program: Program, *, with_clock: bool) -> WebSocketServer:
        first, last = program.stamps_ns[0], program.stamps_ns[-1]
        host = hidden_address()
        try:
            server = start_server(
                name=one_line(program.name),
                host=host,
                port=0,
                capabilities=[Capability.Time] if with_clock else [],
                server_listener=self,
                context=self._context,
                playback_time_range=(int(first), int(last)),
                message_backlog_size=_BACKLOG,
            )
        except RuntimeError as error:  # the SDK's only error
            self._proxy.close(0.0)
            raise UsageError(f'the server of foxglove-sdk does not start: {error}') from None
        self._proxy.open(host, server.port)
        return server

    @property
    def url(self) -> str:
        """The address for viewers."""
        return self._proxy.url

    @property
    def web_url(self) -> str:
        """The address of a web page with the viewer."""
        return f'{_WEB_VIEWER}?{urlencode({"ds": "foxglove-websocket", "ds.url": self.url})}'

    def start(self) -> None:
        """Start the session."""
        if self._waits:
            self.playback.pause()
        self.session.start(self._end)

    def stop(self) -> None:
        """Stop the session and disconnect viewers; a second call does nothing."""
        if self._stopped:
            return
        self._stopped = True
        self.session.stop()
        # The SDK waits for every viewer to read the close message; a suspended one never does.
        goodbye = threading.Thread(target=self._server.stop, daemon=True)
        deadline = time.monotonic() + _GOODBYE_S
        goodbye.start()
        goodbye.join(_GOODBYE_S)
        self._proxy.close(max(0.0, deadline - time.monotonic()))

    def _end(self, error: BaseException | None) -> None:
        self._publish_changes()
        self.error = error
        self.ended.set()
        self.on_ended()

    # Controls for the keys of a terminal.

    @property
    def playback(self) -> Playback:
        """The controls of the session."""
        return self.session.playback

    def set_rate(self, rate: float) -> None:
        """Set the rate.

        Raises:
            UsageError: The rate is out of range.
        """
        self.playback.change(rate=rate)

    def publish_state(self) -> None:
        """Publish the state."""
        self._state_ns = time.monotonic_ns()
        state = self.playback.state()
        name, counts = self.session.program.name, self.session.counts
        self._channels.publish_state(encode_state(NAME, name, state, counts), state.stamp_ns)

    # Requests of viewers; called from threads of the SDK.

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002
        """Send latched messages, and register the subscription."""
        self._asked_ns = time.monotonic_ns()
        self._channels.subscribed(channel.topic)

    def on_playback_control_request(self, request: PlaybackControlRequest) -> PlaybackState:
        """Play, pause, seek and change the rate; all viewers receive the answer.

        A seek while paused shows the frame at its target. Play at the end starts again.
        """
        self._waits = False
        low, high = RATES
        # A float32: its 0.01 is less than the float64 0.01.
        self.set_rate(min(high, max(low, round(request.playback_speed, 6))))
        play = request.playback_command == PlaybackCommand.Play
        target = request.seek_time
        state = self.playback.state()
        if target is None and play and state.paused and state.finished:
            target = 0
        if not play:
            self.playback.pause()
        if target is not None:
            self._seek(target, show=not play)
        if play:
            self.playback.resume()
        return self._playback_state(did_seek=target is not None, request_id=request.request_id)

    def _seek(self, stamp_ns: int, *, show: bool) -> None:
        self._asked_to_seek = True
        if show:
            self.playback.show(stamp_ns)
        else:
            self.playback.seek(min(stamp_ns, int(self.session.program.stamps_ns[-1])))

    # Notifications of viewers; called from the session's thread.

    def publish_time(self, stamp_ns: int) -> None:
        """Send the recording's time, nanoseconds since 1970."""
        self._proxy.publish_time(stamp_ns)

    def _publish_jump(self, stamp_ns: int) -> None:  # noqa: ARG002 - see the state
        # The answer to a seek request contains it.
        if not self._asked_to_seek:
            self._server.broadcast_playback_state(self._playback_state(did_seek=True))
        self._asked_to_seek = False

    def _publish_changes(self) -> None:
        now = time.monotonic_ns()
        self._begin_with_viewer(now)
        last = self._sent
        state = self._playback_state(did_seek=False)
        if self._sent != last:
            self._server.broadcast_playback_state(state)
        if self._sent != last or now - self._state_ns > _STATE_EVERY_NS:
            self.publish_state()

    def _begin_with_viewer(self, now: int) -> None:
        """Resume after the first viewer's subscription, unless a control was used."""
        if not self._waits:
            return
        if not self.playback.state().paused:
            self._waits = False
        elif self._asked_ns is not None and now - self._asked_ns > _SETTLED_NS:
            self._waits = False
            self.playback.resume()

    def _playback_state(self, *, did_seek: bool, request_id: str | None = None) -> PlaybackState:
        state = self.playback.state()
        status = PlaybackStatus.Playing
        if state.paused:
            status = PlaybackStatus.Ended if state.finished else PlaybackStatus.Paused
        self._sent = (status, state.rate)
        return PlaybackState(
            status=status,
            current_time=state.stamp_ns,
            playback_speed=state.rate,
            did_seek=did_seek,
            request_id=request_id,
        )

    def _warn_all(self, warning: str) -> None:
        self._warn(warning)
        self._server.publish_status(warning, StatusLevel.Warning)


def _open_proxy(port: int, origin_check: OriginCheck, warn: Callable[[str], None]) -> ViewerProxy:
    """Listen for viewers.

    Raises:
        UsageError: The address or the port is not available.
    """
    try:
        return ViewerProxy(origin_check.bound, port, origin_check, warn)
    except socket.gaierror as error:
        raise UsageError(
            f'{origin_check.bound}: no such address ({error.strerror}): --bind'
        ) from None
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            raise UsageError(
                f'{origin_check.bound} is not an address of this machine; --bind takes one that is,'
                f' or 0.0.0.0 for all'
            ) from None
        raise UsageError(
            f'port {port} is not available ({os.strerror(error.errno or 0)}); choose another one,'
            f' or 0 for any free port: --foxglove 0'
        ) from None


# The log of Foxglove's SDK, limited to a few lines.
#
# The SDK logs a line for each invalid message by Python's logging. A client may send thousands.

LEVEL_VARIABLE = 'FOXGLOVE_LOG_LEVEL'
"""The SDK's variable; if set, all lines of that level are logged."""

_OF_VIEWERS = 'foxglove.websocket'
_MOST = 3
"""Most lines about viewers, and about everything else."""


class _FewLines(logging.Handler):
    """A handler that forwards the first lines of each kind.

    Args:
        warn: Called with a line.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self._warn = warn
        self._counts: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Forward a record; called by one thread at a time."""
        kind = 'viewers' if record.name.startswith(_OF_VIEWERS) else 'itself'
        self._counts[kind] += 1
        if self._counts[kind] <= _MOST:
            self._warn(f'foxglove-sdk: {record.getMessage()}')
        elif self._counts[kind] == _MOST + 1:
            self._warn(
                f'foxglove-sdk: more lines about {kind} are not shown; {LEVEL_VARIABLE}=warn shows'
                f' all'
            )


@contextmanager
def few_lines(warn: Callable[[str], None]) -> Iterator[None]:
    """Limit the log of the SDK, unless the user has set a level.

    Args:
        warn: Called with a line.
    """
    if LEVEL_VARIABLE in os.environ:
        yield
        return
    handler = _FewLines(warn)
    root = logging.getLogger()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)


# Runs the player for viewers until it ends or a stop is requested.


def run_bridge(
    source: str,
    settings: PlaySettings,
    port: int,
    origin_check: OriginCheck,
    stop_request: StopRequest,
    terminal: Terminal,
) -> int:
    """Play until a stop is requested, or to an end that is no pause.

    Args:
        source: KITTI folder or bag.
        settings: Playback settings.
        port: TCP port; 0 takes a free one.
        origin_check: The address to bind to, and the web pages that may connect.
        stop_request: The request to stop.
        terminal: Shows the program, its address, and losses.

    Returns:
        The number of losses after a whole program: failed messages, and data missing from the
        start; 0 if a stop was requested.

    Raises:
        KittiRos2Error: The source cannot be played, or the port is not available.
    """
    _refuse(settings)
    favour_what_is_due()
    program = open_program(source, settings, reserved_by_viewers)
    with ExitStack() as exit_stack:
        exit_stack.callback(program.close)
        exit_stack.enter_context(few_lines(terminal.warn))
        server = ViewerServer(program, settings, port, terminal.warn, origin_check)
        server.on_ended = stop_request.set
        if not terminal.quiet:
            terminal.say(describe(program))
        terminal.say(f'Foxglove, Open connection: {server.url}; or in a browser: {server.web_url}')
        warning = exposure(origin_check.bound, server.url)
        if warning:
            terminal.warn(warning)
        for note in program.notes():
            terminal.warn(note)
        exit_stack.callback(server.stop)
        server.start()
        return play_to_the_end(server, stop_request, terminal)


def _refuse(settings: PlaySettings) -> None:
    """Refuse options that only a node supports."""
    delayed = settings.playback.delay_ns > 0
    meaningless = [
        ('--delay', delayed, 'it begins when the first viewer is there'),
        ('--stamps now', settings.stamps is Stamps.NOW, "viewers follow the recording's time"),
        ('--lossless', settings.playback.lossless, 'viewers acknowledge nothing'),
        ('--wait-for', settings.playback.subscribers > 0, 'it waits for the first viewer'),
        (
            '--qos-profile-overrides-path',
            settings.qos_overrides_path is not None,
            'a WebSocket has no QoS',
        ),
    ]
    for what, is_given, why in meaningless:
        if is_given:
            raise UsageError(f'{what} does not go with --foxglove: {why}')
