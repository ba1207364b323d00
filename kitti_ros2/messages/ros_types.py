# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The message types of KITTI's data: their classes, and the typestore.

rosbags contains every type of ROS 2, and importing them all takes longer than converting a short
drive. The definitions are in files under definitions/, which name their sources; they are without
comments, which a type's hash does not include. Tests compare each with that of rosbags, if it has
one. A class is made when its first message is: all those of KITTI's data take 20 ms.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import rosbags.typesys  # noqa: F401 - whole, before its modules: else threads wait in a circle
from rosbags.typesys.store import Typestore

from .type_definitions import OF_KITTI, LazyClass, lazy_typestore, read_definitions

__all__ = [
    'TYPESTORE',
    'CameraInfo',
    'CompressedImage',
    'Header',
    'ImageMsg',
    'Imu',
    'Marker',
    'NavSatFix',
    'NavSatStatus',
    'Odometry',
    'Path',
    'Point',
    'PointCloud2',
    'PointField',
    'Pose',
    'PoseStamped',
    'PoseWithCovariance',
    'Quaternion',
    'RegionOfInterest',
    'String',
    'TFMessage',
    'Time',
    'TransformMsg',
    'TransformStamped',
    'Twist',
    'TwistStamped',
    'TwistWithCovariance',
    'TwistWithCovarianceStamped',
    'Typestore',
    'Vector3',
]

TYPESTORE = lazy_typestore(read_definitions(OF_KITTI) | read_definitions())
"""Contains the types of definitions/, and Time and Duration."""


if TYPE_CHECKING:
    from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
    from rosbags.typesys.stores.ros2_jazzy import (
        geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
    )
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Quaternion as Quaternion
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Transform as TransformMsg
    from rosbags.typesys.stores.ros2_jazzy import (
        geometry_msgs__msg__TransformStamped as TransformStamped,
    )
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Twist as Twist
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__TwistStamped as TwistStamped
    from rosbags.typesys.stores.ros2_jazzy import (
        geometry_msgs__msg__TwistWithCovariance as TwistWithCovariance,
    )
    from rosbags.typesys.stores.ros2_jazzy import (
        geometry_msgs__msg__TwistWithCovarianceStamped as TwistWithCovarianceStamped,
    )
    from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
    from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Odometry as Odometry
    from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Path as Path
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__CameraInfo as CameraInfo
    from rosbags.typesys.stores.ros2_jazzy import (
        sensor_msgs__msg__CompressedImage as CompressedImage,
    )
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Image as ImageMsg
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__Imu as Imu
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatFix as NavSatFix
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__NavSatStatus as NavSatStatus
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointCloud2 as PointCloud2
    from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__PointField as PointField
    from rosbags.typesys.stores.ros2_jazzy import (
        sensor_msgs__msg__RegionOfInterest as RegionOfInterest,
    )
    from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
    from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as String
    from rosbags.typesys.stores.ros2_jazzy import tf2_msgs__msg__TFMessage as TFMessage
    from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
else:
    _lazy = partial(LazyClass, TYPESTORE)
    Time = _lazy('builtin_interfaces/msg/Time')
    Point = _lazy('geometry_msgs/msg/Point')
    Pose = _lazy('geometry_msgs/msg/Pose')
    PoseStamped = _lazy('geometry_msgs/msg/PoseStamped')
    PoseWithCovariance = _lazy('geometry_msgs/msg/PoseWithCovariance')
    Quaternion = _lazy('geometry_msgs/msg/Quaternion')
    TransformMsg = _lazy('geometry_msgs/msg/Transform')
    TransformStamped = _lazy('geometry_msgs/msg/TransformStamped')
    Twist = _lazy('geometry_msgs/msg/Twist')
    TwistStamped = _lazy('geometry_msgs/msg/TwistStamped')
    TwistWithCovariance = _lazy('geometry_msgs/msg/TwistWithCovariance')
    TwistWithCovarianceStamped = LazyClass(
        TYPESTORE, 'geometry_msgs/msg/TwistWithCovarianceStamped'
    )
    Vector3 = _lazy('geometry_msgs/msg/Vector3')
    Odometry = _lazy('nav_msgs/msg/Odometry')
    Path = _lazy('nav_msgs/msg/Path')
    CameraInfo = _lazy('sensor_msgs/msg/CameraInfo')
    CompressedImage = _lazy('sensor_msgs/msg/CompressedImage')
    ImageMsg = _lazy('sensor_msgs/msg/Image')
    Imu = _lazy('sensor_msgs/msg/Imu')
    NavSatFix = _lazy('sensor_msgs/msg/NavSatFix')
    NavSatStatus = _lazy('sensor_msgs/msg/NavSatStatus')
    PointCloud2 = _lazy('sensor_msgs/msg/PointCloud2')
    PointField = _lazy('sensor_msgs/msg/PointField')
    RegionOfInterest = _lazy('sensor_msgs/msg/RegionOfInterest')
    Header = _lazy('std_msgs/msg/Header')
    String = _lazy('std_msgs/msg/String')
    TFMessage = _lazy('tf2_msgs/msg/TFMessage')
    Marker = _lazy('visualization_msgs/msg/Marker')
