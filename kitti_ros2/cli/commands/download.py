# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command download."""

from typing import Annotated, Optional

import typer

from .declared import JsonOption, QuietOption, chosen, takes


@takes('DOWNLOAD', of='datasets')
def download(
    words: Annotated[
        Optional[list[str]],
        typer.Argument(
            metavar='WHAT... ROOT',
            help='A benchmark with its parts, or raw drives; then the folder to download into',
        ),
    ] = None,
    list_: Annotated[
        bool, typer.Option('--list', help='List what there is, with sizes, and stop; no ROOT')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Download KITTI's archives by name and extract them.

    WHAT: object, tracking or odometry with parts (image_2, calib, ... or all); raw with drives
    (2011_09_26_drive_0005), ranges (2011_09_26_drive_0001..0017), days (2011_09_26) or all. Drives
    come with the calibration of their day. An interrupted run goes on.

    Examples:
      kitti-ros2 download raw 2011_09_26_drive_0005 kitti --accept-license
      kitti-ros2 download object velodyne calib label_2 kitti
    """
    from ..download import run_download

    return run_download(words or [], chosen(given), listing=list_, json=json, quiet=quiet)
