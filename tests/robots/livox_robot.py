# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot whose Livox scanner recorded the driver's own messages."""

from __future__ import annotations

import numpy as np
import robot_bags as bags

START_NS = 1_680_000_000_000_000_000
FRAMES = 5
NONE_AT = (3, 40)


def points(frame: int) -> np.ndarray:
    """(200, 4): x y z and reflectivity 0 to 255; two are no returns."""
    rng = np.random.default_rng(frame)
    found = rng.uniform([1, -20, -2, 0], [80, 20, 5, 255], (200, 4))
    found[:, 3] = np.round(found[:, 3])
    found[NONE_AT, :3] = 0
    return found.astype(np.float32)


def said(package: str, point_ns: int = 1, base_ns: int = 0) -> list[bags.Said]:
    """Messages.

    Args:
        package: livox_ros_driver or livox_ros_driver2.
        point_ns: From a point to the next.
        base_ns: The timebase after the stamp.
    """
    return [
        bags.Said(
            '/livox/lidar',
            START_NS + 100_000_000 * frame,
            f'{package}/msg/CustomMsg',
            {
                'header': bags.header(START_NS + 100_000_000 * frame, 'livox_frame'),
                'timebase': START_NS + 100_000_000 * frame + base_ns,
                'point_num': 200,
                'points': [
                    {
                        'offset_time': n * point_ns,
                        'x': x,
                        'y': y,
                        'z': z,
                        'reflectivity': int(shine),
                        'line': 1,
                    }
                    for n, (x, y, z, shine) in enumerate(points(frame).tolist())
                ],
            },
        )
        for frame in range(FRAMES)
    ]


def imu(topic: str, number: int, up: float) -> bags.Said:
    """An Imu without an orientation, as Livox' drivers send it, at 100 Hz."""
    stamp_ns = START_NS + 10_000_000 * number
    frame = 'livox_frame' if 'livox' in topic else 'imu'
    values = {'header': bags.header(stamp_ns, frame), 'linear_acceleration': {'z': up}}
    return bags.Said(topic, stamp_ns, 'sensor_msgs/msg/Imu', values)
