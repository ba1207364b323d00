# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Motion compensation: the points of a turn of the scanner, moved to one moment, and back.

The motion is piecewise of constant twist: in each piece the scanner drives along a screw, in a
plane an arc, not along its chord (1 cm apart at 15 m/s, 30 deg/s and 0.1 s).
A twist is a (4, 4) matrix [W v; 0 0] per second in the scanner's own axes, W the cross product of
the angular velocity, so that a_T_b = exp(twist * seconds).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, hypot, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .geometry import Float64Array, Transform
    from .samples import Float32Array, Int64Array, Turn

_LARGEST_ANGLE = 0.06
"""Most radians that a piece of the motion turns: 4 um error at 120 m with terms up to the third."""
_ORDER = 3
_LONGEST_STEP_NS = 30_000_000
"""A changing rate of turn is taken as constant so long: 0.5 rad/s^2 are 7 mm off at 120 m."""
_PRECISE = 1e-7  # of a turn: 10 ns, in which a car drives less than a micrometre
_MOST_STEPS = 30
_CANCELLING = 0.01  # radians, below which a Taylor series is more precise than the closed form


class Deskew(str, Enum):
    """What was done to the scans of a recording: compensated for motion, or that undone."""

    ON = 'on'
    UNDO = 'undo'

    @property
    def state(self) -> str:
        """What the scans are then, and the option that made them so."""
        if self is Deskew.ON:
            return 'compensated for motion (--deskew)'
        return 'as measured (--undo-deskew)'


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


def turned(points: Float32Array) -> Float64Array:
    """Return the part of its turn at which the scanner faces each point, (N,) float64, 0..1.

    The scanner turns clockwise seen from above, from straight behind (azimuth pi) over the left,
    front and right to straight behind (-pi): time decreases with azimuth. Points without an azimuth
    (NaN) have the time of straight ahead. Sources: see kitti/turns.py; KISS-ICP's kitti_raw loader
    and CT-ICP's reader do the same.

    Args:
        points: (N, 4), measured in velo_link at different moments (not compensated for motion).
    """
    return turned_to(np.arctan2(points[:, 1], points[:, 0]))


def turned_to(azimuth: Float32Array) -> Float64Array:
    """Return the part of its turn at which the scanner faces each azimuth, as turned."""
    parts = azimuth.astype(np.float64)
    parts[np.isnan(parts)] = 0.0
    parts /= 2 * np.pi
    clipped: Float64Array = np.clip(0.5 - parts, 0.0, 1.0)
    return clipped


def compensate(points: Float32Array, turn: Turn, motion: ScannerMotion, to_ns: int) -> Float32Array:
    """Return (N, 4) points as they would have been measured at one moment.

    Args:
        points: (N, 4) in velo_link, each measured when the scanner faced it.
        turn: The turn of the scanner.
        motion: The motion of the scanner; the surroundings are taken as static.
        to_ns: The moment, nanoseconds since 1970.
    """
    return _move(points, turned(points), turn, _terms(turn, motion, to_ns))


def undo_compensation(
    points: Float32Array, turn: Turn, motion: ScannerMotion, from_ns: int
) -> Float32Array:
    """Return (N, 4) points as they were measured: the inverse of compensate.

    The time of a point follows from where it was measured, and that from its time: both are found
    by a fixed point iteration. A step reduces the error by the factor (speed / distance + rate of
    turn) length / 2 pi: it converges for points that are further away than the scanner drives in a
    sixth of a turn, 0.25 m at 15 m/s. In a right-hand bend, directions straight behind are seen
    twice, at the start and at the end: such a point may belong to either, and is taken as measured
    on the side that it is on.

    Args:
        points: (N, 4) in velo_link at from_ns.
        turn: The turn of the scanner.
        motion: The motion of the scanner.
        from_ns: The moment that the points were moved to.
    """
    terms = _terms(turn, motion, from_ns, back=True)
    parts = turned(points)
    moving = np.arange(len(points))
    for _ in range(_MOST_STEPS):
        before = parts[moving]
        parts[moving] = turned(_move(points[moving], before, turn, terms, axes=2))
        moving = moving[np.abs(parts[moving] - before) > _PRECISE]
        if not len(moving):
            break
    return _move(points, parts, turn, terms)


def move_rigidly(points: Float32Array, a_t_b: Float64Array) -> Float32Array:
    """Return (N, 4) points of one moment, moved by a (4, 4) transform."""
    moved: Float32Array = points.copy()
    place = _columns(points)
    with np.errstate(invalid='ignore'):
        for axis, factors in enumerate((a_t_b - np.eye(4))[:3].tolist()):
            moved[:, axis] += _affine(factors, place)
    return moved


class _Terms(NamedTuple):
    """The displacement of points in a part of the turn, a polynomial of time.

    Attributes:
        first, last: The part of the turn, 0..1.
        factors: By axis and power of the seconds since the middle of the part: those of x, y, z, 1.
    """

    first: float
    last: float
    factors: list[list[list[float]]]


def _terms(
    turn: Turn, motion: ScannerMotion, moment_ns: int, *, back: bool = False
) -> list[_Terms]:
    """Return the displacements from the time of measurement to a moment, or back."""
    found = []
    for low, high, twist in motion.pieces(turn.start_ns, turn.end_ns):
        powers = [np.eye(4)]
        for order in range(1, _ORDER + 1):
            powers.append(powers[-1] @ (-twist if back else twist) / order)
        middle_ns = turn.start_ns + round((low + high) / 2)
        if back:
            middle_t_moment = motion.relative(middle_ns, moment_ns)
            moved = [power @ middle_t_moment for power in powers]
        else:
            moment_t_middle = motion.relative(moment_ns, middle_ns)
            moved = [moment_t_middle @ power for power in powers]
        moved[0] = moved[0] - np.eye(4)
        factors = np.stack(moved, axis=1)[:3].tolist()
        found.append(_Terms(low / turn.length_ns, high / turn.length_ns, factors))
    return found


def _move(
    points: Float32Array,
    parts: Float64Array,
    turn: Turn,
    pieces: Sequence[_Terms],
    *,
    axes: int = 3,
) -> Float32Array:
    """Return the points displaced along the first axes, each by its part of the turn."""
    moved: Float32Array = points.copy()
    columns = _columns(points)
    with np.errstate(invalid='ignore'):
        for first, last, factors in pieces:
            chosen = np.flatnonzero((parts >= first) & (parts <= last))
            since_middle = (parts[chosen] - (first + last) / 2) * (turn.length_ns / NS_PER_S)
            seconds = since_middle.astype(np.float32)
            place = [column[chosen] for column in columns]
            for axis in range(axes):
                moved[chosen, axis] = place[axis] + _polynomial(factors[axis], place, seconds)
    return moved


def _polynomial(
    factors: list[list[float]], place: Sequence[Float32Array], seconds: Float32Array
) -> Float32Array:
    total = _affine(factors[-1], place)
    for each in factors[-2::-1]:
        total *= seconds
        total += _affine(each, place)
    return total


def _affine(factors: list[float], place: Sequence[Float32Array]) -> Float32Array:
    x, y, z, one = factors
    total = place[0] * x
    total += place[1] * y
    total += place[2] * z
    total += one
    return total


def _columns(points: Float32Array) -> list[Float32Array]:
    return [np.ascontiguousarray(points[:, axis]) for axis in range(3)]
