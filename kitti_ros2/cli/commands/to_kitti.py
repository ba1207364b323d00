# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command to-kitti."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import JsonOption, QuietOption, chosen, takes


@takes('TO_KITTI_ALL')
def to_kitti(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='BAG... OUT',
            help='Bags of one recording, then the folder to create; a terminal shows the plan'
            ' where OUT is left out',
        ),
    ],
    plan: Annotated[
        bool, typer.Option('--plan', help='Print which topic is which stream, and stop; no OUT')
    ] = False,
    plan_file: Annotated[
        Optional[Path],
        typer.Option(metavar='PATH', help='Use this plan, in the format that --plan prints'),
    ] = None,
    preview: Annotated[
        Optional[Path],
        typer.Option(
            metavar='PATH',
            help='First draw points and boxes of three frames on the images (.png, .jpg, .webp);'
            ' without OUT only that',
        ),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.

    A bag written by to-bag becomes the original recording; others are converted by a plan. In a
    terminal, a bag without OUT shows the plan: which topic becomes what. With --all: every bag
    below BAG, to OUT/NAME.

    Examples:
      kitti-ros2 to-kitti drive_0005.mcap raw_data
      kitti-ros2 to-kitti drive.bag my_set --layout object --start 10s --end 20s
    """
    from ..to_kitti import run_to_kitti

    return run_to_kitti(
        paths,
        chosen(given),
        plan_file,
        plan_only=plan,
        preview=preview,
        json=json,
        quiet=quiet,
    )
