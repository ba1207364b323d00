# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command demo."""

from pathlib import Path
from typing import Annotated

import typer

from ...model.layouts import LAYOUT_NAMES
from .declared import QuietOption


def demo(
    out: Annotated[Path, typer.Argument(help='Folder for the recording and its bag.')] = Path(
        'kitti_ros2_demo'
    ),
    layout: Annotated[str, typer.Option(help=LAYOUT_NAMES)] = 'raw',
    frames: Annotated[int, typer.Option(help='Number of frames.')] = 20,
    seed: Annotated[
        int, typer.Option(help='Seed of the street; the same seed gives the same bytes.')
    ] = 0,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing demo.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write a synthetic KITTI recording, convert it to MCAP, and summarize it."""
    from ..demo import run_demo

    return run_demo(out, layout, frames, seed, overwrite=overwrite, quiet=quiet)
