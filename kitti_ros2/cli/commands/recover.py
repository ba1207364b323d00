# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command recover."""

from pathlib import Path
from typing import Annotated, Optional

from ...model.containers import CONTAINERS
from .declared import FsyncOption, JsonOption, OverwriteOption, QuietOption, argument, choice


def recover(
    bag: Annotated[Path, argument('BAG', 'A truncated or damaged bag')],
    out: Annotated[Path, argument('OUT', 'The repaired bag, named like OUT of to-bag')],
    storage: Annotated[
        Optional[str],
        choice(CONTAINERS, 'Container of the repaired bag [default: by OUT, else that of BAG]'),
    ] = None,
    overwrite: OverwriteOption = False,
    fsync: FsyncOption = True,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> int:
    """Repair a truncated or damaged bag; each loss is listed.

    Examples:
      kitti-ros2 recover truncated.mcap repaired.mcap
      kitti-ros2 recover recording.bag repaired --storage mcap
    """
    from ..recover import run_recover

    return run_recover(bag, out, storage, overwrite=overwrite, fsync=fsync, json=json, quiet=quiet)
