# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Robots with few cameras: front, left, right; one only; stereo pairs; a RealSense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from camera_rigs import Camera, K, Robot, looking, pose, turned

LIDAR = pose(turned(3.0, 1.0), (0.3, 0.0, 1.2))


def joined(*cameras: Camera, root: str = 'base_link', **options: object) -> Robot:
    """A robot of which all sensors are joined to one frame."""
    links = [(root, camera.frame, camera.base_T_camera) for camera in cameras]
    return Robot(cameras, ((root, 'lidar', LIDAR), *links), 'lidar', LIDAR, **options)


def sides(*names: str) -> Robot:
    """Cameras named after the side they look to."""
    yaws = {'front': 0.0, 'left': 90.0, 'right': -90.0, 'rear': 180.0, 'back': 180.0}
    return joined(
        *(
            Camera(f'/{name}', f'{name}_eye', looking(yaws[name.lower()], (0.5, 0.0, 1.0)))
            for name in names
        )
    )


def stereo(*, joins: bool = True, baseline_m: float = 0.12, yaw: float = 0.0) -> Robot:
    """A stereo pair; without TF the baseline is in P alone, and both name the left frame."""
    left = Camera('/stereo/left', 'stereo_left', looking(yaw, (0.5, 0.06, 1.0)))
    beside = pose(np.eye(3), (baseline_m, 0.0, 0.0))
    right = Camera(
        '/stereo/right', 'stereo_right', left.base_T_camera @ beside, offset_m=-baseline_m
    )
    robot = joined(left, replace(right, frame=right.frame if joins else left.frame))
    return robot if joins else replace(robot, links=robot.links[:2])


def realsense(*, colour: bool = True, body: bool = True) -> Robot:
    """A D435: infrared pair 50 mm apart, colour 15 mm to the left, all in camera_link."""
    link = pose(turned(0.0, 1.0), (0.3, 0.0, 0.5))
    infra = link @ looking(0.0, (0.0, 0.0, 0.0))
    first = Camera(
        '/camera/infra1', 'camera_infra1_optical_frame', infra, 'image_rect_raw', 'mono8'
    )
    second = Camera(
        '/camera/infra2', 'camera_infra2_optical_frame',
        infra @ pose(np.eye(3), (0.05, 0.0, 0.0)), 'image_rect_raw', 'mono8', offset_m=-0.05,
    )  # fmt: skip
    focal = K * np.array([[1.6], [1.6], [1.0]])
    eye = Camera(
        '/camera/color', 'camera_color_optical_frame',
        infra @ pose(turned(0.0, 0.2), (-0.015, 0.0, 0.0)), 'image_raw', k=focal,
    )  # fmt: skip
    cameras = (eye, first, second) if colour else (first, second)
    return joined(*cameras, root='base_link' if body else 'rig')
