# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras and the lidar of nuScenes, by their names: x of LIDAR_TOP looks right."""

from __future__ import annotations

from camera_rigs import Camera, Robot, looking, pose, turned

YAWS = {
    'CAM_FRONT': 0.3, 'CAM_FRONT_LEFT': 55.0, 'CAM_FRONT_RIGHT': -55.0, 'CAM_BACK': 180.0,
    'CAM_BACK_LEFT': 110.0, 'CAM_BACK_RIGHT': -110.0,
}  # fmt: skip


def nuscenes_car() -> Robot:
    base_T_lidar = pose(turned(-89.9), (0.94, 0.0, 1.84))
    cameras = [
        Camera(f'/{name}', name, looking(yaw, (1.5, yaw / 200, 1.5)), 'image_rect_compressed')
        for name, yaw in YAWS.items()
    ]
    links = [('base_link', camera.frame, camera.base_T_camera) for camera in cameras]
    links.append(('base_link', 'LIDAR_TOP', base_T_lidar))
    return Robot(tuple(cameras), tuple(links), 'LIDAR_TOP', base_T_lidar, lidar_topic='/LIDAR_TOP')
