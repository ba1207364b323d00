# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command crop."""

from pathlib import Path
from typing import Annotated

from .declared import JsonOption, QuietOption, argument, chosen, takes


@takes('CROP', of='datasets')
def crop(
    src: Annotated[Path, argument('SRC', 'A KITTI folder: a drive, split, sequence or whole set')],
    out: Annotated[Path, argument('OUT', 'The folder to create')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Cut scans by view, box, range, height, lasers or voxels.

    OUT is a data set of the same layout, with the same names. All recordings of SRC are cut, or
    the one of --sequence. A point is kept if it passes all filters. Unchanged files are hard links
    to those of SRC: editing one in place changes both.

    Examples:
      kitti-ros2 crop object object_reduced --view reduced --folder velodyne_reduced
      kitti-ros2 crop odometry front --sequence 00 --box 0 -40 -3 70 40 1
    """
    from ..crop import run_crop

    return run_crop(src, out, chosen(given), json=json, quiet=quiet)
