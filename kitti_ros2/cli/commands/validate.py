# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command validate."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import AllOverwriteOption, JsonOption, QuietOption, chosen, out_option, takes


@takes('VALIDATE_ALL', of='datasets')
def validate(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar='PATH...', help='KITTI folders, folders of several, or bags'),
    ],
    out: Annotated[Optional[Path], out_option('With --all: folder of findings as JSON')] = None,
    overwrite: AllOverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Check every file of KITTI folders and bags.

    All drives, sequences and splits at PATH are checked. Errors (exit code 1) are wrong or
    unreadable data, warnings suspicious or missing data. Findings have file, line and remedy. With
    --all: each recording and bag is checked on its own, to OUT/NAME.json, on several processes.

    Examples:
      kitti-ros2 validate object
      kitti-ros2 validate 2011_09_26 drive_0005.mcap --json
    """
    from ..result_output import ResultOutput
    from ..validate import run_validate

    return run_validate(paths, chosen(given), ResultOutput(out, overwrite, json, quiet))
