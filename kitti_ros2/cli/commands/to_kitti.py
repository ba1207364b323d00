# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command to-kitti."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.streams import LAYOUT_NAMES
from .shared import QuietOption


def to_kitti(  # noqa: PLR0913, PLR0917 - each is an option of the command
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='BAG... OUT', help='Bags of one recording, then the folder to make.'
        ),
    ],
    layout: Annotated[
        Optional[str],
        typer.Option(help=f"{LAYOUT_NAMES} [default: a to-bag bag's own]"),
    ] = None,
    plan: Annotated[
        bool, typer.Option('--plan', help='Print which topic is which stream, and stop; no OUT.')
    ] = False,
    plan_file: Annotated[
        Optional[Path], typer.Option(help='Go by this plan, as --plan prints it.')
    ] = None,
    name: Annotated[
        Optional[str],
        typer.Option(help='2011_09_26_drive_0001_sync, training or testing, sequence 00 or 0000'),
    ] = None,
    calib: Annotated[
        Optional[Path], typer.Option(help="KITTI calibration instead of the bag's: file or folder")
    ] = None,
    split: Annotated[
        float, typer.Option(help='Object: the part of the frames in train, the rest in val.')
    ] = 1.0,
    append: Annotated[
        bool, typer.Option('--append', help='Object: continue the numbering of the set in OUT.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.

    A bag that to-bag made becomes the recording it was; any other goes by a plan.
    """
    from ..to_kitti import run_to_kitti

    given = {
        'layout': layout,
        'name': name,
        'calib': None if calib is None else str(calib),
        'train_fraction': split,
        'append': append,
    }
    return run_to_kitti(paths, given, plan_file, plan_only=plan, quiet=quiet)
