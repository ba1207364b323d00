# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command info."""

from pathlib import Path
from typing import Annotated

from .declared import JsonOption, QuietOption, argument, chosen, takes


@takes('SOURCE')
def info(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Summarize a KITTI folder or a bag.

    Layout or container, streams with counts, rates and gaps, calibration.

    Examples:
      kitti-ros2 info 2011_09_26/2011_09_26_drive_0005_sync
      kitti-ros2 info drive_0005.mcap --json
    """
    from ..info import run_info

    return run_info(src, chosen(given), json=json, quiet=quiet)
