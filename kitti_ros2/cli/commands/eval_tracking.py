# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval tracking."""

from pathlib import Path
from typing import Annotated, Optional

from .declared import (
    AllOverwriteOption,
    JsonOption,
    QuietOption,
    argument,
    chosen,
    out_option,
    takes,
)


@takes('TRACKING_ALL', of='evaluation')
def eval_tracking(
    ground_truth: Annotated[Path, argument('GT', 'A tracking set with label_02, or label_02')],
    results: Annotated[Path, argument('RESULTS', 'A folder of files such as 0000.txt, or a bag')],
    out: Annotated[Optional[Path], out_option('With --all: folder of scores as JSON')] = None,
    overwrite: AllOverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score tracks: HOTA, CLEAR-MOT and IDF1 of cars and pedestrians.

    TrackEval computes the figures by the rules of KITTI's tracking benchmark, on 2D boxes. A bag
    has the results of one sequence, matched to its frames by stamp; detection ids, or namespaces
    and ids of markers, are the tracks. Sequences without results are listed (exit code 1). With
    --all: each file and bag of RESULTS to OUT/NAME.json, then all together.

    Examples:
      kitti-ros2 eval tracking tracking/training results/data
      kitti-ros2 eval tracking tracking run.mcap --sequence 0000 --class-map 1=Car
    """
    from ..eval_tracking import run_eval_tracking
    from ..result_output import ResultOutput

    output = ResultOutput(out, overwrite, json, quiet)
    return run_eval_tracking(ground_truth, results, chosen(given), output)
