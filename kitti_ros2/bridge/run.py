# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the player for viewers until it ends or a stop is requested."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..options.playback import Stamps
from ..player.session import favour_what_is_due
from ..player.source import describe, open_program, reserved_by_viewers
from ..player.to_the_end import play_to_the_end
from .gate import exposure
from .sdk_log import few_lines
from .server import ViewerServer

if TYPE_CHECKING:
    from ..options.settings import PlaySettings
    from ..player.status import Terminal
    from ..player.to_the_end import StopRequest
    from .admission import Admission


def run_bridge(
    source: str,
    settings: PlaySettings,
    port: int,
    admission: Admission,
    stop_request: StopRequest,
    terminal: Terminal,
) -> int:
    """Play until a stop is requested, or everything is played and the end is no pause.

    Args:
        source: KITTI folder or bag.
        settings: Playback settings.
        port: TCP port; 0 takes a free one.
        admission: The address to bind to, and which web pages may connect.
        stop_request: The request to stop.
        terminal: Shows the program, its address, and what cannot be played.

    Returns:
        The number of losses if everything was played: messages that could not be made, and data
        missing from the start; 0 if a stop was requested.

    Raises:
        KittiRos2Error: The source cannot be played, or the port is not available.
    """
    _refuse(settings)
    favour_what_is_due()
    program = open_program(source, settings, reserved_by_viewers)
    with ExitStack() as stack:
        stack.callback(program.close)
        stack.enter_context(few_lines(terminal.complain))
        server = ViewerServer(program, settings, port, terminal.complain, admission)
        server.on_ended = stop_request.set
        if not terminal.quiet:
            terminal.say(describe(program))
        terminal.say(f'Foxglove, Open connection: {server.url}; or in a browser: {server.web_url}')
        warning = exposure(admission.bound, server.url)
        if warning:
            terminal.complain(warning)
        for note in program.notes():
            terminal.complain(note)
        stack.callback(server.stop)
        server.start()
        return play_to_the_end(server, stop_request, terminal)


def _refuse(settings: PlaySettings) -> None:
    """Raise UsageError for options that only a node supports."""
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
