# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command report."""

from pathlib import Path
from typing import Annotated

import typer

from .shared import LayoutOption, QuietOption, SequenceOption


def report(
    src: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    out: Annotated[Path, typer.Option('--out', '-o', help='The page to make.')] = Path(
        'report.html'
    ),
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing page.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write a page that tells a KITTI folder or a bag: one HTML file, nothing else needed.

    Findings, frames in pictures, streams with gaps and jitter, route, objects, calibration.
    """
    from ..report import run_report

    given = {'layout': layout, 'sequence': sequence}
    return run_report(src, out, given, overwrite=overwrite, quiet=quiet)
