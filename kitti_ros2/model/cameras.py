# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The places of KITTI's rectified cameras relative to each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .geometry import Float64Array
    from .samples import CameraCalibration

LEFT_OF = {1: 0, 3: 2}
"""The left camera of each right camera's stereo pair."""


def rectified_offset(camera: CameraCalibration) -> Float64Array:
    """Return (3,) metres t = K^-1 P[:, 3]: p of the rectified camera 0 is p + t in this camera."""
    return np.asarray(np.linalg.solve(camera.p_rect[:, :3], camera.p_rect[:, 3]), np.float64)
