# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command play."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import QuietOption, argument, chosen, takes

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
            help='With --foxglove: the address that viewers connect to, 0.0.0.0 for all of this'
            ' machine [default: 127.0.0.1]',
        ),
    ] = None,
    allow_origin: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar='ORIGIN...',
            help='With --foxglove: web pages that may connect, besides those of Foxglove and of'
            ' this machine, such as https://viewer.example.org',
        ),
    ] = None,
    keyboard: Annotated[
        bool, typer.Option('--keyboard/--no-keyboard', help='Control it by keys in a terminal')
    ] = True,
    quiet: QuietOption = False,
    loop: Annotated[
        bool, typer.Option('--loop', '-l', help='Play endlessly', rich_help_panel=_PLAYBACK)
    ] = False,
    times: Annotated[
        Optional[int],
        typer.Option(
            metavar='N', help='Play so many times [default: 1]', rich_help_panel=_PLAYBACK
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
    from ..play import run_play, viewer_access

    settings = chosen({'loop': 0 if loop else times, **given})
    viewers = viewer_access(foxglove, bind, allow_origin or ())
    return run_play(
        src, settings, config, context.obj, viewers=viewers, keyboard=keyboard, quiet=quiet
    )
