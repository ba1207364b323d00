# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories with known errors, and the files and bags that hold them."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.camera_info import encode_static, make_transform
from kitti_ros2.messages.cdr import join, make_header, make_pose, make_vector3, serialize
from kitti_ros2.messages.ros_types import (
    TYPESTORE,
    Odometry,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Twist,
    TwistWithCovariance,
)
from kitti_ros2.messages.ros_types import Path as PathMessage
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.geometry import Transform
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import DEFAULT_EPOCH_NS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

CALIB = """P0: 7e+02 0 6e+02 0 0 7e+02 2e+02 0 0 0 1 0
Tr: 4.27e-04 -9.999672e-01 -8.08e-03 -1.2e-02 -7.21e-03 8.08e-03 -9.999413e-01 -5.4e-02 \
9.999738e-01 4.86e-04 -7.21e-03 -2.92e-01
"""
"""The calibration of a sequence."""


def turn_y(angles_rad):
    """(N, 3, 3) rotations about the y axis of a camera, which points down."""
    angles = np.asarray(angles_rad, np.float64)
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, 0, 0] = rotations[:, 2, 2] = np.cos(angles)
    rotations[:, 0, 2], rotations[:, 2, 0] = np.sin(angles), -np.sin(angles)
    rotations[:, 1, 1] = 1
    return rotations


def drive(frames: int, step_m: float = 0.9, bend: float = 1.0) -> np.ndarray:
    """(N, 4, 4) poses of camera 0 along streets with bends, hills and changing speed."""
    time = np.arange(frames)
    steps = step_m * (1 + 0.3 * np.sin(time / 70))
    headings = bend * (1.3 * np.sin(time / 140) + 0.8 * np.sin(time / 47))
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = turn_y(headings)
    ways = np.stack([np.sin(headings), 0.02 * np.sin(time / 90) * bend, np.cos(headings)], axis=1)
    poses[1:, :3, 3] = np.cumsum(ways * steps[:, None], axis=0)[:-1]
    return np.linalg.inv(poses[0]) @ poses


def distances(poses: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def drifted(poses: np.ndarray, share: float = 0.0, deg_per_m: float = 0.0) -> np.ndarray:
    """Poses that are pushed aside, and turned about the first y axis, in proportion to the way."""
    way = distances(poses)
    result = poses.copy()
    result[:, 0, 3] += share * way
    result[:, :3, :3] = turn_y(np.radians(deg_per_m) * way) @ poses[:, :3, :3]
    return result


def shaken(poses: np.ndarray, seed: int = 0) -> np.ndarray:
    """Poses with the errors of an odometry: each step is a little wrong."""
    rng = np.random.default_rng(seed)
    result = [poses[0]]
    for before, after in pairwise(poses):
        wrong = np.eye(4)
        wrong[:3, :3] = turn_y(rng.normal(2e-4, 1e-3, 1))[0]
        wrong[:3, 3] = rng.normal(0.004, 0.02, 3)
        result.append(result[-1] @ np.linalg.inv(before) @ after @ wrong)
    return np.array(result)


def write_poses(path: Path, poses: Iterable[np.ndarray], numbers: Sequence[int] | None = None):
    """A poses file, with frame numbers if they are given."""
    lines = [' '.join(f'{value:.9e}' for value in pose[:3].ravel()) for pose in poses]
    if numbers is not None:
        lines = [f'{number} {line}' for number, line in zip(numbers, lines, strict=True)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('\n'.join(lines) + '\n')
    return path


def write_tum(path: Path, stamps_s: Iterable[object], poses: Iterable[np.ndarray]):
    lines = ['# timestamp tx ty tz qx qy qz qw']
    for stamp, pose in zip(stamps_s, poses, strict=True):
        transform = Transform.from_matrix(pose)
        values = [*transform.translation, *transform.quaternion()]
        lines.append(' '.join([str(stamp), *(f'{value:.12g}' for value in values)]))
    path.write_text('\n'.join(lines) + '\n')
    return path


def offsets_ns(count: int) -> list[int]:
    """Stamps from the start of a sequence, a tenth of a second apart and a little uneven."""
    return [n * 103_600_000 + (n % 7) * 100_000 for n in range(count)]


def write_sequence(root: Path, poses: np.ndarray, name: str = '07') -> Path:
    """A sequence of odometry without images and scans: calibration, times and poses."""
    folder = root / 'sequences' / name
    folder.mkdir(parents=True)
    (folder / 'calib.txt').write_text(CALIB)
    times = [f'{offset / 1e9:.6e}\n' for offset in offsets_ns(len(poses))]
    (folder / 'times.txt').write_text(''.join(times))
    write_poses(root / 'poses' / f'{name}.txt', poses)
    return root


def stamps_of(count: int) -> list[int]:
    """The stamps of the frames of a sequence, as times.txt has them."""
    return [DEFAULT_EPOCH_NS + round(float(f'{ns / 1e9:.6e}') * 1e9) for ns in offsets_ns(count)]


def odometry(stamp_ns: int, pose: np.ndarray, child: str = 'base_link') -> Odometry:
    zero = make_vector3(np.zeros(3))
    return Odometry(
        make_header(stamp_ns, 'odom'),
        child,
        PoseWithCovariance(make_pose(Transform.from_matrix(pose)), np.zeros(36)),
        TwistWithCovariance(Twist(zero, zero), np.zeros(36)),
    )


def stamped(stamp_ns: int, pose: np.ndarray) -> PoseStamped:
    return PoseStamped(make_header(stamp_ns, 'odom'), make_pose(Transform.from_matrix(pose)))


def path_of(stamps_ns: Sequence[int], poses: Iterable[np.ndarray]) -> PathMessage:
    steps = [stamped(stamp_ns, pose) for stamp_ns, pose in zip(stamps_ns, poses, strict=True)]
    return PathMessage(make_header(stamps_ns[-1], 'odom'), steps)


def link(stamp_ns: int, pose: np.ndarray, child: str = 'base_link') -> TFMessage:
    return TFMessage([make_transform(Transform.from_matrix(pose), stamp_ns, 'odom', child)])


def static(*links) -> TFMessage:
    return encode_static(links, DEFAULT_EPOCH_NS)


def write_bag(path: Path, *messages: tuple[str, int, object]) -> Path:
    """A bag of messages: topic, log time in nanoseconds, message."""
    with open_bag(path, BagOptions(storage='mcap'), TYPESTORE) as writer:
        channels: dict[str, int] = {}
        for topic, stamp_ns, message in sorted(messages, key=lambda row: row[1]):
            if topic not in channels:
                channels[topic] = writer.add_channel(Channel(topic, message.__msgtype__))
            writer.write(channels[topic], stamp_ns, (join(serialize(message)),))
    return path
