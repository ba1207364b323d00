# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of the scanner, piecewise of constant twist.

In each piece the scanner drives along a screw, in a plane an arc, not along its chord (1 cm apart
at 15 m/s, 30 deg/s and 0.1 s).
A twist is a (4, 4) matrix [W v; 0 0] per second in the scanner's own axes, W the cross product of
the angular velocity, so that a_T_b = exp(twist * seconds).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, hypot, sin
from typing import TYPE_CHECKING

import numpy as np

from .stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .geometry import Float64Array, Transform
    from .samples import Int64Array

_LARGEST_ANGLE = 0.06
"""Most radians that a piece of the motion turns: 4 um error at 120 m with terms up to the third."""
_LONGEST_STEP_NS = 30_000_000
"""A changing rate of turn is taken as constant so long: 0.5 rad/s^2 are 7 mm off at 120 m."""
_CANCELLING = 0.01  # radians, below which a Taylor series is more precise than the closed form


@dataclass(frozen=True, eq=False)
class ScannerMotion:
    """The motion of the scanner around a turn.

    Attributes:
        stamps_ns: (K,) ascending moments at which the twist changes, at least one.
        twists: (K + 1, 4, 4) before, between and after them.
    """

    stamps_ns: Int64Array
    twists: Float64Array

    @classmethod
    def from_twists(cls, stamps_ns: Sequence[int], measured: Float64Array) -> ScannerMotion:
        """Return the motion of measured twists: linear between them, in steps, and constant beyond.

        Args:
            stamps_ns: K, ascending.
            measured: (K, 4, 4).
        """
        stamps, twists = [stamps_ns[0]], [measured[0]]
        for (first, last), (before, after) in zip(
            pairwise(stamps_ns), pairwise(measured), strict=True
        ):
            count = ceil((last - first) / _LONGEST_STEP_NS)
            for step in range(count):
                twists.append(before + (after - before) * ((step + 0.5) / count))
                stamps.append(first + (last - first) * (step + 1) // count)
        return cls(np.array(stamps, dtype=np.int64), np.stack([*twists, measured[-1]]))

    @classmethod
    def from_poses(
        cls, stamps_ns: Sequence[int], world_t_velo: Sequence[Transform]
    ) -> ScannerMotion:
        """Return the motion of poses: between two of them their step is the twist halfway.

        Args:
            stamps_ns: K, ascending, at least two.
            world_t_velo: K poses.
        """
        halfway = [first + (last - first) // 2 for first, last in pairwise(stamps_ns)]
        seconds = [(last - first) / NS_PER_S for first, last in pairwise(stamps_ns)]
        steps = [twist_of(a.inverse() @ b) for a, b in pairwise(world_t_velo)]
        twists = [step / duration for step, duration in zip(steps, seconds, strict=True)]
        return cls.from_twists(halfway, np.stack(twists))

    def relative(self, from_ns: int, to_ns: int) -> Float64Array:
        """Return from_T_to, (4, 4): maps coordinates at to_ns to those at from_ns."""
        return np.asarray(np.linalg.solve(self._pose(from_ns), self._pose(to_ns)), np.float64)

    def fastest(self) -> tuple[float, float]:
        """Return the highest speed, m/s, and angular speed, rad/s."""
        speed = np.linalg.norm(self.twists[:, :3, 3], axis=1).max()
        return float(speed), max(map(_angular_speed, self.twists))

    def pieces(self, start_ns: int, end_ns: int) -> Iterator[tuple[float, float, Float64Array]]:
        """Yield pieces of constant twist and a small angle: first and last, ns since start_ns."""
        inner = self.stamps_ns[(self.stamps_ns > start_ns) & (self.stamps_ns < end_ns)] - start_ns
        for first, last in pairwise([0, *inner.tolist(), end_ns - start_ns]):
            twist = self.twists[np.searchsorted(self.stamps_ns, start_ns + first, side='right')]
            angle = _angular_speed(twist) * (last - first) / NS_PER_S
            count = max(1, ceil(angle / _LARGEST_ANGLE))
            for low, high in pairwise(np.linspace(first, last, count + 1).tolist()):
                yield low, high, twist

    def _pose(self, stamp_ns: int) -> Float64Array:
        """Return the pose in that of the first moment."""
        place = int(np.searchsorted(self.stamps_ns, stamp_ns, side='right'))
        known = max(place - 1, 0)
        seconds = (stamp_ns - int(self.stamps_ns[known])) / NS_PER_S
        pose: Float64Array = self._known[known] @ exponential(self.twists[place] * seconds)
        return pose

    @cached_property
    def _known(self) -> list[Float64Array]:
        """The poses at stamps_ns."""
        poses = [np.eye(4)]
        seconds = np.diff(self.stamps_ns) / NS_PER_S
        for step in self.twists[1:-1] * seconds[:, None, None]:
            poses.append(poses[-1] @ exponential(step))
        return poses


def make_twist(velocity: Float64Array, angular_velocity: Float64Array) -> Float64Array:
    """Return the (4, 4) twist of a velocity in m/s and an angular velocity in rad/s."""
    x, y, z = angular_velocity
    twist = np.zeros((4, 4))
    twist[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    twist[:3, 3] = velocity
    return twist


def exponential(twist: Float64Array) -> Float64Array:
    """Return the (4, 4) transform of a twist that lasts one second."""
    square = twist @ twist
    second, third = _series(_angular_speed(twist))
    transform: Float64Array = np.eye(4) + twist + second * square + third * square @ twist
    return transform


def twist_of(a_t_b: Transform) -> Float64Array:
    """Return the (4, 4) twist that leads from a to b in one second; the inverse of exponential.

    Unique for rotations by less than half a turn.
    """
    x, y, z, w = a_t_b.quaternion()
    length = hypot(x, y, z)
    angle = 2 * atan2(length, w)
    axis = np.array([x, y, z]) * (angle / length if length > 0 else 2.0)
    twist = make_twist(np.zeros(3), axis)
    second, third = _series(angle)
    turning = twist[:3, :3]
    mean = np.eye(3) + second * turning + third * turning @ turning
    twist[:3, 3] = np.linalg.solve(mean, a_t_b.translation)
    return twist


def _series(angle: float) -> tuple[float, float]:
    """Return (1 - cos a) / a^2 and (a - sin a) / a^3."""
    square = angle**2
    if angle < _CANCELLING:
        return (1 - square / 12 + square**2 / 360) / 2, (1 - square / 20 + square**2 / 840) / 6
    return (1 - cos(angle)) / square, (angle - sin(angle)) / (angle * square)


def _angular_speed(twist: Float64Array) -> float:
    return hypot(twist[2, 1], twist[0, 2], twist[1, 0])
