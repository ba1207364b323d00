# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""All stacks by name. One stack is one entry; its names are in stack_names.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .inertial_extrinsics import DLIO, FAST_LIO2, LIO_SAM
from .lidar_inertial import GLIM, MOLA, RKO_LIO
from .lidar_odometry import GENZ_ICP, KISS_ICP, RTABMAP_LIDAR
from .mapping import NVBLOX, OCTOMAP, ROBOT_LOCALIZATION
from .perception import AUTOWARE, FOXGLOVE, ULTRALYTICS_ROS, VISION_MSGS
from .stereo import CUVSLAM, ORB_SLAM3, RTABMAP_STEREO, STEREO_IMAGE_PROC

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .stack import Stack

STACKS: Mapping[str, Stack] = {
    stack.name: stack
    for stack in (
        KISS_ICP,
        GENZ_ICP,
        RKO_LIO,
        MOLA,
        LIO_SAM,
        FAST_LIO2,
        DLIO,
        GLIM,
        RTABMAP_LIDAR,
        RTABMAP_STEREO,
        STEREO_IMAGE_PROC,
        CUVSLAM,
        ORB_SLAM3,
        ROBOT_LOCALIZATION,
        OCTOMAP,
        NVBLOX,
        AUTOWARE,
        ULTRALYTICS_ROS,
        VISION_MSGS,
        FOXGLOVE,
    )
}
"""In the order of StackName."""
