# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An Ouster with its driver's frames: x of os_lidar looks backward in os_sensor."""

from __future__ import annotations

from camera_rigs import Camera, Robot, looking, pose, turned

SENSOR_T_LIDAR = pose(turned(180.0), (0.0, 0.0, 0.036180))
SENSOR_T_IMU = pose(turned(0.0), (0.006253, -0.011775, 0.007645))
BASE_T_SENSOR = pose(turned(1.0), (0.2, 0.0, 0.8))


def ouster_robot(*, body: bool = True, sensor: bool = True, camera: bool = True) -> Robot:
    """The robot, with or without base_link, os_sensor, and a camera that looks ahead."""
    base_T_lidar = BASE_T_SENSOR @ SENSOR_T_LIDAR
    ahead = Camera('/front/camera', 'front_optical', looking(-1.5, (0.4, 0.05, 0.6)))
    top = 'base_link' if body else 'mount'
    if sensor:
        links = [
            (top, 'os_sensor', BASE_T_SENSOR),
            ('os_sensor', 'os_lidar', SENSOR_T_LIDAR),
            ('os_sensor', 'os_imu', SENSOR_T_IMU),
        ]
    else:
        links = [(top, 'os_lidar', base_T_lidar)]
    links.append((top, 'front_optical', ahead.base_T_camera))
    cameras = (ahead,) if camera else ()
    return Robot(cameras, tuple(links), 'os_lidar', base_T_lidar, camera, '/ouster/points')
