# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval odometry."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from .declared import JsonOption, QuietOption, argument, chosen, out_option, takes


@takes('ODOMETRY_ALL', of='evaluation')
def eval_odometry(
    ground_truth: Annotated[Path, argument('GT', 'A poses file, a sequence or drive, or a bag')],
    result: Annotated[Path, argument('RESULT', 'A poses file, a TUM file, or a bag')],
    out: Annotated[
        Optional[Path], out_option('Plot to draw (.png, .pdf, .svg); with --all a folder')
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing file at OUT')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score a trajectory: KITTI's segment errors, APE and RPE.

    Segments of 100 to 800 m as the odometry devkit computes them, in % and deg/m. Poses are
    converted to the rectified camera 0, and matched by frame number or by stamp. A poses file has
    12 numbers a line, or 13 with the frame number first. Frames without a pose are listed (exit
    code 1). With --all: each file and bag of RESULT to OUT/NAME.json, then all together.

    Examples:
      kitti-ros2 eval odometry poses/09.txt results/09.txt -o 09.png
      kitti-ros2 eval odometry odometry run.mcap --sequence 09 --topic /odom
    """
    from ..eval_odometry import run_eval_odometry
    from ..result_output import ResultOutput

    output = ResultOutput(out, overwrite, json, quiet)
    return run_eval_odometry(ground_truth, result, chosen(given), output)
