# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Covariances of the GPS/IMU unit's messages: one standard deviation each, axes independent.

=====================  =============  ============================================================
part                   sigma          from
=====================  =============  ============================================================
position               pos_accuracy   the packet; 0 is declared unknown, as NavSatFix can
velocity               vel_accuracy   the packet; 0.1 m/s for 0, unknown, which a twist cannot
                                      declare: above the greatest of drives 0001 (0.013) and
                                      0005 (0.078)
orientation            0.1 degrees    A. Geiger et al., "Vision meets Robotics: The KITTI
                                      Dataset", IJRR 2013, section 2: OXTS RT3003, 0.02 m / 0.1
                                      degrees; as OXTS's RT user manual 190731, page 16, for the
                                      heading of two antennas 2 m apart (0.2 degrees per metre)
angular velocity       0.01 deg/s     gtsam c24a2c9, line 2 of examples/Data/
                                      KittiEquivBiasedImu_metadata.txt, on KITTI's unit: 0.000175
                                      rad/s
acceleration           0.01 m/s^2     the same file and line
=====================  =============  ============================================================

KITTI's packets have no accuracy of orientation, rates and accelerations. robot_localization takes
a variance below 1e-9 for 1e-9 (src/ekf.cpp, Ekf::correct): with zeros its filter follows that
sensor alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .header import make_header, make_vector3
from .ros_types import Twist, TwistWithCovariance, TwistWithCovarianceStamped

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import OxtsPacket

ORIENTATION_SIGMA = float(np.radians(0.1))
ANGULAR_VELOCITY_SIGMA = float(np.radians(0.01))
ACCELERATION_SIGMA = 0.01
UNKNOWN_VELOCITY_SIGMA = 0.1


def diagonal(*sigmas: float) -> Float64Array:
    """Return the covariance of axes in threes, row by row: (9,) of one sigma, (36,) of two."""
    variances = np.repeat(np.square(sigmas), 3)
    return np.diag(variances).ravel()


def encode_velocity_with_covariance(
    packet: OxtsPacket, stamp_ns: int, frame_id: str
) -> TwistWithCovarianceStamped:
    """Make a TwistWithCovarianceStamped: the TwistStamped of the packet with its covariance."""
    linear = packet.vel_accuracy if packet.vel_accuracy > 0 else UNKNOWN_VELOCITY_SIGMA
    twist = Twist(
        linear=make_vector3(packet.body_velocity()),
        angular=make_vector3((packet.wx, packet.wy, packet.wz)),
    )
    return TwistWithCovarianceStamped(
        header=make_header(stamp_ns, frame_id),
        twist=TwistWithCovariance(twist, diagonal(linear, ANGULAR_VELOCITY_SIGMA)),
    )
