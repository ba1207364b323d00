# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Score detections, tracks and trajectories as KITTI does.

Each name is imported when it is used first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.lazy_names import lazy_names

if TYPE_CHECKING:  # of what these modules hold, the names in __all__ are public
    from .bag_results import *
    from .detection import *
    from .live import *
    from .odometry import *
    from .tracking import *

_MODULES: dict[str, str] = {
    'BagResults': 'evaluation.bag_results',
    'DetectionScores': 'evaluation.detection',
    'Latency': 'evaluation.live',
    'LiveScores': 'evaluation.live',
    'OdometryScores': 'evaluation.odometry',
    'TrackingScores': 'evaluation.tracking',
    'WorstFrame': 'evaluation.detection',
    'evaluate_detection': 'evaluation.detection',
    'evaluate_live': 'evaluation.live',
    'evaluate_odometry': 'evaluation.odometry',
    'evaluate_tracking': 'evaluation.tracking',
    'read_bag_results': 'evaluation.bag_results',
    'worst_frames': 'evaluation.detection',
}

__all__ = [
    'BagResults',
    'DetectionScores',
    'Latency',
    'LiveScores',
    'OdometryScores',
    'TrackingScores',
    'WorstFrame',
    'evaluate_detection',
    'evaluate_live',
    'evaluate_odometry',
    'evaluate_tracking',
    'read_bag_results',
    'worst_frames',
]


if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(__name__, _MODULES)


def __dir__() -> list[str]:
    return __all__
