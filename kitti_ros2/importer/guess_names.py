# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the names of topics and frames say."""

from __future__ import annotations

import re

from ..rig.heading import FIXED_FRAMES

_FIXED = frozenset({*FIXED_FRAMES, 'enu', 'utm', 'local', 'local_origin'})
_TRUTH = re.compile(r'ground_truth|groundtruth|\bgt\b', re.IGNORECASE)


def is_truth(topic: str) -> bool:
    """Whether a topic is called ground truth."""
    return bool(_TRUTH.search(topic))


def is_fixed(frame: str) -> bool:
    """Whether a frame is called as those in which robots move."""
    return frame.rpartition('/')[2].lower() in _FIXED
