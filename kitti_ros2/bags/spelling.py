# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of types as ROS 2 spells them."""

from __future__ import annotations

from functools import lru_cache

from rosbags.typesys.msg import normalize_msgtype


@lru_cache(1024)  # its paths take longer than the rest of a channel, which shares the string
def ros2_spelling(name: str) -> str:
    """Return the name of a type as ROS 2 spells it: sensor_msgs/msg/Imu for sensor_msgs/Imu."""
    return normalize_msgtype(name)
