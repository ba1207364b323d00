# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command info."""

from pathlib import Path
from typing import Annotated

import typer

from .shared import LayoutOption, SequenceOption


def info(
    path: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    json: Annotated[bool, typer.Option('--json', help='Print JSON.')] = False,
) -> int:
    """Say what is in a KITTI folder or a bag: streams, counts, rates, gaps, calibration."""
    from ..info import run_info

    return run_info(path, layout, sequence, json=json)
