# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command report."""

from pathlib import Path
from typing import Annotated

import typer

from .declared import QuietOption, chosen, takes


@takes('SOURCE')
def report(
    src: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    out: Annotated[Path, typer.Option('--out', '-o', help='The page to write.')] = Path(
        'report.html'
    ),
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing page.')
    ] = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write a report on a KITTI folder or a bag: one self-contained HTML file.

    Findings, frames in pictures, streams with gaps and jitter, route, objects, calibration.
    """
    from ..report import run_report

    return run_report(src, out, chosen(given), overwrite=overwrite, quiet=quiet)
