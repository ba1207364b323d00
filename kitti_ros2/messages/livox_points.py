# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CustomMsg of Livox' drivers -> points.

A point has x y z in metres, x forward, y left, z up, and reflectivity 0 to 255; 0 0 0 is no return.
Sources: livox_ros_driver/msg and livox_ros_driver2/msg, CustomMsg.msg and CustomPoint.msg.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .scan_points import ScanPoints, make_points

NO_RETURN = 'x y z 0 0 0, or not finite'
MISSING = 'points that point_num counts, and that the message does not have'


def decode_livox(
    message: Any,  # noqa: ANN401 - of the bag's types
    intensity_scale: float = 255.0,
) -> ScanPoints:
    """Decode a message; points that it declares and does not have are lost."""
    values = np.array(
        [(each.x, each.y, each.z, each.reflectivity) for each in message.points], dtype=np.float64
    ).reshape(-1, 4)
    xyz = values[:, :3]
    is_return = np.isfinite(xyz).all(axis=1) & xyz.any(axis=1)
    kept = values[is_return]
    points = make_points(kept[:, :3], kept[:, 3] / intensity_scale)
    missing = int(message.point_num) - len(values)
    lost = {MISSING: missing} if missing > 0 else {}
    return ScanPoints(points, {NO_RETURN: len(values) - len(kept)}, lost)
