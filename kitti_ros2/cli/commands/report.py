# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command report."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import OverwriteOption, QuietOption, argument, chosen, out_option, takes


@takes('REPORT_ALL')
def report(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    out: Annotated[Path, out_option('The page to write; with --all a folder of pages')] = Path(
        'report.html'
    ),
    results: Annotated[
        Optional[Path],
        typer.Option('--results', metavar='PATH', help='Result files of a detector, to score'),
    ] = None,
    show: Annotated[bool, typer.Option('--open', help='Open the page in the browser')] = False,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write an HTML report on a KITTI folder or a bag.

    One self-contained file: findings, frames in pictures, streams with gaps and jitter, route,
    objects, calibration. With --all: a page for each recording and bag below SRC, and an index.

    Examples:
      kitti-ros2 report 2011_09_26/2011_09_26_drive_0005_sync --open
      kitti-ros2 report drive_0005.mcap -o drive_0005.html
    """
    from ..report import run_report

    return run_report(
        src, out, chosen(given), results=results, overwrite=overwrite, show=show, quiet=quiet
    )
