# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Nominal mounts of the sensors on KITTI's car, to a centimetre, for a missing calibration.

Source: the calibration files of 2011-09-26 and the sensor setup on KITTI's web page.
"""

from __future__ import annotations

import numpy as np

from .geometry import Transform

NOMINAL_VELO_T_IMU = Transform.from_translation((-0.81, 0.32, -0.80))
"""imu_link in velo_link."""

NOMINAL_CAM0_T_VELO = Transform(
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.0, -0.08, -0.27])
)
"""velo_link in camera 0."""

NOMINAL_CAM0_X_M = {0: 0.0, 1: 0.54, 2: -0.06, 3: 0.47}
"""Metres from camera 0 to the right, by camera index."""
