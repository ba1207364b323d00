# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic car: four cameras, a scanner and a GPS/IMU unit, mounted as on KITTI's car.

The numbers are invented, of KITTI's magnitude. The scanner is exactly upright on the car, and the
rectified cameras' y axis is exactly parallel to the scanner's z: so upright boxes are exact as
labels (yaw about the camera's y) and as tracklets (yaw about the scanner's z). The unrectified
camera 0 and the unit are tilted, so no part of the chain is an identity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform, rotation_from_rpy
from ..model.samples import Calibration, CameraCalibration
from .options import FULL_SIZE

if TYPE_CHECKING:
    from ..model.geometry import Float64Array

SCANNER_HEIGHT = 1.73
"""Height of the scanner above the ground, metres."""

CAR_T_VELO = Transform.from_translation((0.76, 0.0, SCANNER_HEIGHT))
"""velo_link in the car: on the ground below the middle of the rear axle, x forward, z up."""

_FOCAL = 719.25
_CENTRE = (611.4375, 174.1875)
_OFFSETS = (
    (0.0, 0.0, 0.0),
    (-0.5372, 0.0, 0.0),
    (0.0604, -0.00036, 0.00268),
    (-0.4721, 0.00241, 0.00275),
)
"""Minus the position of each camera's centre in the rectified camera 0, metres."""

_RAW_FOCALS = ((981.5, 978.25), (986.75, 985.0), (961.25, 958.5), (905.5, 903.75))
_RAW_CENTRES = ((691.5, 235.25), (700.25, 246.5), (694.75, 223.5), (696.5, 225.75))
_DISTORTIONS = (
    (-0.3712, 0.2011, 0.0021, 0.0013, -0.0703),
    (-0.3651, 0.1803, 0.0012, -0.0006, -0.0542),
    (-0.3684, 0.1952, 0.0013, 0.0005, -0.0661),
    (-0.3627, 0.1795, 0.0007, -0.0004, -0.0553),
)
_RAW_TILTS = (
    (0.0, 0.0, 0.0),
    (0.0081, -0.0305, -0.0192),
    (0.0033, -0.0044, 0.0051),
    (0.0019, -0.0247, -0.0166),
)
_RECTIFYING_RPY = (0.0043, -0.0079, -0.0096)
_SCANNER_YAW_IN_CAMERA = 0.0067
_CAMERA_FROM_SCANNER_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_CAM0_P_VELO = (-0.0052, -0.0747, -0.2751)
_UNIT_RPY = (-0.0139, -0.0023, 0.0011)
_VELO_P_UNIT = (-0.8104, 0.3203, -0.8012)


def make_calibration(image_size: tuple[int, int] = FULL_SIZE) -> Calibration:
    """Return the rig, its numbers rounded to the seven digits of KITTI's files."""
    r0_rect = _rounded(rotation_from_rpy(*_RECTIFYING_RPY))
    rect_r_velo = _CAMERA_FROM_SCANNER_AXES @ rotation_from_rpy(0.0, 0.0, _SCANNER_YAW_IN_CAMERA)
    return Calibration(
        cameras={index: _camera(index, image_size, r0_rect) for index in range(len(_OFFSETS))},
        r0_rect=r0_rect,
        cam0_T_velo=Transform(_rounded(r0_rect.T @ rect_r_velo), np.array(_CAM0_P_VELO)),
        velo_T_imu=Transform(_rounded(rotation_from_rpy(*_UNIT_RPY)), np.array(_VELO_P_UNIT)),
    )


def _camera(index: int, image_size: tuple[int, int], r0_rect: Float64Array) -> CameraCalibration:
    scale = np.array(image_size) / np.array(FULL_SIZE)
    # Pixel (0, 0) is the first pixel's centre, half a pixel from the image's corner.
    (cx, cy) = (np.array(_CENTRE) + 0.5) * scale - 0.5
    k_rect = np.array([[_FOCAL * scale[0], 0, cx], [0, _FOCAL * scale[1], cy], [0, 0, 1]])
    offset = np.array(_OFFSETS[index])
    cam_r_cam0 = rotation_from_rpy(*_RAW_TILTS[index])
    r_rect = r0_rect @ cam_r_cam0.T
    (fx, fy), (raw_cx, raw_cy) = _RAW_FOCALS[index], _RAW_CENTRES[index]
    return CameraCalibration(
        p_rect=_rounded(np.column_stack([k_rect, k_rect @ offset])),
        size=image_size,
        k=np.array([[fx, 0, raw_cx], [0, fy, raw_cy], [0, 0, 1]]),
        d=np.array(_DISTORTIONS[index]),
        r_rect=_rounded(r_rect),
        cam_T_cam0=Transform(_rounded(cam_r_cam0), _rounded(r_rect.T @ offset)),
    )


def _rounded(values: Float64Array) -> Float64Array:
    return np.array([float(f'{value:.6e}') for value in values.ravel()]).reshape(values.shape)
