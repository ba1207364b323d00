# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command split."""

from pathlib import Path
from typing import Annotated

from .declared import JsonOption, QuietOption, argument, chosen, takes


@takes('SPLIT', of='datasets')
def split(
    src: Annotated[Path, argument('SRC', 'A data set: object, tracking, odometry or raw')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Divide a data set into lists such as train.txt, or check lists.

    Lists of an object set are of frames, of other layouts of whole sequences or drives. The same
    seed makes the same lists on every machine. Frames of one drive look alike: --by-drive keeps
    them in one list. --check exits with 1 where lists overlap or share a drive.

    Examples:
      kitti-ros2 split object --ratio 0.8 0.2 --by-drive
      kitti-ros2 split object --check
    """
    from ..split import run_split

    return run_split(src, chosen(given), json=json, quiet=quiet)
