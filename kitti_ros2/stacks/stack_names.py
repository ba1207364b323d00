# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the stacks, for the option --for; catalogue.py describes them."""

from __future__ import annotations

from enum import Enum


class StackName(str, Enum):
    """Programs whose demands are known."""

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
