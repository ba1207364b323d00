# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The protocol of all readers, and what follows from it: times, motion of scans, route."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import pairwise
from math import atan2, ceil, cos, hypot, sin
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .streams import NS_PER_S, Stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from .errors import Loss
    from .geometry import Float64Array, Transform
    from .samples import (
        Calibration,
        Description,
        Float32Array,
        Int64Array,
        Pose,
        Sample,
        Trajectory,
        Turn,
    )
    from .streams import Clock, Layout


# The protocol of the readers of all layouts, and its parts.


@dataclass(frozen=True, eq=False)
class Start:
    """The first readable pose of a recording; it defines the origin of map.

    Attributes:
        world_T_imu: The pose, in the reader's fixed frame.
        level: Whether the axes of that frame are east, north and up; False if the layout has no
            direction of gravity (odometry).
    """

    world_T_imu: Transform
    level: bool


@dataclass(frozen=True, eq=False)
class StreamIndex:
    """The samples of a stream: file numbers, ascending, and their stamps, of the same length."""

    numbers: Int64Array
    stamps_ns: Int64Array

    def __len__(self) -> int:
        return len(self.numbers)


BY_POSITION = 'frames of this bag are numbered by position, from 0'
"""The note on a bag that was not written by to-bag."""


@dataclass(frozen=True)
class FrameOrigin:
    """The frame of a raw drive that a frame of an object set was taken from.

    Attributes:
        drive: The drive, such as 2011_09_26_drive_0005_sync.
        number: Its file number in the drive.
        stamp_ns: Its stamp in the drive, nanoseconds since 1970 UTC: of the scan, or of image_2 in
            a drive without stamps of scans.
    """

    drive: str
    number: int
    stamp_ns: int


class MovingRecording(Protocol):
    """The part of a recording that the motion of its scans is made of.

    Attributes:
        layout: Its layout.
        name: The drive, sequence or split.
        deskew: Treatment of its scans; None: they are those of the files.
    """

    layout: Layout
    name: str
    deskew: Deskew | None

    @property
    def streams(self) -> Mapping[Stream, StreamIndex]:
        """Index by stream; a stream without samples is absent."""
        ...

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps, and length of a turn that is not known."""
        ...

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number.

        Raises:
            BadFileError: The file is truncated, invalid, or contradicts the others.
            OSError: The file cannot be read.
        """
        ...

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame; absent parts are listed in its missing."""
        ...

    def readable_poses(
        self, numbers: Iterable[int], needed_for: Stream
    ) -> Iterator[tuple[int, Pose]]:
        """Yield the poses of these numbers; unreadable ones become losses of a stream."""
        ...


class ReadableRecording(MovingRecording, Protocol):
    """A KITTI recording open for reading: an index in memory, samples read one by one on demand.

    Attributes:
        root: The folder that the names of its text files are relative to.
        image_topic: image_rect, or image_raw for images that are not rectified.
        common_numbers: Whether the same number is the same time in all streams.
        clock: The meaning of its stamps.
    """

    root: Path

    @property
    def cameras(self) -> Mapping[int, str]:
        """Camera index to the name in its topics and frames, such as color_left."""
        ...

    image_topic: str
    common_numbers: bool
    clock: Clock

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number; scans compensated for motion have none."""
        ...

    @property
    def origins(self) -> Mapping[int, FrameOrigin]:
        """By file number the raw drive's frame of a set in real time; else empty."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """Missing or unusable data found by listing."""
        ...

    @property
    def late_losses(self) -> Sequence[Loss]:
        """Losses so far of passes over many samples (path, trails, origin of the map).

        They are reported nowhere else: the sample itself may be left out, or be read later.
        """
        ...

    @property
    def notes(self) -> Sequence[str]:
        """Notes, such as on an absent stream."""
        ...

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        ...

    def describe(self) -> Description:
        """Describe the recording as a whole."""
        ...

    def trails(self, number: int) -> Mapping[int, Float64Array]:
        """Map the track ids of a frame to their centres up to it, (N, 3) metres in the world.

        Tracks that the frame does not have are left out; without poses there are none.
        """
        ...

    @property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording, None without one."""
        ...

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """Return the poses of these numbers without the unreadable ones."""
        ...


# The time of samples, with the whole turns of their scans.

MARGIN_NS = 100_000_000
"""Time before and after samples in which packets of an unsynchronised drive are taken, too.

LIO-SAM (src/imageProjection.cpp, deskewInfo) and FAST-LIO2 (src/laserMapping.cpp, sync_packages)
wait until the packets reach beyond both ends of a turn, which begins half a turn before its stamp.
"""

_HIGHEST = 10**10 - 1  # KITTI's names have ten digits


def time_span(
    streams: Mapping[Stream, StreamIndex],
    turns: Mapping[int, Turn],
    masks: Mapping[Stream, npt.NDArray[np.bool_]],
) -> tuple[int, int] | None:
    """Return the first and last time of samples and of the turns of scans; None without any.

    Args:
        streams: The samples of a recording.
        turns: The turn of each scan, by file number.
        masks: (N,) bool by stream: which samples count.
    """
    ends_ns: list[int] = []
    for stream, mask in masks.items():
        stamps_ns = streams[stream].stamps_ns[mask]
        if len(stamps_ns):
            ends_ns += [int(stamps_ns.min()), int(stamps_ns.max())]
        if stream is Stream.SCAN:
            ends_ns += turn_ends(streams[stream].numbers[mask].tolist(), turns)
    return (min(ends_ns), max(ends_ns)) if ends_ns else None


def turn_ends(numbers: Iterable[int], turns: Mapping[int, Turn]) -> list[int]:
    """Return start and end of the turns of scans, of those that have one."""
    scan_turns = [turns[number] for number in numbers if number in turns]
    return [end_ns for turn in scan_turns for end_ns in (turn.start_ns, turn.end_ns)]


def around(stamps_ns: Int64Array, span: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return (N,) bool: which stamps are within a span, or within the margin of its ends."""
    within: npt.NDArray[np.bool_] = (stamps_ns >= span[0] - MARGIN_NS) & (
        stamps_ns <= span[1] + MARGIN_NS
    )
    return within


def numbers_around(numbers: Int64Array, selected: Int64Array) -> tuple[int, int]:
    """Return the lowest and highest file number that may be of the time of some samples.

    Samples without a file or a stamp have no known time: those next to selected ones count.

    Args:
        numbers: (N,) of a stream.
        selected: (M,) of its samples in that time, M > 0.
    """
    first, last = int(selected.min()), int(selected.max())
    before, after = numbers[numbers < first], numbers[numbers > last]
    lowest = int(before.max()) + 1 if len(before) else 0
    return lowest, int(after.min()) - 1 if len(after) else _HIGHEST


# Motion compensation: the points of a turn of the scanner, moved to one time, and back.

_ORDER = 3  # of the terms in time; see _LARGEST_ANGLE
_PRECISE = 1e-7  # of a turn: 10 ns, in which a car drives less than a micrometre
_MOST_STEPS = 30


class Deskew(str, Enum):
    """The treatment of scans: compensated for motion, or that undone."""

    ON = 'on'
    UNDO = 'undo'

    @property
    def state(self) -> str:
        """The state of the scans, and the option that caused it."""
        if self is Deskew.ON:
            return 'compensated for motion (--deskew)'
        return 'as measured (--undo-deskew)'


def turned(points: Float32Array) -> Float64Array:
    """Return the part of its turn at which the scanner faces each point, (N,) float64, 0..1.

    The scanner turns clockwise seen from above, from straight behind (azimuth pi) over the left,
    front and right to straight behind (-pi): time decreases with azimuth. Points without an azimuth
    (NaN) have the time of straight ahead. Sources: see kitti/recording_index.py; KISS-ICP's
    kitti_raw loader and CT-ICP's reader do the same.

    Args:
        points: (N, 4), measured in velo_link at different times (not compensated for motion).
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
    """Return (N, 4) points as they would have been measured at one time.

    Args:
        points: (N, 4) in velo_link, each measured when the scanner faced it.
        turn: The turn of the scanner.
        motion: The motion of the scanner; the surroundings are taken as static.
        to_ns: The time, nanoseconds since 1970.
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
        from_ns: The time that the points were moved to.
    """
    terms = _terms(turn, motion, from_ns, back=True)
    parts = turned(points)
    unsettled = _settle(points, parts, turn, terms)
    # A step across straight behind leads to the other end of the turn: these begin at either end.
    for end in (0.0, 1.0):
        own = np.full(len(unsettled), end)
        still = _settle(points[unsettled], own, turn, terms, end)
        settled = np.setdiff1d(np.arange(len(unsettled)), still)
        parts[unsettled[settled]] = own[settled]
        unsettled = unsettled[still]
    return _move(points, parts, turn, terms)


def _settle(
    points: Float32Array,
    parts: Float64Array,
    turn: Turn,
    terms: Sequence[_Terms],
    end: float | None = None,
) -> npt.NDArray[np.intp]:
    """Iterate to the parts of the turn at which points were measured, in place.

    Args:
        points: (N, 4) of one time.
        parts: (N,) to begin with.
        turn: The turn of the scanner.
        terms: The displacements back to the time of measurement.
        end: The end of the turn, 0 or 1, that steps by more than half a turn lead back to.

    Returns:
        The indices of the points that did not settle.
    """
    moving = np.arange(len(points))
    for _ in range(_MOST_STEPS):
        before = parts[moving]
        after = turned(_move(points[moving], before, turn, terms, axes=2))
        settled = np.abs(after - before) <= _PRECISE
        parts[moving] = after if end is None else np.where(np.abs(after - end) > 0.5, end, after)
        moving = moving[~settled]
        if not len(moving):
            break
    return moving


def move_rigidly(points: Float32Array, a_t_b: Float64Array) -> Float32Array:
    """Return (N, 4) points of one time, moved by a (4, 4) transform."""
    moved: Float32Array = points.copy()
    columns = _columns(points)
    with np.errstate(invalid='ignore'):
        for axis, factors in enumerate((a_t_b - np.eye(4))[:3].tolist()):
            moved[:, axis] += _affine(factors, columns)
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
    turn: Turn, motion: ScannerMotion, target_ns: int, *, back: bool = False
) -> list[_Terms]:
    """Return the displacements from the time of measurement to another time, or back."""
    terms = []
    for low, high, twist in motion.intervals(turn.start_ns, turn.end_ns):
        powers = [np.eye(4)]
        for order in range(1, _ORDER + 1):
            powers.append(powers[-1] @ (-twist if back else twist) / order)
        middle_ns = turn.start_ns + round((low + high) / 2)
        if back:
            middle_t_target = motion.relative(middle_ns, target_ns)
            moved = [power @ middle_t_target for power in powers]
        else:
            target_t_middle = motion.relative(target_ns, middle_ns)
            moved = [target_t_middle @ power for power in powers]
        moved[0] = moved[0] - np.eye(4)
        factors = np.stack(moved, axis=1)[:3].tolist()
        terms.append(_Terms(low / turn.length_ns, high / turn.length_ns, factors))
    return terms


def _move(
    points: Float32Array,
    parts: Float64Array,
    turn: Turn,
    terms: Sequence[_Terms],
    *,
    axes: int = 3,
) -> Float32Array:
    """Return the points displaced along the first axes, each by its part of the turn."""
    moved: Float32Array = points.copy()
    columns = _columns(points)
    with np.errstate(invalid='ignore'):
        for first, last, factors in terms:
            indices = np.flatnonzero((parts >= first) & (parts <= last))
            since_middle = (parts[indices] - (first + last) / 2) * (turn.length_ns / NS_PER_S)
            seconds = since_middle.astype(np.float32)
            xyz = [column[indices] for column in columns]
            for axis in range(axes):
                moved[indices, axis] = xyz[axis] + _polynomial(factors[axis], xyz, seconds)
    return moved


def _polynomial(
    factors: list[list[float]], columns: Sequence[Float32Array], seconds: Float32Array
) -> Float32Array:
    total = _affine(factors[-1], columns)
    for factor in factors[-2::-1]:
        total *= seconds
        total += _affine(factor, columns)
    return total


def _affine(factors: list[float], columns: Sequence[Float32Array]) -> Float32Array:
    x, y, z, constant = factors
    total = columns[0] * x
    total += columns[1] * y
    total += columns[2] * z
    total += constant
    return total


def _columns(points: Float32Array) -> list[Float32Array]:
    return [np.ascontiguousarray(points[:, axis]) for axis in range(3)]


# The motion of the scanner, piecewise of constant twist.
#
# In each piece the scanner drives along a screw, in a plane an arc, not along its chord (1 cm apart
# at 15 m/s, 30 deg/s and 0.1 s).
# A twist is a (4, 4) matrix [W v; 0 0] per second in the scanner's own axes, W the cross product of
# the angular velocity, so that a_T_b = exp(twist * seconds).

_LARGEST_ANGLE = 0.06
"""Most radians that a piece of the motion turns: 4 um error at 120 m with terms up to the third."""
_LONGEST_STEP_NS = 30_000_000
"""A changing rate of turn is taken as constant so long: 0.5 rad/s^2 are 7 mm off at 120 m."""
_CANCELLING = 0.01  # radians, below which a Taylor series is more precise than the closed form


@dataclass(frozen=True, eq=False)
class ScannerMotion:
    """The motion of the scanner around a turn.

    Attributes:
        stamps_ns: (K,) ascending stamps at which the twist changes, at least one.
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

    def intervals(self, start_ns: int, end_ns: int) -> Iterator[tuple[float, float, Float64Array]]:
        """Yield pieces of constant twist and a small angle: first and last, ns since start_ns."""
        inner = self.stamps_ns[(self.stamps_ns > start_ns) & (self.stamps_ns < end_ns)] - start_ns
        for first, last in pairwise([0, *inner.tolist(), end_ns - start_ns]):
            twist = self.twists[np.searchsorted(self.stamps_ns, start_ns + first, side='right')]
            angle = _angular_speed(twist) * (last - first) / NS_PER_S
            count = max(1, ceil(angle / _LARGEST_ANGLE))
            for low, high in pairwise(np.linspace(first, last, count + 1).tolist()):
                yield low, high, twist

    def _pose(self, stamp_ns: int) -> Float64Array:
        """Return the pose in that of the first stamp."""
        after = int(np.searchsorted(self.stamps_ns, stamp_ns, side='right'))
        index = max(after - 1, 0)
        seconds = (stamp_ns - int(self.stamps_ns[index])) / NS_PER_S
        pose: Float64Array = self._poses[index] @ exponential(self.twists[after] * seconds)
        return pose

    @cached_property
    def _poses(self) -> list[Float64Array]:
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


# The route of the vehicle: positions, length, speed, yaw and turn rate.

_STEP_LIMIT_M_S = 100.0


@dataclass(frozen=True, eq=False)
class Route:
    """The route of the vehicle.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        positions: (N, 3) x y z in metres, in map.
        speeds_m_s: (N,) measured, else from positions; NaN where unknown.
        measured: Whether speeds are measured; those from positions need the true stamps.
        yaws_rad: (N,) from the x axis of map, counter-clockwise, continuous; NaN where unknown.
        turn_rates_rad_s: (N,) about the z axis of map, counter-clockwise, measured, else from yaws;
            NaN where unknown.
        jumps: Number of steps faster than 100 m/s; not part of the length.
        length_m: Length without jumps.
        ground_m: The same without heights.
        altitude_m: Altitude of z = 0 above sea level; None if unknown.
    """

    stamps_ns: Int64Array
    positions: Float64Array
    speeds_m_s: Float64Array
    measured: bool
    yaws_rad: Float64Array
    turn_rates_rad_s: Float64Array
    jumps: int
    length_m: float
    ground_m: float
    altitude_m: float | None = None

    @property
    def duration_s(self) -> float:
        """Seconds from the first position to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9

    @property
    def net_m(self) -> float:
        """Straight distance in metres from the first position to the last."""
        with np.errstate(over='ignore'):
            return float(np.linalg.norm(self.positions[-1] - self.positions[0]))


@np.errstate(over='ignore', invalid='ignore')  # poses may hold any numbers
def route_of(
    stamps_ns: Sequence[int], poses: Sequence[Pose], altitude_m: float | None = None
) -> Route | None:
    """Make the route through poses in map; None for less than two finite positions."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    transforms = [pose.world_T_imu for pose in poses]
    positions = np.array([transform.translation for transform in transforms], np.float64).reshape(
        -1, 3
    )
    good = np.isfinite(positions).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(stamps[good], kind='stable')]
    if len(order) < 2:
        return None
    stamps, positions = stamps[order], positions[order]
    rotations = np.array([transforms[index].rotation for index in order])
    offsets = np.diff(positions, axis=0)
    steps = np.linalg.norm(offsets, axis=1)
    jumps = steps > np.maximum(np.diff(stamps) / 1e9, 1e-3) * _STEP_LIMIT_M_S
    ordered = [poses[index] for index in order]
    speeds = np.linalg.norm([_rate_or_nan(pose.velocity) for pose in ordered], axis=1)
    measured = not np.isnan(speeds).all()
    if not measured:
        speeds = _derived(stamps, np.where(jumps, np.nan, steps))
    yaws = _continuous(np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]))
    rates = [_rate_or_nan(pose.angular_velocity) for pose in ordered]
    turn_rates = np.einsum('ij,ij->i', rotations[:, 2], np.array(rates))  # z of world_R_imu @ rate
    if np.isnan(turn_rates).all():
        turn_rates = _derived(stamps, np.where(jumps, np.nan, np.diff(yaws)))
    return Route(
        stamps,
        positions,
        speeds,
        measured,
        yaws,
        turn_rates,
        int(np.count_nonzero(jumps)),
        float(steps[~jumps].sum()),
        float(np.linalg.norm(offsets[~jumps, :2], axis=1).sum()),
        altitude_m,
    )


def _rate_or_nan(rate: Float64Array | None) -> Float64Array:
    """Return the (3,) velocity or angular velocity of a pose, NaN without one."""
    return np.full(3, np.nan) if rate is None else rate


def _derived(stamps_ns: Int64Array, steps: Float64Array) -> Float64Array:
    """Return the (N,) rates a second of steps between N stamps; the first is that of the second."""
    seconds = np.diff(stamps_ns) / 1e9
    rates = np.divide(steps, seconds, out=np.full(len(steps), np.nan), where=seconds > 0)
    return np.concatenate([rates[:1], rates])


def _continuous(angles_rad: Float64Array) -> Float64Array:
    """Add whole turns so that neighbours differ by half a turn at most."""
    finite = np.isfinite(angles_rad)
    angles_rad[finite] = np.unwrap(angles_rad[finite])
    return angles_rad
