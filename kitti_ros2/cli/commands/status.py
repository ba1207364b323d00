# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command status."""

from pathlib import Path
from typing import Annotated

from .declared import JsonOption, QuietOption, argument


def status(
    out: Annotated[Path, argument('OUT', 'The folder that a command with --all writes')],
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> int:
    """Show how much of a collection is done, failed and left.

    Also how fast it goes, and why units failed. It may be asked while the collection is written.

    Examples:
      kitti-ros2 status bags
      kitti-ros2 status bags --json
    """
    from ..status import run_status

    return run_status(out, json=json, quiet=quiet)
