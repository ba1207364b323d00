# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms and rotations.

``a_T_b`` maps coordinates in frame b to coordinates in frame a, so neighbouring names touch when
transforms are composed: ``a_T_c = a_T_b @ b_T_c``. It is also the pose of frame b in frame a.
Quaternions are (x, y, z, w), w >= 0. Metres and radians throughout.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Iterable


Float64Array: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Transform:
    """A rigid transform a_T_b.

    Files may hold any numbers: products of those near the ends of float64 are infinite or NaN.

    Attributes:
        rotation: (3, 3) float64, columns are b's axes in a.
        translation: (3,) float64, b's origin in a, metres.
    """

    rotation: Float64Array
    translation: Float64Array

    def __post_init__(self) -> None:
        if self.rotation.shape != (3, 3) or self.translation.shape != (3,):
            raise ValueError(
                f'a Transform takes shapes (3, 3) and (3,), not {self.rotation.shape}'
                f' and {self.translation.shape}'
            )

    @classmethod
    def identity(cls) -> Transform:
        """Return the identity."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Transform:
        """Build from a (3, 4) or (4, 4) matrix [R | t]."""
        values = np.asarray(matrix, dtype=np.float64)
        return cls(values[:3, :3].copy(), values[:3, 3].copy())

    @classmethod
    def from_quaternion(cls, xyzw: Iterable[float], translation: npt.ArrayLike) -> Transform:
        """Build from a unit quaternion (x, y, z, w) and a translation."""
        return cls(quaternion_to_rotation(xyzw), np.asarray(translation, dtype=np.float64))

    @classmethod
    def from_translation(cls, xyz: npt.ArrayLike) -> Transform:
        """Return a pure translation."""
        return cls(np.eye(3), np.asarray(xyz, dtype=np.float64))

    def __matmul__(self, other: Transform) -> Transform:
        with _any_numbers():
            return Transform(
                self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
            )

    def inverse(self) -> Transform:
        """Return b_T_a."""
        with _any_numbers():
            return Transform(self.rotation.T.copy(), -self.rotation.T @ self.translation)

    def apply(self, points: npt.ArrayLike) -> Float64Array:
        """Map (N, 3) points given in b to a."""
        values = np.asarray(points, np.float64)
        with _any_numbers():
            mapped: Float64Array = values @ self.rotation.T + self.translation
        return mapped

    def matrix(self) -> Float64Array:
        """Return the (4, 4) homogeneous matrix."""
        homogeneous = np.eye(4)
        homogeneous[:3, :3] = self.rotation
        homogeneous[:3, 3] = self.translation
        return homogeneous

    def quaternion(self) -> Float64Array:
        """Return the rotation as (x, y, z, w)."""
        return rotation_to_quaternion(self.rotation)


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Float64Array:
    """Return Rz(yaw) @ Ry(pitch) @ Rx(roll), the order of the KITTI devkit's convertOxtsToPose."""
    cr, sr = np.cos(roll), np.sin(roll)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_to_rpy(rotation: Float64Array) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw); the inverse of rotation_from_rpy for |pitch| < pi/2."""
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    return float(roll), float(pitch), float(yaw)


def quaternion_to_rotation(xyzw: Iterable[float]) -> Float64Array:
    """Return the (3, 3) rotation of a quaternion (x, y, z, w), which is normalised first.

    NaN if that is impossible: for zeros, NaN, and numbers whose squares overflow float64.
    """
    # For four numbers NumPy takes five times as long.
    x, y, z, w = (float(component) for component in xyzw)
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not 0 < norm < math.inf:
        return np.full((3, 3), np.nan)
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_to_quaternion(rotation: Float64Array) -> Float64Array:
    """Return the unit quaternion (x, y, z, w), w >= 0, of a rotation matrix.

    Takes the largest of the four components first (Shepperd 1978), so no rotation is near a zero
    division; a matrix rounded to seven digits, as KITTI's are, gives a quaternion of norm 1.
    """
    m = rotation
    squares = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    largest = int(np.argmax(squares))
    rows = (
        (squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]),
        (m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]),
        (m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1]),
        (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]),
    )
    quaternion = np.array(rows[largest])
    quaternion /= np.linalg.norm(quaternion)
    return -quaternion if quaternion[3] < 0 else quaternion


def cut_polygon_by(corners: Float64Array, inside: Float64Array) -> Float64Array:
    """Clip a convex polygon by a line, by Sutherland and Hodgman (1974).

    Args:
        corners: (V, 2), in order.
        inside: (V,) values of a linear function at the corners; the part where it is >= 0 is kept.
    """
    # np.roll takes five times as long.
    following, later = (np.concatenate([column[1:], column[:1]]) for column in (corners, inside))
    crossing = (inside >= 0) != (later >= 0)
    share = inside / np.where(crossing, inside - later, 1.0)
    cut = corners + share[:, None] * (following - corners)
    both = np.stack([corners, cut], axis=1).reshape(-1, 2)
    polygon: Float64Array = both[np.stack([inside >= 0, crossing], axis=1).ravel()]
    return polygon


def _any_numbers() -> np.errstate:
    return np.errstate(over='ignore', invalid='ignore')


# Nominal mounts of the sensors on KITTI's car, to a centimetre, for a missing calibration.
#
# Source: the calibration files of 2011-09-26 and the sensor setup on KITTI's web page.

NOMINAL_VELO_T_IMU = Transform.from_translation((-0.81, 0.32, -0.80))
"""imu_link in velo_link."""

NOMINAL_CAM0_T_VELO = Transform(
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.array([0.0, -0.08, -0.27])
)
"""velo_link in camera 0."""

NOMINAL_CAM_T_VELO_360 = {
    0: Transform(NOMINAL_CAM0_T_VELO.rotation, np.array([0.30, -0.18, -0.80])),
    2: Transform(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.05, 0.23, -0.45])),
    3: Transform(np.array([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]]), np.array([-0.07, 0.24, -0.45])),
}
"""velo_link in the cameras of KITTI-360: camera 0, the fisheyes to the left and to the right."""

NOMINAL_CAM0_X_M = {0: 0.0, 1: 0.54, 2: -0.06, 3: 0.47}
"""Metres from camera 0 to the right, by camera index."""
