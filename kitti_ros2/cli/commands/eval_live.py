# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval live."""

from pathlib import Path
from typing import Annotated

from .declared import JsonOption, QuietOption, argument, chosen, takes


@takes('LIVE', of='evaluation')
def eval_live(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or a bag, with ground truth')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Play to a running stack, score its results, measure its latency.

    SRC is played lossless, with /clock: a frame is sent when the one before is answered. The node
    is started, its results are recorded, and it is stopped at the end. Boxes are scored as eval
    detection does, poses as eval odometry does. Latency is the time from publishing a scan to
    receiving the result with its stamp.

    Examples:
      kitti-ros2 eval live tracking --node 'python detector.py' --topic /boxes
      kitti-ros2 eval live drive_0005.mcap --node ./slam.sh --topic /odom --json
    """
    from ..eval_live import run_eval_live

    return run_eval_live(src, chosen(given), json=json, quiet=quiet)
