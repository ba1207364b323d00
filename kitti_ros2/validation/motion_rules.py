# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about motion: GPS/IMU packets against each other, and odometry's poses.

Limits, from raw 0001 and 0005, tracking 0000 (oxts) and odometry 00 (4541 poses): positions and
velocities differ by up to 0.93 m/s (the GPS is corrected now and then), yaw and its rate by 0.027
rad/s, vf and ve, vn by 0.003 m/s; the mean of az is 9.80 m/s^2, roll and pitch are below 0.05 rad;
poses are at most 1.34 m apart, and orthonormal to 2.4e-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.poses import MercatorWorld
from ..model.stamps import NS_PER_S
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from ..kitti.text_file import Lines
    from ..model.geometry import Float64Array
    from ..model.samples import OxtsPacket

_SPEED_OFF = (3.0, 0.3)  # m/s, and as a part of the speed
_YAW_OFF = 0.2
_FORWARD_OFF = 0.1
_GRAVITY, _GRAVITY_OFF = 9.81, 1.5
_STEEPEST_RAD = 0.5
_FASTEST = 100.0
_HARDEST = 60.0
_QUICKEST_TURN = 5.0
_LONGEST_STEP_S = 1.0
_FARTHEST_STEP_M = 5.0
_ORTHONORMAL = 1e-3


@dataclass(frozen=True, eq=False)
class PacketTrack:
    """The packets of a recording.

    Attributes:
        path: The folder, or the file of all packets.
        place: The file and line of the packet with a number.
        numbers, stamps_ns, packets: The valid ones, ascending.
    """

    path: Path
    place: Callable[[int], tuple[Path, int]]
    numbers: Sequence[int]
    stamps_ns: Sequence[int]
    packets: Sequence[OxtsPacket]

    def breach(self, index: int, text: str) -> Breach:
        """Return the breach of a packet."""
        path, line = self.place(self.numbers[index])
        return Breach(text, path, line)

    def column(self, name: str) -> Float64Array:
        """Return a column of all packets."""
        return np.array([getattr(each, name) for each in self.packets], np.float64)

    @cached_property
    def steps_s(self) -> Float64Array:
        """(N - 1,) seconds between packets; NaN for gaps, and stamps that do not ascend."""
        steps: Float64Array = np.diff(np.array(self.stamps_ns, np.int64)).astype(np.float64)
        steps /= NS_PER_S
        return np.where((steps > 0) & (steps <= _LONGEST_STEP_S), steps, np.nan)


def _find_position(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    world = MercatorWorld.at(track.packets[0])
    places = np.array([world.pose(each).translation[:2] for each in track.packets])
    measured = np.stack([track.column('ve'), track.column('vn')], axis=1)
    measured = (measured[1:] + measured[:-1]) / 2
    moved = np.diff(places, axis=0) / track.steps_s[:, None]
    speed = np.linalg.norm(measured, axis=1)
    off = np.linalg.norm(moved - measured, axis=1)
    low, share = _SPEED_OFF
    for index in np.flatnonzero(off > low + share * speed).tolist():
        text = f'the position moves at {np.linalg.norm(moved[index]):.1f} m/s'
        yield track.breach(index + 1, f'{text}, the velocity is {speed[index]:.1f} m/s')


def _find_yaw(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    turned = np.diff(np.unwrap(track.column('yaw'))) / track.steps_s
    rate = track.column('wu')
    rate = (rate[1:] + rate[:-1]) / 2
    for index in np.flatnonzero(np.abs(turned - rate) > _YAW_OFF).tolist():
        text = f'yaw turns at {turned[index]:.2f} rad/s, wu is {rate[index]:.2f} rad/s'
        yield track.breach(index + 1, text)


def _find_forward(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    yaw, east, north = (track.column(name) for name in ('yaw', 've', 'vn'))
    forward = east * np.cos(yaw) + north * np.sin(yaw)
    given = track.column('vf')
    for index in np.flatnonzero(np.abs(forward - given) > _FORWARD_OFF).tolist():
        text = f'vf is {given[index]:.2f} m/s; ve, vn and yaw make {forward[index]:.2f} m/s'
        yield track.breach(index, text)


def _find_gravity(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    mean = float(track.column('az').mean())
    if abs(mean - _GRAVITY) > _GRAVITY_OFF:
        yield Breach(f'the mean of az is {mean:.2f} m/s^2', track.path)


def _find_extremes(track: PacketTrack) -> Iterator[Breach]:
    limits = {
        **dict.fromkeys(('vn', 've', 'vf', 'vl', 'vu'), _FASTEST),
        **dict.fromkeys(('ax', 'ay', 'az'), _HARDEST),
        **dict.fromkeys(('wx', 'wy', 'wz'), _QUICKEST_TURN),
        **dict.fromkeys(('roll', 'pitch'), _STEEPEST_RAD),
    }
    for name, limit in limits.items() if track.packets else ():
        values = track.column(name)
        for index in np.flatnonzero(np.abs(values) > limit).tolist():
            text = f'{name} is {values[index]:g}; vehicles reach {limit:g}'
            yield track.breach(index, text)


@dataclass(frozen=True, eq=False)
class PosesFile:
    """A file of odometry's poses, line n for frame n."""

    path: Path
    lines: Lines[Float64Array]


def _find_invalid_poses(file: PosesFile) -> Iterator[Breach]:
    for error in file.lines.errors.values():
        yield breach_of(error, file.path)


def _find_bent_poses(file: PosesFile) -> Iterator[Breach]:
    for line, pose in file.lines.sound().items():
        rotation = pose[:, :3]
        off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if off > _ORTHONORMAL or np.linalg.det(rotation) < 0:
            yield Breach(f'the rotation is not orthonormal, by {off:.1g}', file.path, line + 1)


def _find_pose_jumps(file: PosesFile) -> Iterator[Breach]:
    poses = file.lines.sound()
    for line, pose in poses.items():
        if line - 1 in poses:
            moved = float(np.linalg.norm(pose[:, 3] - poses[line - 1][:, 3]))
            if moved > _FARTHEST_STEP_M:
                yield Breach(f'{moved:.1f} m from the pose above', file.path, line + 1)


_RECORDING = RuleScope.RECORDING
_WARNING = RuleSeverity.WARNING

OXTS_RULES: tuple[Rule[PacketTrack], ...] = (
    Rule(
        'oxts-position',
        _WARNING,
        _RECORDING,
        'Positions move as fast as the velocities say, to 3 m/s and 30 %',
        'the GPS jumped, or packets are missing or in another order',
        _find_position,
    ),
    Rule(
        'oxts-yaw',
        _WARNING,
        _RECORDING,
        'Yaw turns as fast as the gyroscope says, to 0.2 rad/s',
        'check the axes (east is 0, counter-clockwise) and the order of the packets',
        _find_yaw,
    ),
    Rule(
        'oxts-forward',
        _WARNING,
        _RECORDING,
        'vf is ve cos(yaw) + vn sin(yaw), to 0.1 m/s',
        'check the columns and axes of the packet',
        _find_forward,
    ),
    Rule(
        'oxts-gravity',
        _WARNING,
        _RECORDING,
        'az contains gravity: its mean is 9.81 m/s^2, to 1.5 m/s^2',
        'KITTI has accelerations with gravity; add it',
        _find_gravity,
    ),
    Rule(
        'oxts-extreme',
        _WARNING,
        _RECORDING,
        'Speeds are below 100 m/s, accelerations 60 m/s^2, rates 5 rad/s, roll and pitch 0.5 rad',
        'check the units: radians, metres and seconds',
        _find_extremes,
    ),
)
POSE_RULES: tuple[Rule[PosesFile], ...] = (
    Rule(
        'pose-line',
        RuleSeverity.ERROR,
        _RECORDING,
        'Lines of poses are twelve finite numbers',
        'correct the line, or copy the file again',
        _find_invalid_poses,
    ),
    Rule(
        'pose-rotation',
        RuleSeverity.ERROR,
        _RECORDING,
        'Rotations of poses are orthonormal to 1e-3',
        'write 3x4 matrices [R | t], row by row',
        _find_bent_poses,
    ),
    Rule(
        'pose-jump',
        _WARNING,
        _RECORDING,
        'Consecutive poses are less than 5 m apart',
        'lines are missing, or the trajectory jumps',
        _find_pose_jumps,
    ),
)
