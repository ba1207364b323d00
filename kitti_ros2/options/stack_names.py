# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the stacks, for the option --for, and of the topics and frames that they expect.

stack_catalogue.py describes them. This module is small: readers of bags import it, too.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

SCAN = '/kitti/velo/points'
IMU = '/kitti/oxts/imu'
FIX = '/kitti/oxts/fix'
VELOCITY = '/kitti/oxts/vel_with_covariance'
_GRAY_LEFT = '/kitti/camera_gray_left'
_GRAY_RIGHT = '/kitti/camera_gray_right'
_COLOR_LEFT = '/kitti/camera_color_left'
_COLOR_RIGHT = '/kitti/camera_color_right'


class StackName(str, Enum):
    """Programs with known demands."""

    KISS_ICP = 'kiss-icp'
    GENZ_ICP = 'genz-icp'
    RKO_LIO = 'rko_lio'
    MOLA = 'mola'
    LIO_SAM = 'lio-sam'
    FAST_LIO2 = 'fast-lio2'
    DLIO = 'dlio'
    GLIM = 'glim'
    RTABMAP_LIDAR = 'rtabmap-lidar'
    RTABMAP_STEREO = 'rtabmap-stereo'
    STEREO_IMAGE_PROC = 'stereo_image_proc'
    CUVSLAM = 'cuvslam'
    ORB_SLAM3 = 'orb-slam3'
    ROBOT_LOCALIZATION = 'robot_localization'
    OCTOMAP = 'octomap'
    NVBLOX = 'nvblox'
    AUTOWARE = 'autoware'
    ULTRALYTICS_ROS = 'ultralytics_ros'
    VISION_MSGS = 'vision_msgs'
    FOXGLOVE = 'foxglove'


TOPICS: Mapping[StackName, Mapping[str, str]] = {
    StackName.MOLA: {
        IMU: '/imu',
        FIX: '/gps',
    },
    StackName.LIO_SAM: {
        SCAN: '/points',
        IMU: '/imu/data',
    },
    StackName.FAST_LIO2: {
        SCAN: '/velodyne_points',
        IMU: '/imu/data',
    },
    StackName.DLIO: {
        SCAN: '/points',
        IMU: '/imu',
    },
    StackName.GLIM: {
        SCAN: '/os_cloud_node/points',
        IMU: '/os_cloud_node/imu',
    },
    StackName.RTABMAP_LIDAR: {
        SCAN: '/velodyne_points',
    },
    StackName.RTABMAP_STEREO: {
        f'{_COLOR_LEFT}/image_rect': '/stereo_camera/left/image_rect_color',
        f'{_COLOR_RIGHT}/image_rect': '/stereo_camera/right/image_rect',
        f'{_COLOR_LEFT}/camera_info': '/stereo_camera/left/camera_info',
        f'{_COLOR_RIGHT}/camera_info': '/stereo_camera/right/camera_info',
    },
    StackName.STEREO_IMAGE_PROC: {
        f'{_COLOR_LEFT}/image_rect': '/left/image_rect',
        f'{_COLOR_RIGHT}/image_rect': '/right/image_rect',
        f'{_COLOR_LEFT}/camera_info': '/left/camera_info',
        f'{_COLOR_RIGHT}/camera_info': '/right/camera_info',
    },
    StackName.CUVSLAM: {
        f'{_COLOR_LEFT}/image_rect': '/visual_slam/image_0',
        f'{_COLOR_RIGHT}/image_rect': '/visual_slam/image_1',
        f'{_COLOR_LEFT}/camera_info': '/visual_slam/camera_info_0',
        f'{_COLOR_RIGHT}/camera_info': '/visual_slam/camera_info_1',
        IMU: '/visual_slam/imu',
    },
    StackName.ORB_SLAM3: {
        f'{_GRAY_LEFT}/image_rect': '/camera/left',
        f'{_GRAY_RIGHT}/image_rect': '/camera/right',
    },
    StackName.OCTOMAP: {
        SCAN: '/cloud_in',
    },
    StackName.NVBLOX: {
        SCAN: '/pointcloud',
    },
    StackName.AUTOWARE: {
        SCAN: '/sensing/lidar/top/pointcloud_raw_ex',
        IMU: '/sensing/imu/tamagawa/imu_raw',
        FIX: '/sensing/gnss/ublox/nav_sat_fix',
        VELOCITY: '/sensing/vehicle_velocity_converter/twist_with_covariance',
    },
}
"""Names of topics that a stack expects, by those of the preset default that differ."""
FRAMES: Mapping[StackName, Mapping[str, str]] = {StackName.NVBLOX: {'map': 'odom'}}
"""Names of frames that a stack expects, by field of FrameNames."""
