# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command extract."""

from pathlib import Path
from typing import Annotated

import typer

from .declared import JsonOption, QuietOption, chosen, takes


@takes('EXTRACT', of='datasets')
def extract(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='ARCHIVE... ROOT',
            help='Zip or tar archives, then the folder to extract them into',
        ),
    ],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Extract KITTI's archives into the folders that readers expect.

    Each file goes where its known folders belong (2011_09_26/..., training/..., dataset/...),
    whatever the archive has above them. Equal files are kept: an interrupted run goes on.

    Examples:
      kitti-ros2 extract 2011_09_26_drive_0005_sync.zip 2011_09_26_calib.zip kitti
      kitti-ros2 extract downloads/data_object_calib.zip object --remove-archives
    """
    from ..extract import run_extract

    return run_extract(paths, chosen(given), json=json, quiet=quiet)
