# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command to-bag."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.containers import FILE_NAMES
from .declared import QuietOption, chosen, takes


@takes('TO_BAG')
def to_bag(
    src: Annotated[Path, typer.Argument(help='A KITTI folder: a drive, a data set, a sequence.')],
    out: Annotated[Path, typer.Argument(help=f'The bag: {FILE_NAMES}, or a rosbag2 directory.')],
    config: Annotated[
        Optional[Path], typer.Option(help='A YAML file of these options; the command line wins')
    ] = None,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write a KITTI recording to a bag (MCAP, rosbag2 sqlite3, ROS 1)."""
    from ..to_bag import run_to_bag

    return run_to_bag(src, out, chosen(given), config, quiet=quiet)
