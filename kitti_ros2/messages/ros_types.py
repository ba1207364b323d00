# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The message types of KITTI's data: definitions, classes, and the typestore.

rosbags contains every type of ROS 2, and importing them all takes longer than converting a short
drive. The definitions here are those of ROS 2 Jazzy's common_interfaces, tf2_msgs 0.36 and
vision_msgs 4.1 (Apache-2.0 and BSD-3-Clause), without their comments, which a type's hash does
not include. Tests compare each with that of rosbags, if it has one.

The types of Autoware and Foxglove, and those that they need, are in files under definitions/, which
name their sources. Their Python classes are made when the first message is decoded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.typesys.store import Typestore

from .type_definitions import lazy_typestore, parse_definitions, read_definitions

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

_DEFINITIONS = {
    'std_msgs/msg/Header': 'builtin_interfaces/Time stamp|string frame_id',
    'std_msgs/msg/String': 'string data',
    'std_msgs/msg/ColorRGBA': 'float32 r|float32 g|float32 b|float32 a',
    'diagnostic_msgs/msg/KeyValue': 'string key|string value',
    'diagnostic_msgs/msg/DiagnosticStatus': (
        'byte OK=0|byte WARN=1|byte ERROR=2|byte STALE=3|byte level|string name|string message'
        '|string hardware_id|diagnostic_msgs/KeyValue[] values'
    ),
    'diagnostic_msgs/msg/DiagnosticArray': (
        'std_msgs/Header header|diagnostic_msgs/DiagnosticStatus[] status'
    ),
    'geometry_msgs/msg/Point': 'float64 x|float64 y|float64 z',
    'geometry_msgs/msg/Vector3': 'float64 x|float64 y|float64 z',
    'geometry_msgs/msg/Quaternion': 'float64 x|float64 y|float64 z|float64 w',
    'geometry_msgs/msg/Pose': 'geometry_msgs/Point position|geometry_msgs/Quaternion orientation',
    'geometry_msgs/msg/PoseStamped': 'std_msgs/Header header|geometry_msgs/Pose pose',
    'geometry_msgs/msg/PoseWithCovariance': 'geometry_msgs/Pose pose|float64[36] covariance',
    'geometry_msgs/msg/Twist': 'geometry_msgs/Vector3 linear|geometry_msgs/Vector3 angular',
    'geometry_msgs/msg/TwistStamped': 'std_msgs/Header header|geometry_msgs/Twist twist',
    'geometry_msgs/msg/TwistWithCovariance': 'geometry_msgs/Twist twist|float64[36] covariance',
    'geometry_msgs/msg/TwistWithCovarianceStamped': (
        'std_msgs/Header header|geometry_msgs/TwistWithCovariance twist'
    ),
    'geometry_msgs/msg/Transform': (
        'geometry_msgs/Vector3 translation|geometry_msgs/Quaternion rotation'
    ),
    'geometry_msgs/msg/TransformStamped': (
        'std_msgs/Header header|string child_frame_id|geometry_msgs/Transform transform'
    ),
    'nav_msgs/msg/Odometry': (
        'std_msgs/Header header|string child_frame_id|geometry_msgs/PoseWithCovariance pose'
        '|geometry_msgs/TwistWithCovariance twist'
    ),
    'nav_msgs/msg/Path': 'std_msgs/Header header|geometry_msgs/PoseStamped[] poses',
    'sensor_msgs/msg/CameraInfo': (
        'std_msgs/Header header|uint32 height|uint32 width|string distortion_model'
        '|float64[] d|float64[9] k|float64[9] r|float64[12] p'
        '|uint32 binning_x|uint32 binning_y|sensor_msgs/RegionOfInterest roi'
    ),
    'sensor_msgs/msg/CompressedImage': 'std_msgs/Header header|string format|uint8[] data',
    'sensor_msgs/msg/Image': (
        'std_msgs/Header header|uint32 height|uint32 width|string encoding|uint8 is_bigendian'
        '|uint32 step|uint8[] data'
    ),
    'sensor_msgs/msg/Imu': (
        'std_msgs/Header header'
        '|geometry_msgs/Quaternion orientation|float64[9] orientation_covariance'
        '|geometry_msgs/Vector3 angular_velocity|float64[9] angular_velocity_covariance'
        '|geometry_msgs/Vector3 linear_acceleration|float64[9] linear_acceleration_covariance'
    ),
    'sensor_msgs/msg/LaserScan': (
        'std_msgs/Header header|float32 angle_min|float32 angle_max|float32 angle_increment'
        '|float32 time_increment|float32 scan_time|float32 range_min|float32 range_max'
        '|float32[] ranges|float32[] intensities'
    ),
    'sensor_msgs/msg/NavSatStatus': (
        'int8 STATUS_UNKNOWN=-2|int8 STATUS_NO_FIX=-1|int8 STATUS_FIX=0|int8 STATUS_SBAS_FIX=1'
        '|int8 STATUS_GBAS_FIX=2|int8 status|uint16 SERVICE_UNKNOWN=0|uint16 SERVICE_GPS=1'
        '|uint16 SERVICE_GLONASS=2|uint16 SERVICE_COMPASS=4|uint16 SERVICE_GALILEO=8'
        '|uint16 service'
    ),
    'sensor_msgs/msg/NavSatFix': (
        'std_msgs/Header header|sensor_msgs/NavSatStatus status|float64 latitude'
        '|float64 longitude|float64 altitude|float64[9] position_covariance'
        '|uint8 COVARIANCE_TYPE_UNKNOWN=0|uint8 COVARIANCE_TYPE_APPROXIMATED=1'
        '|uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2|uint8 COVARIANCE_TYPE_KNOWN=3'
        '|uint8 position_covariance_type'
    ),
    'sensor_msgs/msg/PointCloud2': (
        'std_msgs/Header header|uint32 height|uint32 width|sensor_msgs/PointField[] fields'
        '|bool is_bigendian|uint32 point_step|uint32 row_step|uint8[] data|bool is_dense'
    ),
    'sensor_msgs/msg/PointField': (
        'uint8 INT8=1|uint8 UINT8=2|uint8 INT16=3|uint8 UINT16=4|uint8 INT32=5|uint8 UINT32=6'
        '|uint8 FLOAT32=7|uint8 FLOAT64=8|string name|uint32 offset|uint8 datatype|uint32 count'
    ),
    'sensor_msgs/msg/RegionOfInterest': (
        'uint32 x_offset|uint32 y_offset|uint32 height|uint32 width|bool do_rectify'
    ),
    'tf2_msgs/msg/TFMessage': 'geometry_msgs/TransformStamped[] transforms',
    'visualization_msgs/msg/Marker': (
        'int32 ARROW=0|int32 CUBE=1|int32 SPHERE=2|int32 CYLINDER=3|int32 LINE_STRIP=4'
        '|int32 LINE_LIST=5|int32 CUBE_LIST=6|int32 SPHERE_LIST=7|int32 POINTS=8'
        '|int32 TEXT_VIEW_FACING=9|int32 MESH_RESOURCE=10|int32 TRIANGLE_LIST=11'
        '|int32 ARROW_STRIP=12|int32 ADD=0|int32 MODIFY=0|int32 DELETE=2|int32 DELETEALL=3'
        '|std_msgs/Header header|string ns|int32 id|int32 type|int32 action'
        '|geometry_msgs/Pose pose|geometry_msgs/Vector3 scale|std_msgs/ColorRGBA color'
        '|builtin_interfaces/Duration lifetime|bool frame_locked|geometry_msgs/Point[] points'
        '|std_msgs/ColorRGBA[] colors|string texture_resource|sensor_msgs/CompressedImage texture'
        '|visualization_msgs/UVCoordinate[] uv_coordinates|string text|string mesh_resource'
        '|visualization_msgs/MeshFile mesh_file|bool mesh_use_embedded_materials'
    ),
    'visualization_msgs/msg/MarkerArray': 'visualization_msgs/Marker[] markers',
    'visualization_msgs/msg/MeshFile': 'string filename|uint8[] data',
    'visualization_msgs/msg/UVCoordinate': 'float32 u|float32 v',
    'vision_msgs/msg/Point2D': 'float64 x|float64 y',
    'vision_msgs/msg/Pose2D': 'vision_msgs/Point2D position|float64 theta',
    'vision_msgs/msg/BoundingBox2D': 'vision_msgs/Pose2D center|float64 size_x|float64 size_y',
    'vision_msgs/msg/BoundingBox3D': 'geometry_msgs/Pose center|geometry_msgs/Vector3 size',
    'vision_msgs/msg/ObjectHypothesis': 'string class_id|float64 score',
    'vision_msgs/msg/ObjectHypothesisWithPose': (
        'vision_msgs/ObjectHypothesis hypothesis|geometry_msgs/PoseWithCovariance pose'
    ),
    'vision_msgs/msg/Detection2D': (
        'std_msgs/Header header|vision_msgs/ObjectHypothesisWithPose[] results'
        '|vision_msgs/BoundingBox2D bbox|string id'
    ),
    'vision_msgs/msg/Detection2DArray': (
        'std_msgs/Header header|vision_msgs/Detection2D[] detections'
    ),
    'vision_msgs/msg/Detection3D': (
        'std_msgs/Header header|vision_msgs/ObjectHypothesisWithPose[] results'
        '|vision_msgs/BoundingBox3D bbox|string id'
    ),
    'vision_msgs/msg/Detection3DArray': (
        'std_msgs/Header header|vision_msgs/Detection3D[] detections'
    ),
}
"""By full name the lines of the .msg file, separated by |."""


TYPESTORE = lazy_typestore(parse_definitions(_DEFINITIONS), read_definitions())
"""Contains the types above, those in definitions/, and Time and Duration."""


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
    Time = TYPESTORE.types['builtin_interfaces/msg/Time']
    Point = TYPESTORE.types['geometry_msgs/msg/Point']
    Pose = TYPESTORE.types['geometry_msgs/msg/Pose']
    PoseStamped = TYPESTORE.types['geometry_msgs/msg/PoseStamped']
    PoseWithCovariance = TYPESTORE.types['geometry_msgs/msg/PoseWithCovariance']
    Quaternion = TYPESTORE.types['geometry_msgs/msg/Quaternion']
    TransformMsg = TYPESTORE.types['geometry_msgs/msg/Transform']
    TransformStamped = TYPESTORE.types['geometry_msgs/msg/TransformStamped']
    Twist = TYPESTORE.types['geometry_msgs/msg/Twist']
    TwistStamped = TYPESTORE.types['geometry_msgs/msg/TwistStamped']
    TwistWithCovariance = TYPESTORE.types['geometry_msgs/msg/TwistWithCovariance']
    TwistWithCovarianceStamped = TYPESTORE.types['geometry_msgs/msg/TwistWithCovarianceStamped']
    Vector3 = TYPESTORE.types['geometry_msgs/msg/Vector3']
    Odometry = TYPESTORE.types['nav_msgs/msg/Odometry']
    Path = TYPESTORE.types['nav_msgs/msg/Path']
    CameraInfo = TYPESTORE.types['sensor_msgs/msg/CameraInfo']
    CompressedImage = TYPESTORE.types['sensor_msgs/msg/CompressedImage']
    ImageMsg = TYPESTORE.types['sensor_msgs/msg/Image']
    Imu = TYPESTORE.types['sensor_msgs/msg/Imu']
    NavSatFix = TYPESTORE.types['sensor_msgs/msg/NavSatFix']
    NavSatStatus = TYPESTORE.types['sensor_msgs/msg/NavSatStatus']
    PointCloud2 = TYPESTORE.types['sensor_msgs/msg/PointCloud2']
    PointField = TYPESTORE.types['sensor_msgs/msg/PointField']
    RegionOfInterest = TYPESTORE.types['sensor_msgs/msg/RegionOfInterest']
    Header = TYPESTORE.types['std_msgs/msg/Header']
    String = TYPESTORE.types['std_msgs/msg/String']
    TFMessage = TYPESTORE.types['tf2_msgs/msg/TFMessage']
    Marker = TYPESTORE.types['visualization_msgs/msg/Marker']
