# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frame map: the fixed frame of the poses in messages.

- enu (REP-103, REP-105): x east, y north, z up, the origin at the first base_link position. A
  layout without gravity (odometry) has no such axes: there map is base_link at the first pose.
- devkit: KITTI's own poses, relative to the first one: imu_link at the first packet is map, so
  the axes are tilted by its roll and pitch (convertOxtsToPose.m).

The first pose is that of the whole recording, so every part of it has the same map.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform
from ..options.messages import MapFrame

if TYPE_CHECKING:
    from ..model.recording import Start
    from ..model.samples import Pose, Trajectory


def map_from_world(start: Start | None, base_t_imu: Transform, kind: MapFrame) -> Transform:
    """Return map_T_world: a reader's fixed frame in map.

    Args:
        start: The first pose, None for a recording without poses.
        base_t_imu: imu_link in base_link.
        kind: The kind of map.
    """
    if start is None:
        return Transform.identity()
    if kind is MapFrame.DEVKIT:
        return start.world_T_imu.inverse() if start.level else Transform.identity()
    imu_t_base = base_t_imu.inverse()
    level = np.eye(3) if start.level else (start.world_T_imu @ imu_t_base).rotation.T
    # Composed in the same way as the other poses, so that the first position is exactly 0.
    first = Transform(level, np.zeros(3)) @ start.world_T_imu @ imu_t_base
    return Transform(level, -first.translation)


def has_no_gravity(start: Start | None, kind: MapFrame) -> bool:
    """Whether map is requested to be east-north-up and cannot be."""
    return start is not None and not start.level and kind is MapFrame.ENU


def place_pose(pose: Pose, map_t_world: Transform) -> Pose:
    """Transform a reader's pose to map."""
    return replace(pose, world_T_imu=map_t_world @ pose.world_T_imu)


def place_trajectory(trajectory: Trajectory, map_t_world: Transform) -> Trajectory:
    """Transform a reader's trajectory to map."""
    return replace(trajectory, world_T_imu=[map_t_world @ pose for pose in trajectory.world_T_imu])
