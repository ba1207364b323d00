# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command to-bag."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.containers import FILE_NAMES
from .declared import JsonOption, QuietOption, argument, chosen, takes


@takes('TO_BAG_ALL')
def to_bag(
    src: Annotated[Path, argument('SRC', 'A KITTI folder: a drive, a data set, a sequence')],
    out: Annotated[
        Path,
        argument('OUT', f'The bag: {FILE_NAMES}, or a rosbag2 directory'),
    ],
    config: Annotated[
        Optional[Path],
        typer.Option(metavar='PATH', help='A YAML file of these options; the command line wins'),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write a KITTI recording to a bag (MCAP, sqlite3, ROS 1).

    With --all: every drive, sequence and split below SRC, to OUT/NAME.mcap. A run that was stopped
    goes on where it was; the command status shows what is done.

    Examples:
      kitti-ros2 to-bag 2011_09_26/2011_09_26_drive_0005_sync drive_0005.mcap
      kitti-ros2 to-bag raw bags --all --jobs 4 --exclude-topics '*image*'
    """
    values = chosen(given)
    scheduler = values.get('scheduler')
    alone = str(values.get('jobs')) == '1' and not scheduler
    if values.get('all') and not alone and scheduler in {None, 'local'}:
        from ...batch.pool import prepare_workers

        # They import while this process does.
        prepare_workers(cluster=scheduler is not None)
    from ..to_bag import run_to_bag

    return run_to_bag(src, out, values, config, json=json, quiet=quiet)
