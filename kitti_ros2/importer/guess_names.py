# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the name of a topic says of its content."""

from __future__ import annotations

import re

_TRUTH = re.compile(r'ground_truth|groundtruth|\bgt\b', re.IGNORECASE)


def is_truth(topic: str) -> bool:
    """Whether a topic is called ground truth."""
    return bool(_TRUTH.search(topic))
