# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Random drives, results of passable odometry, and the usual mistakes in these."""

from __future__ import annotations

import numpy as np

SCANNER = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
"""Camera 0 to x forward, y left, z up: columns are the scanner's axes."""


def _pose(yaw, pitch, step):
    pose = np.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    tilt = np.array(
        [[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]]
    )
    pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ tilt
    pose[2, 3] = step
    return pose


def _joined(steps):
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def drive(rng, count=None):
    """Poses of camera 0 of a drive with bends, at 10 Hz, that starts and stops."""
    count = int(rng.integers(300, 1200)) if count is None else count
    time = np.arange(count - 1) / 10
    speed = 9 + 6 * np.sin(time / rng.uniform(5, 12) + rng.uniform(0, 6))
    turn = 0.25 * np.sin(time / rng.uniform(6, 14) + rng.uniform(0, 6)) ** 3
    climb = 0.01 * np.sin(time / 20)
    return _joined([_pose(*row) for row in zip(turn / 10, climb / 10, speed / 10, strict=True)])


def odometry(truth, rng):
    """A passable result: a scale of 2 % at most off, noise of each step."""
    steps = np.linalg.inv(truth[:-1]) @ truth[1:]
    scale = rng.normal(1, 0.01)
    noisy = []
    for step in steps:
        off = _pose(*rng.normal(0, 2e-4, 2), 0)
        moved = step @ off
        moved[:3, 3] = scale * step[:3, 3] + rng.normal(0, 0.01, 3)
        noisy.append(moved)
    return _joined(noisy)


def _turned(turn):
    return lambda poses, _: np.linalg.inv(turn) @ poses @ turn


def _transposed(poses, _):
    poses = poses.copy()
    poses[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return poses


def _scaled(poses, rng):
    poses = poses.copy()
    poses[:, :3, 3] *= rng.choice([rng.uniform(0.02, 0.7), rng.uniform(1.5, 40)])
    return poses


def _late(poses, rng):
    by = int(rng.integers(5, 16))
    return np.concatenate([np.repeat(poses[:1], by, axis=0), poses[:-by]])


EXCHANGED = np.array([[0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])

MISTAKES = {
    'scanner': (_turned(SCANNER), 'x forward, y left, z up; give --frame velo_link'),
    'other axes': (_turned(EXCHANGED), 'as poses of a frame with x forward, y up, z right'),
    'inverse': (lambda poses, _: np.linalg.inv(poses), 'inverted'),
    'transposed': (_transposed, 'transposed rotations'),
    'scale': (_scaled, 'give --align sim3'),
    'late': (_late, 'frames before its own'),
    'keyframes': (lambda poses, rng: poses[:: int(rng.integers(2, 9))], 'keyframes'),
}
"""By name: what plants it, and a part of its note."""
