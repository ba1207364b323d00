# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Forward of a robot, from the names and places of its frames.

Bodies have x forward, y left, z up, and optical frames z forward, x right, y down (REP 103, REP
105). Lidars have any axes: x of Ouster's os_lidar looks to the cable, backward in os_sensor
(ouster-ros, "Coordinate Frames"), and x of nuScenes' LIDAR_TOP looks right.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..model.geometry import Float64Array
    from .tf_tree import FrameTree

AXES: dict[str, Float64Array] = {
    'x': np.eye(3),
    '-x': np.diag([-1.0, -1.0, 1.0]),
    'y': np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    '-y': np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    'z': np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
}
"""By the axis that looks forward: (3, 3), columns forward, left, up in the frame. Up is z, with z
forward it is -y, as in an optical frame."""

_BODIES = (
    *('base_link', 'base_footprint', 'ego_vehicle', 'vehicle', 'base'),
    *('chassis', 'chassis_link', 'ego', 'car', 'trunk', 'body'),
)
FIXED_FRAMES = ('map', 'earth', 'world', 'odom')
"""Frames in which a robot moves (REP 105), in order of preference: poses in odom drift."""

_ROBOT_BASE = re.compile(r'_base_link$', re.IGNORECASE)
_SENSOR = re.compile(r'velo|lidar|laser|ouster|cam|imu|gps|gnss|radar|kit', re.IGNORECASE)
_OPTICAL = re.compile(r'optical(_frame|_link)?$', re.IGNORECASE)
_OUSTER = re.compile(r'^(?P<prefix>.*)os_lidar$')
_BACKWARD_DEG = 175
_STEEP_DEG = 60


@dataclass(frozen=True, eq=False)
class Heading:
    """Forward of a robot.

    Attributes:
        frame: A frame.
        rotation: (3, 3), columns forward, left, up in that frame.
        source: The reason, for notes.
        body: Whether the frame is the robot's body, with x forward.
        assumed: Whether nothing but the scanner's own x is known.
    """

    frame: str
    rotation: Float64Array
    source: str
    body: bool = False
    assumed: bool = False

    def axes_of(self, tree: FrameTree, frame: str) -> Float64Array | None:
        """Return (3, 3) the axes of a frame as columns in forward, left, up; None if not joined."""
        place = tree.find(self.frame, frame)
        return None if place is None else self.rotation.T @ place.rotation


def is_optical(frame: str) -> bool:
    """Whether a frame's name says that z looks forward."""
    return bool(_OPTICAL.search(frame))


def find_body(tree: FrameTree, sensors: Iterable[str]) -> Heading | None:
    """Return the heading of the robot's body, if static transforms join a sensor to it."""
    wanted = [frame for frame in sensors if frame]
    frames = sorted({*tree.frames, *wanted})
    named = [
        frame for name in _BODIES for frame in frames if frame.rpartition('/')[2].lower() == name
    ]
    named += [frame for frame in frames if _ROBOT_BASE.search(frame) and not _SENSOR.search(frame)]
    anchors = {tree.anchor(frame) for frame in wanted}
    for frame in named:
        if tree.anchor(frame) in anchors:
            return Heading(frame, AXES['x'], f'x of {frame}', body=True)
    return None


def root_heading(tree: FrameTree, sensors: Iterable[str]) -> Heading | None:
    """Return the heading of a root above several sensors, which is no sensor: it is the robot's."""
    wanted = {frame for frame in sensors if frame in tree.frames}
    joined = Counter(tree.anchor(frame) for frame in wanted)
    for root in tree.roots:
        known = root in wanted or _SENSOR.search(root) or is_optical(root) or root in FIXED_FRAMES
        if not known and joined[root] > 1:
            return Heading(root, AXES['x'], f'x of {root}', body=True)
    return None


def known_heading(tree: FrameTree, frame: str) -> Heading | None:
    """Return the heading of a scanner's frame that its name implies: Ouster's, optical ones."""
    match = _OUSTER.match(frame)
    sensor = f'{match["prefix"]}os_sensor' if match else ''
    if sensor and tree.find(sensor, frame) is not None:
        return Heading(sensor, AXES['x'], f'x of {sensor}')
    if is_optical(frame):
        return Heading(frame, AXES['z'], f'z of {frame}')
    return None


def nearest_axis(rotation: Float64Array) -> str:
    """Return the key of AXES nearest to a rotation (columns forward, left, up in a frame)."""
    return max(AXES, key=lambda name: float(np.trace(AXES[name].T @ rotation)))


def describe_direction(direction: Float64Array) -> str:
    """Describe a (3,) direction, given in forward, left, up, as an angle from forward."""
    forward, left, up = direction / np.linalg.norm(direction)
    steep = np.degrees(np.arcsin(np.clip(up, -1, 1)))
    if abs(steep) > _STEEP_DEG:
        return f'{abs(steep):.0f} degrees {"up" if up > 0 else "down"}'
    degrees = float(np.degrees(np.arctan2(left, forward)))
    if abs(degrees) >= _BACKWARD_DEG:
        return 'backward'
    if round(abs(degrees)) == 0:
        return 'forward'
    return f'{abs(degrees):.0f} degrees to the {"left" if left > 0 else "right"}'
