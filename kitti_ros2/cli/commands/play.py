# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command play."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .shared import LayoutOption, SequenceOption


def play(  # noqa: PLR0913, PLR0917 - each is an option of the command
    context: typer.Context,
    src: Annotated[
        Optional[Path], typer.Argument(help='A KITTI folder or a bag [default: parameter source]')
    ] = None,
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    rate: Annotated[
        Optional[float], typer.Option('--rate', '-r', help='Speed, 0.01 to 100 [default: 1]')
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', '-l', help='Play without end.')] = False,
    times: Annotated[Optional[int], typer.Option(help='Play so many times [default: 1]')] = None,
    start: Annotated[
        Optional[str],
        typer.Option(help="First frame (12), seconds (3.5s) or '2011-09-26 13:02:25.9'"),
    ] = None,
    end: Annotated[Optional[str], typer.Option(help='Last one, included')] = None,
    start_paused: Annotated[
        Optional[bool], typer.Option('--start-paused', '-p', help='Wait for a resume.')
    ] = None,
    delay: Annotated[
        Optional[float],
        typer.Option('--delay', '-d', help='Seconds before the first message, after --wait-for'),
    ] = None,
    clock: Annotated[
        Optional[float], typer.Option(help='/clock messages a second, 0 none [default: 100]')
    ] = None,
    stamps: Annotated[
        Optional[str], typer.Option(help='original or now [default: original]')
    ] = None,
    lossless: Annotated[
        Optional[bool],
        typer.Option('--lossless', help='As fast as subscribers take it; nothing is dropped.'),
    ] = None,
    wait_for: Annotated[
        Optional[int],
        typer.Option(
            help='Wait until so many nodes subscribe, to any of the topics, and for 1 s no'
            ' subscription was added: a recorder subscribes to one topic after the other'
            ' [default: 1 with --lossless, else 0]'
        ),
    ] = None,
    at_end: Annotated[Optional[str], typer.Option(help='exit or pause [default: exit]')] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help='Only these topics, * matches; repeatable')
    ] = None,
    streams: Annotated[
        Optional[list[str]], typer.Option(help='Only these streams; repeatable')
    ] = None,
    images: Annotated[
        Optional[str], typer.Option(help='compressed, raw or both [default: both]')
    ] = None,
    preset: Annotated[
        Optional[str], typer.Option(help='Topic and frame names: default or kitti2bag')
    ] = None,
    map_frame: Annotated[
        Optional[str],
        typer.Option('--map', help="map: enu (gravity-aligned) or devkit (KITTI's) [default: enu]"),
    ] = None,
    tf: Annotated[
        Optional[bool], typer.Option('--tf/--no-tf', help='map -> base_link on /tf [default: tf]')
    ] = None,
    annotated: Annotated[
        Optional[bool],
        typer.Option('--annotated', help='Also images with the labels drawn on them'),
    ] = None,
    read_ahead: Annotated[
        Optional[int], typer.Option(help='Frames to read ahead [default: 8]')
    ] = None,
    qos_overrides: Annotated[
        Optional[Path],
        typer.Option('--qos-profile-overrides-path', help='QoS by topic, as ros2 bag play has it'),
    ] = None,
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
) -> int:
    """Play a KITTI recording or a bag live in ROS 2, with the controls of ros2 bag play.

    What follows --ros-args is for ROS: parameters (-p), remappings (-r), a parameter file.

    With --foxglove it is watched without ROS. It begins when the first viewer is there; the play
    controls of the viewer pause, seek and set the speed. At the end it pauses, unless --at-end
    says otherwise. --clock is then how often viewers are told the time [default: 20].
    """
    given = {
        'layout': layout,
        'sequence': sequence,
        'rate': rate,
        'loop': 0 if loop else times,
        'start': start,
        'end': end,
        'start_paused': start_paused,
        'delay': delay,
        'clock': clock,
        'stamps': stamps,
        'lossless': lossless,
        'wait_for': wait_for,
        'at_end': at_end,
        'topics': topics or None,
        'streams': streams or None,
        'images': images,
        'preset': preset,
        'map': map_frame,
        'tf': tf,
        'annotated': annotated,
        'read_ahead': read_ahead,
        'qos_overrides_path': None if qos_overrides is None else str(qos_overrides),
    }
    from ..play import run_play

    return run_play(src, given, config, context.obj, foxglove=foxglove, keyboard=keyboard)
