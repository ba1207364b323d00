# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command stacks."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import JsonOption, OverwriteOption, QuietOption, chosen, takes


def _complete_stack(incomplete: str) -> list[str]:
    from ...stacks.stack_names import StackName

    return [each.value for each in StackName if each.value.startswith(incomplete)]


@takes('STACK_DRIVE')
def stacks(
    stack: Annotated[
        Optional[str],
        typer.Argument(
            metavar='STACK', help='One of the listed stacks', autocompletion=_complete_stack
        ),
    ] = None,
    drive: Annotated[
        Optional[Path],
        typer.Option(
            '--config', metavar='DRIVE', help='Write files to run STACK on a KITTI folder'
        ),
    ] = None,
    out: Annotated[
        Optional[Path],
        typer.Option('--out', '-o', metavar='DIR', help='Folder of these files [default: STACK]'),
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """List the stacks that --for knows, or show and set up one of them.

    With STACK: what it asks of messages, with the place in its source, the options, topics and
    frames that --for sets, and the commands to record, run and score it.

    With --config: its parameter file with the extrinsics of the drive, and a launch file that
    starts it and plays the drive.

    Examples:
      kitti-ros2 stacks kiss-icp
      kitti-ros2 stacks dlio --config 2011_09_26/2011_09_26_drive_0005_sync -o run
    """
    from ..stacks import run_stacks

    return run_stacks(
        stack, drive, chosen(given), out=out, overwrite=overwrite, json=json, quiet=quiet
    )
