# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command info."""

from pathlib import Path
from typing import Annotated

import typer

from .declared import chosen, takes


@takes('SOURCE')
def info(
    path: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    json: Annotated[bool, typer.Option('--json', help='Print JSON.')] = False,
    **given: object,
) -> int:
    """Summarize a KITTI folder or a bag: streams, counts, rates, gaps, calibration."""
    from ..info import run_info

    return run_info(path, chosen(given), json=json)
