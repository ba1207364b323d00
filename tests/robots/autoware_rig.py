# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Six cameras of Autoware: camera0 looks ahead, the others 60 degrees apart."""

from __future__ import annotations

import numpy as np
from camera_rigs import Camera, Robot, looking, pose, turned

YAWS = {0: 0.0, 1: -60.0, 2: 60.0, 3: 180.0, 4: -120.0, 5: 120.0}
KIT = pose(turned(0.4, 3.0), (0.9, 0.0, 2.0))


def autoware_rig(ahead: int = 0) -> Robot:
    """The rig; the camera of a number looks ahead, and camera0 where that one did."""
    yaws = YAWS | {0: YAWS[ahead], ahead: YAWS[0]}
    cameras, links = [], [('base_link', 'sensor_kit_base_link', KIT)]
    base_T_lidar = pose(turned(89.8), (0.95, 0.01, 2.3))
    links.append(('sensor_kit_base_link', 'velodyne_top', np.linalg.inv(KIT) @ base_T_lidar))
    for number, yaw in yaws.items():
        side = np.radians(yaw)
        place = 0.9 + 0.4 * np.cos(side), 0.4 * np.sin(side), 1.9
        base_T_camera = looking(yaw + 0.7, place)
        frame = f'camera{number}/camera_optical_link'
        folder = f'/sensing/camera/camera{number}'
        cameras.append(Camera(folder, frame, base_T_camera, 'image_rect_color/compressed'))
        links.append(('sensor_kit_base_link', frame, np.linalg.inv(KIT) @ base_T_camera))
    return Robot(
        tuple(cameras), tuple(links), 'velodyne_top', base_T_lidar,
        lidar_topic='/sensing/lidar/top/pointcloud',
    )  # fmt: skip
