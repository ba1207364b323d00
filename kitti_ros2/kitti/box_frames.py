# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of boxes between the frame of labels (rectified camera 0) and velo_link, both ways.

A label's yaw is about the camera's y axis, a tracklet's about the scanner's z axis. The heading is
carried over as a vector: where the two axes are parallel this is exact, and -(pi/2 + rotation_y)
up to the small angle between the sensors.
"""

from __future__ import annotations

from math import atan2, cos, sin
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array, Transform


def box_to_velo(
    location: npt.ArrayLike, rotation_y: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a label's location and rotation_y to bottom centre and yaw in velo_link."""
    velo_t_rect = rect_T_velo.inverse()
    heading = velo_t_rect.rotation @ np.array([cos(rotation_y), 0.0, -sin(rotation_y)])
    (centre,) = velo_t_rect.apply(np.reshape(location, (1, 3)))
    return centre, atan2(heading[1], heading[0])


def box_to_rect(
    centre: npt.ArrayLike, yaw: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a bottom centre and yaw in velo_link to a label's (location, rotation_y)."""
    heading = rect_T_velo.rotation @ np.array([cos(yaw), sin(yaw), 0.0])
    (location,) = rect_T_velo.apply(np.reshape(centre, (1, 3)))
    return location, atan2(-heading[2], heading[0])
