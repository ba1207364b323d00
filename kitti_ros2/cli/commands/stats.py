# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command stats."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import JsonOption, QuietOption, argument, chosen, out_option, takes


@takes('STATS_ALL', of='datasets')
def stats(
    paths: Annotated[list[Path], argument('PATH...', 'Folders or bags; several are compared')],
    out: Annotated[
        Optional[Path], out_option('Picture to draw (.png, .pdf, .svg); a folder with --all')
    ] = None,
    csv: Annotated[
        Optional[Path], typer.Option('--csv', metavar='FILE', help='Table to write, all figures')
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace existing files at OUT and FILE')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Count what is in data sets: objects, sensors, routes.

    Classes with difficulty, occlusion, truncation, distance, size, points and tracks; length, speed
    and turn rate of routes; points by SemanticKITTI's class. A folder may hold any number of drives
    and sequences; several folders or bags are compared. With --all: each recording and bag to
    OUT/NAME.json on several processes, then all together, and as a table OUT/statistics.csv.

    Examples:
      kitti-ros2 stats object/training --points -o stats.png
      kitti-ros2 stats 2011_09_26 tracking --csv stats.csv
    """
    from ..result_output import ResultOutput
    from ..stats import run_stats

    output = ResultOutput(out, overwrite, json, quiet)
    return run_stats(paths, chosen(given), output, table=csv)
