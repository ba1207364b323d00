# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's WebSocket server around a session, which viewers display and control."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from foxglove import Context, StatusLevel, start_server
from foxglove.websocket import (
    Capability,
    PlaybackCommand,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from ..model.errors import UsageError
from ..model.text import one_line
from ..options.playback import RATES
from ..player.session import Session
from ..player.state import encode_state
from .channels import ViewerChannels
from .gate import Gate, hidden_address

if TYPE_CHECKING:
    from collections.abc import Callable

    from foxglove.websocket import (
        ChannelView,
        Client,
        PlaybackControlRequest,
        WebSocketServer,
    )

    from ..options.settings import PlaySettings
    from ..player.playback import Playback
    from ..player.program import Program
    from .admission import Admission

NAME = '/kitti_player'

_GOODBYE_S = 1.0
_BACKLOG = 64
"""Messages that the SDK queues for each viewer, a quarter of a second of a drive with all topics.

It queues a copy for each viewer. The gate always reads; what a slow viewer does not take waits in
its Outbox, whose bound is in bytes.
"""

_WEB_VIEWER = 'https://app.foxglove.dev'

_SETTLED_NS = 100_000_000
"""A viewer subscribes to all its topics in much less time than this."""

_STATE_EVERY_NS = 200_000_000


class ViewerServer(ServerListener):
    """Serves one program; playback is paused until the first viewer has subscribed.

    Args:
        program: The program; closed by stop.
        settings: Playback settings; with start_paused it also waits for a viewer's play button.
        port: TCP port; 0 takes a free one.
        complain: Called once with each reason why something cannot be published, or a connection
            is refused.
        admission: The address to bind to, and which web pages may connect.

    Attributes:
        session: The session.
        ended: Set when the session has ended or was stopped.
        on_ended: Called then, from the session's thread.
        error: The error that ended the session, if any.

    Raises:
        UsageError: The port is not available.
    """

    def __init__(
        self,
        program: Program,
        settings: PlaySettings,
        port: int,
        complain: Callable[[str], None],
        admission: Admission,
    ) -> None:
        self.ended = threading.Event()
        self.on_ended: Callable[[], None] = lambda: None
        self.error: BaseException | None = None
        self._complain = complain
        self._waits = not settings.playback.start_paused
        self._asked_ns: int | None = None
        self._asked_to_seek = False
        self._sent: tuple[Any, float] | None = None
        self._state_ns = 0
        self._stopped = False
        self._context = Context()  # the SDK does not hold it
        self._channels = ViewerChannels(program, self._context, self.tell_time, self._tell_jump)
        self.session = Session(
            program, settings, lambda _: self._channels, self._complain_to_all, self._tell_changes
        )
        self._gate = _open_gate(port, admission, complain)
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
        except RuntimeError as error:  # the SDK raises it for every failure
            self._gate.close(0.0)
            raise UsageError(f'the server of foxglove-sdk does not start: {error}') from None
        self._gate.open(host, server.port)
        return server

    @property
    def url(self) -> str:
        """The address for viewers."""
        return self._gate.url

    @property
    def web_url(self) -> str:
        """The address of a web page that shows it."""
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
        # The SDK waits until every viewer has read the close message; a suspended one never does.
        goodbye = threading.Thread(target=self._server.stop, daemon=True)
        deadline = time.monotonic() + _GOODBYE_S
        goodbye.start()
        goodbye.join(_GOODBYE_S)
        self._gate.close(max(0.0, deadline - time.monotonic()))

    def _end(self, error: BaseException | None) -> None:
        self._tell_changes()
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

    def tell_state(self) -> None:
        """Publish the state."""
        self._state_ns = time.monotonic_ns()
        state = self.playback.state()
        name, counts = self.session.program.name, self.session.counts
        self._channels.publish_state(encode_state(NAME, name, state, counts), state.stamp_ns)

    # Requests of viewers; called from threads of the SDK.

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:  # noqa: ARG002
        """Send latched messages, and note the subscription."""
        self._asked_ns = time.monotonic_ns()
        self._channels.subscribed(channel.topic)

    def on_playback_control_request(self, request: PlaybackControlRequest) -> PlaybackState:
        """Play, pause, seek and change the rate; the answer goes to all viewers.

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

    def tell_time(self, stamp_ns: int) -> None:
        """Send the recording's time, nanoseconds since 1970."""
        self._gate.tell_time(stamp_ns)

    def _tell_jump(self, stamp_ns: int) -> None:  # noqa: ARG002 - the state has it
        # The answer to a seek request contains it already.
        if not self._asked_to_seek:
            self._server.broadcast_playback_state(self._playback_state(did_seek=True))
        self._asked_to_seek = False

    def _tell_changes(self) -> None:
        now = time.monotonic_ns()
        self._begin_with_viewer(now)
        last = self._sent
        state = self._playback_state(did_seek=False)
        if self._sent != last:
            self._server.broadcast_playback_state(state)
        if self._sent != last or now - self._state_ns > _STATE_EVERY_NS:
            self.tell_state()

    def _begin_with_viewer(self, now: int) -> None:
        """Resume once the first viewer has subscribed, unless a control was used."""
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

    def _complain_to_all(self, complaint: str) -> None:
        self._complain(complaint)
        self._server.publish_status(complaint, StatusLevel.Warning)


def _open_gate(port: int, admission: Admission, complain: Callable[[str], None]) -> Gate:
    """Listen for viewers.

    Raises:
        UsageError: The address or the port is not available.
    """
    try:
        return Gate(admission.bound, port, admission, complain)
    except socket.gaierror as error:
        raise UsageError(f'{admission.bound}: no such address ({error.strerror}): --bind') from None
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            raise UsageError(
                f'{admission.bound} is not an address of this machine; --bind takes one that is,'
                f' or 0.0.0.0 for all'
            ) from None
        raise UsageError(
            f'port {port} is not available ({os.strerror(error.errno or 0)}); choose another one,'
            f' or 0 for any free port: --foxglove 0'
        ) from None
