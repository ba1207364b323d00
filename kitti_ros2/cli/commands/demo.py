# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command demo."""

from pathlib import Path
from typing import Annotated

import typer

from ...model.layouts import Layout
from .declared import OverwriteOption, QuietOption, argument, choice


def demo(
    out: Annotated[
        Path,
        argument('OUT', 'Folder for the recording and its bag [default: kitti_ros2_demo]'),
    ] = Path('kitti_ros2_demo'),
    layout: Annotated[
        str, choice([each.value for each in Layout], 'Layout of the recording')
    ] = 'raw',
    frames: Annotated[int, typer.Option(metavar='N', help='Number of frames')] = 20,
    seed: Annotated[
        int,
        typer.Option(metavar='N', help='Seed of the street; the same seed gives the same bytes'),
    ] = 0,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> int:
    """Write a synthetic recording, convert it, and summarize it.

    Examples:
      kitti-ros2 demo
      kitti-ros2 demo street --layout tracking --frames 100
    """
    from ..demo import run_demo

    return run_demo(out, layout, frames, seed, overwrite=overwrite, quiet=quiet)
