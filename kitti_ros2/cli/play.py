# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 play."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.processes import freeze_imports
from ..model.errors import UsageError
from ..options.declare import parse_texts
from ..options.table import PLAY, make_play_settings
from ..player.ros_installation import check_installed
from .command import QuietOption, add_config, argument, takes
from .exits import EXIT_LOSSES, EXIT_OK, end_by_signal
from .output import say, say_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .exits import Ending


_ROS_ARGS = '--ros-args'
_FOXGLOVE = '--foxglove'
_PORT = 8765
_LOOPBACK = '127.0.0.1'
_LAST_PORT = 65535
_VIEWERS_CLOCK_HZ = 20.0


@dataclass(frozen=True)
class ViewerAccess:
    """Address for viewers, and the web pages that may connect.

    Attributes:
        port: TCP port.
        bind: Address of this machine, or a name of one.
        origins: Further web pages that may connect.
    """

    port: int
    bind: str
    origins: tuple[str, ...]


def viewer_access(
    port: int | None, bind: str | None, allow_origin: Sequence[str]
) -> ViewerAccess | None:
    """Return the access of viewers by the options; None without --foxglove.

    Raises:
        UsageError: There are other options for viewers without --foxglove.
    """
    if port is not None:
        return ViewerAccess(port, bind or _LOOPBACK, parse_texts('allow_origin', allow_origin))
    if bind is not None or allow_origin:
        raise UsageError(f'--bind and --allow-origin are for viewers: give {_FOXGLOVE}, too')
    return None


def split_ros_args(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return our arguments, and those of ROS: from each --ros-args to the next -- or the end."""
    ours: list[str] = []
    theirs: list[str] = []
    reading = False
    for word in words:
        if word == _ROS_ARGS:
            reading = True
        (theirs if reading else ours).append(word)
        if word == '--':
            reading = False
    return ours, theirs


def complete_port(words: Sequence[str]) -> list[str]:
    """Complete `--foxglove` with a port: its own, the number after it, or the default."""
    completed: list[str] = []
    waiting = False
    for word in words:
        if waiting and word.isdecimal():
            completed[-1] = f'{_FOXGLOVE}={word}'
            waiting = False
            continue
        waiting = word == _FOXGLOVE and '--' not in completed
        completed.append(f'{_FOXGLOVE}={_PORT}' if waiting else word)
    return completed


def _play_for_viewers(
    src: Path | None,
    chosen: dict[str, object],
    ros_args: Sequence[str],
    ending: Ending,
    viewers: ViewerAccess,
    *,
    keyboard: bool,
    quiet: bool,
) -> int:
    from ..files.processes import keep_freed_memory
    from ..player.terminal import StatusLine, Terminal

    if not 0 <= viewers.port <= _LAST_PORT:
        raise UsageError(f'invalid port {viewers.port}; {_FOXGLOVE} takes 0 to {_LAST_PORT}')
    if src is None:
        raise UsageError('SRC is missing (a KITTI folder or a bag); usage: kitti-ros2 play SRC')
    if ros_args:
        raise UsageError(f'{_ROS_ARGS} does not go with {_FOXGLOVE}: no node is started')
    # A user of a viewer may seek at the end; a displayed clock needs fewer messages than /clock.
    settings = make_play_settings({'at_end': 'pause', 'clock': _VIEWERS_CLOCK_HZ, **chosen})
    try:
        from ..viewers.foxglove_server import run_bridge
        from ..viewers.origin_check import OriginCheck, parse_origin
    except ImportError as error:  # the SDK is missing or too old for playback control
        raise UsageError(
            '--foxglove needs foxglove-sdk 0.30 and websockets 15; run'
            " pip install 'kitti_ros2[foxglove]'"
        ) from error
    origin_check = OriginCheck(viewers.bind, frozenset(map(parse_origin, viewers.origins)))
    freeze_imports()
    keep_freed_memory()
    status = StatusLine(show=not quiet)

    def print_line(text: str) -> None:
        status.hide()
        say(text)
        sys.stdout.flush()

    def warn(text: str) -> None:
        status.hide()
        say_error(text)

    terminal = Terminal(print_line, warn, status, keyboard=keyboard, quiet=quiet)
    failures = run_bridge(str(src), settings, viewers.port, origin_check, ending, terminal)
    return EXIT_LOSSES if failures else EXIT_OK


_PLAYBACK = 'Playback'


@takes('PLAY', but=('loop',))
def play(  # noqa: PLR0913, PLR0917 - each is an option of the command
    context: typer.Context,
    src: Annotated[
        Optional[Path], argument('SRC', 'A KITTI folder or a bag [default: parameter source]')
    ] = None,
    config: Annotated[
        Optional[Path],
        typer.Option(metavar='PATH', help='A YAML file of options; the command line wins'),
    ] = None,
    foxglove: Annotated[
        Optional[int],
        typer.Option(
            metavar='[PORT]',
            help='Play for Foxglove, not for ROS: ws://127.0.0.1:PORT (8765; 0 any free one)',
        ),
    ] = None,
    bind: Annotated[
        Optional[str],
        typer.Option(
            metavar='ADDRESS',
            hidden=True,
            help='With --foxglove: the address that viewers connect to, 0.0.0.0 for all of this'
            ' machine [default: 127.0.0.1]',
        ),
    ] = None,
    allow_origin: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar='ORIGIN...',
            hidden=True,
            help='With --foxglove: web pages that may connect, besides those of Foxglove and of'
            ' this machine, such as https://viewer.example.org',
        ),
    ] = None,
    keyboard: Annotated[
        bool,
        typer.Option(
            '--keyboard/--no-keyboard', hidden=True, help='Control it by keys in a terminal'
        ),
    ] = True,
    quiet: QuietOption = False,
    loop: Annotated[
        bool, typer.Option('--loop', '-l', help='Play endlessly', rich_help_panel=_PLAYBACK)
    ] = False,
    times: Annotated[
        Optional[int],
        typer.Option(
            metavar='N',
            hidden=True,
            help='Play so many times [default: 1]',
            rich_help_panel=_PLAYBACK,
        ),
    ] = None,
    **given: object,
) -> int:
    """Play a KITTI folder or a bag live, in ROS 2 or for Foxglove.

    The controls are those of ros2 bag play. In a terminal: space pauses, right and left play the
    next frame and the one before, up and down change the rate, q quits.

    Arguments after --ros-args go to ROS: parameters (-p), remappings (-r), a parameter file.

    With --foxglove it plays without ROS. It starts when the first viewer connects; the play
    controls of the viewer pause, seek and set the speed. At the end it pauses, unless --at-end
    exit is given. --clock is then how often viewers receive the time [default: 20].

    Examples:
      kitti-ros2 play 2011_09_26/2011_09_26_drive_0005_sync --loop
      kitti-ros2 play drive_0005.mcap --rate 0.5 --topics /kitti/velo/points '/tf*'
    """
    from ..files.processes import keep_freed_memory

    if loop or times is not None:
        given['loop'] = 0 if loop else times
    viewers = viewer_access(foxglove, bind, allow_origin or ())
    ending = end_by_signal()
    if config:
        given = add_config(config, given, PLAY)
    if viewers is not None:
        controls = {'keyboard': keyboard, 'quiet': quiet}
        return _play_for_viewers(src, given, context.obj, ending, viewers, **controls)
    make_play_settings(given)
    if src is not None:
        given['source'] = str(src)
    check_installed()
    from ..player.run import run_player

    freeze_imports()
    keep_freed_memory()
    failures = run_player(given, context.obj, ending, keyboard=keyboard, quiet=quiet)
    return EXIT_LOSSES if failures else EXIT_OK
