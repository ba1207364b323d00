# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command play."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import chosen, takes


@takes('PLAY', but=('loop',))
def play(
    context: typer.Context,
    src: Annotated[
        Optional[Path], typer.Argument(help='A KITTI folder or a bag [default: parameter source]')
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', '-l', help='Play endlessly.')] = False,
    times: Annotated[Optional[int], typer.Option(help='Play so many times [default: 1]')] = None,
    config: Annotated[
        Optional[Path], typer.Option(help='A YAML file of options; the command line wins')
    ] = None,
    foxglove: Annotated[
        Optional[int],
        typer.Option(
            metavar='[PORT]',
            help='Play for Foxglove, not for ROS: ws://127.0.0.1:PORT (8765; 0 any free one)',
        ),
    ] = None,
    keyboard: Annotated[
        bool, typer.Option('--keyboard/--no-keyboard', help='Control it by keys in a terminal')
    ] = True,
    **given: object,
) -> int:
    """Play a KITTI recording or a bag live in ROS 2, with the controls of ros2 bag play.

    Arguments after --ros-args go to ROS: parameters (-p), remappings (-r), a parameter file.

    With --foxglove it plays without ROS. It starts when the first viewer connects; the play
    controls of the viewer pause, seek and set the speed. At the end it pauses, unless --at-end
    exit is given. --clock is then how often viewers receive the time [default: 20].
    """
    from ..play import run_play

    settings = chosen({'loop': 0 if loop else times, **given})
    return run_play(src, settings, config, context.obj, foxglove=foxglove, keyboard=keyboard)
