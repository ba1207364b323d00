# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval detection."""

from pathlib import Path
from typing import Annotated, Optional

from .declared import JsonOption, OverwriteOption, QuietOption, argument, chosen, out_option, takes


@takes('DETECTION_ALL', of='evaluation')
def eval_detection(
    ground_truth: Annotated[
        Path, argument('GROUND_TRUTH', 'label_2, an object split, or a recording with labels')
    ],
    results: Annotated[
        Path, argument('RESULTS', 'Folder of result files, 000000.txt ..., or a bag')
    ],
    out: Annotated[
        Optional[Path],
        out_option(
            'Curves to draw (.png, .pdf, .svg), or with --worst a folder for pictures; with'
            ' --all a folder of scores',
        ),
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score detections: average precision as KITTI's object benchmark.

    2D, orientation (AOS), bird's-eye view and 3D for easy, moderate and hard objects, exactly as
    the devkit computes them, at 40 (R40) and at 11 values of recall (R11). Frames without a result
    file are listed and not scored. With --all: each folder, file and bag of RESULTS to
    OUT/NAME.json, and a table.

    Examples:
      kitti-ros2 eval detection object results --frames val.txt --loose -o pr.png
      kitti-ros2 eval detection object results --worst 20 -o errors
    """
    from ..eval_detection import run_eval_detection
    from ..result_output import ResultOutput

    output = ResultOutput(out, overwrite, json, quiet)
    return run_eval_detection(ground_truth, results, chosen(given), output)
