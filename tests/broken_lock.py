# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A lock that an interruption breaks."""

import threading


def break_a_lock(lock, error):
    """Raise an error as threading.Condition.wait does while it has released its lock."""
    condition = threading.Condition(lock())
    with condition:
        condition.release()
        raise error
