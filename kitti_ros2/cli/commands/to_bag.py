# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command to-bag."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.containers import CONTAINER_NAMES, FILE_NAMES
from .shared import LayoutOption, QuietOption, SequenceOption


def to_bag(  # noqa: PLR0913, PLR0917 - each is an option of the command
    src: Annotated[Path, typer.Argument(help='A KITTI folder: a drive, a data set, a sequence.')],
    out: Annotated[Path, typer.Argument(help=f'The bag: {FILE_NAMES}, or a rosbag2 directory.')],
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    images: Annotated[
        Optional[str],
        typer.Option(
            help='compressed (the PNG itself), raw (pixels) or both [default: compressed]'
        ),
    ] = None,
    storage: Annotated[
        Optional[str],
        typer.Option(help=f"{CONTAINER_NAMES} [default: by OUT's ending, or mcap]"),
    ] = None,
    compression: Annotated[
        Optional[str], typer.Option(help='none, lz4, zstd or (ros1) bz2 [default: none]')
    ] = None,
    compression_level: Annotated[
        Optional[int], typer.Option(help="[default: the compressor's own]")
    ] = None,
    split_size: Annotated[
        Optional[str], typer.Option(help='Begin a new file after so many bytes, e.g. 2GB')
    ] = None,
    split_duration: Annotated[
        Optional[str], typer.Option(help='Begin a new file after so many seconds, e.g. 60s')
    ] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help="Only these topics; * matches, e.g. '/kitti/oxts/*'")
    ] = None,
    streams: Annotated[
        Optional[list[str]],
        typer.Option(help='Only these: scan, image, image_2, oxts, pose, labels, calibration, ...'),
    ] = None,
    start: Annotated[
        Optional[str],
        typer.Option(help="First frame (12), seconds (3.5s) or time ('2011-09-26 13:02:26')"),
    ] = None,
    end: Annotated[
        Optional[str], typer.Option(help='Last one, included; written as --start')
    ] = None,
    preset: Annotated[
        Optional[str], typer.Option(help='Topic and frame names: default or kitti2bag')
    ] = None,
    map_frame: Annotated[
        Optional[str],
        typer.Option('--map', help="map: enu (gravity-aligned) or devkit (KITTI's) [default: enu]"),
    ] = None,
    tf: Annotated[
        Optional[bool],
        typer.Option('--tf/--no-tf', help='Write map -> base_link on /tf [default: tf]'),
    ] = None,
    ring_time: Annotated[
        Optional[bool],
        typer.Option(
            '--ring-time/--no-ring-time', help='Points also have ring and time, in order of time'
        ),
    ] = None,
    scan_stamp: Annotated[
        Optional[str],
        typer.Option(
            help='Of a scan: start of its turn, or forward [default: start with --ring-time,'
            ' else forward]'
        ),
    ] = None,
    semantic: Annotated[
        Optional[bool],
        typer.Option('--semantic/--no-semantic', help="Points also have SemanticKITTI's labels"),
    ] = None,
    marker_colors: Annotated[
        Optional[str], typer.Option(help='Label markers coloured by class or by track')
    ] = None,
    trails: Annotated[
        Optional[bool], typer.Option('--trails/--no-trails', help='Markers of where tracks were')
    ] = None,
    base_to_imu: Annotated[
        Optional[str],
        typer.Option(help="x,y,z of imu_link in base_link, m, e.g. '-0.05,0.32,0.93'"),
    ] = None,
    epoch: Annotated[
        Optional[str],
        typer.Option(help="When recordings without time begin, e.g. '2011-09-26 00:00:00'"),
    ] = None,
    period: Annotated[
        Optional[str],
        typer.Option(help='Seconds a frame of recordings without time [default: 0.1036]'),
    ] = None,
    config: Annotated[
        Optional[Path], typer.Option(help='A YAML file of these options; the command line wins')
    ] = None,
    strict: Annotated[
        Optional[bool],
        typer.Option(
            '--strict/--no-strict', help='Stop at the first bad file, leave nothing behind'
        ),
    ] = None,
    overwrite: Annotated[
        Optional[bool], typer.Option('--overwrite/--no-overwrite', help='Replace an existing bag')
    ] = None,
    quiet: QuietOption = False,
) -> int:
    """Write a KITTI recording to a bag (MCAP, rosbag2 sqlite3, ROS 1)."""
    given = {
        'layout': layout,
        'sequence': sequence,
        'images': images,
        'storage': storage,
        'compression': compression,
        'compression_level': compression_level,
        'split_size': split_size,
        'split_duration': split_duration,
        'topics': topics or None,
        'streams': streams or None,
        'start': start,
        'end': end,
        'preset': preset,
        'map': map_frame,
        'tf': tf,
        'ring_time': ring_time,
        'scan_stamp': scan_stamp,
        'semantic': semantic,
        'marker_colors': marker_colors,
        'trails': trails,
        'base_to_imu': base_to_imu,
        'epoch': epoch,
        'period': period,
        'strict': strict,
        'overwrite': overwrite,
    }
    from ..to_bag import run_to_bag

    return run_to_bag(src, out, given, config, quiet=quiet)
