# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that detect objects or show them: Autoware, ultralytics_ros, vision_msgs, Foxglove."""

from __future__ import annotations

from .stack import (
    DEFAULT_NAMES,
    PIXELS,
    Citation,
    Demand,
    Included,
    Result,
    Setting,
    Stack,
)
from .stack_names import FIX, IMU, SCAN, VELOCITY

_POINT_TYPES = (
    'autowarefoundation/autoware.universe',
    'af5f8550c689',
    'common/autoware_point_types/include/autoware/point_types/types.hpp',
)
_DISTORTION = (
    'autowarefoundation/autoware_universe',
    'a285ea9a3d7d',
    (
        'sensing/autoware_pointcloud_preprocessor/src/distortion_corrector/'
        'distortion_corrector_node.cpp'
    ),
)
_KIT = 'autowarefoundation/sample_sensor_kit_launch'
_TRACKER = (
    'Alpaca-zip/ultralytics_ros',
    '757398e6d66b',
    'launch/kitti_tracker_with_cloud.launch.xml',
)
_VIEWERS = ('ros-perception/vision_msgs', '1adca4dd009d')
_VIEWERS_BOXES = (
    'ros-perception/vision_msgs',
    '03fbe93ebd50',
    'vision_msgs_rviz_plugins/include/vision_msgs_rviz_plugins/detection_3d_common.hpp',
)
_CAMERA = '/kitti/camera_color_left'
_BOXES = '/kitti/labels/detections'

AUTOWARE = Stack(
    name='autoware',
    title='Autoware (universe, sample_sensor_kit)',
    what='driving',
    version='a285ea9',
    points='XYZIRCAEDT',
    imu='yes',
    demands=(
        Demand('cloud', 'PointCloud2 on /sensing/lidar/top/pointcloud_raw_ex',
               Citation(_KIT, '03ba3c52eb4b',
                      'common_sensor_launch/launch/nebula_node_container.launch.py',
                      symbol='pointcloud_raw_ex')),
        Demand('point-type', 'PointXYZIRCAEDT: x y z float32, intensity, return_type uint8, channel'
               ' uint16, azimuth, elevation, distance float32, time_stamp uint32 nanoseconds;'
               ' 32 bytes', Citation(*_POINT_TYPES, 95)),
        Demand('point-type-exact', 'the distortion corrector accepts no other layout',
               Citation(*_DISTORTION, symbol='pointcloud_callback')),
        Demand('azimuth', 'azimuth rises with the points of a channel: the ring outlier filter'
               ' joins neighbours less than a degree on, and drops points that have none',
               Citation('autowarefoundation/autoware.universe', '17799e5d0dac',
                      'sensing/autoware_cuda_pointcloud_preprocessor/src/'
                      'cuda_pointcloud_preprocessor/outlier_kernels.cu', 46)),
        Demand('imu', 'Imu on /sensing/imu/tamagawa/imu_raw',
               Citation(_KIT, '210f29c', 'sample_sensor_kit_launch/launch/imu.launch.xml',
                      symbol='imu_raw')),
        Demand('fix', 'NavSatFix on /sensing/gnss/ublox/nav_sat_fix',
               Citation(_KIT, '315e9f1', 'sample_sensor_kit_launch/launch/gnss.launch.xml',
                      symbol='nav_sat_fix')),
        Demand('twist', 'TwistWithCovarianceStamped on'
               ' /sensing/vehicle_velocity_converter/twist_with_covariance',
               Citation(_KIT, '03ba3c52eb4b',
                      'common_sensor_launch/launch/nebula_node_container.launch.py',
                      symbol='twist_with_covariance')),
        Demand('objects', 'labels as autoware_perception_msgs, to compare with its detections',
               Citation('autowarefoundation/autoware_msgs', '4d899889d347',
                      'autoware_perception_msgs/msg/DetectedObjects.msg')),
        Demand('static-frame', "base_link to the cloud's frame is in /tf_static",
               Citation(*_DISTORTION, symbol='base_frame')),
    ),
    settings=(
        DEFAULT_NAMES,
        Setting('points', 'xyzircaedt'),
        Setting('covariances', value=True),
        Setting('objects', 'both', ('autoware',)),
    ),
    inputs=(SCAN, IMU, FIX, VELOCITY),
    publishes=('/perception/object_recognition/objects',),
    result=Result(('/perception/object_recognition/objects',)),
    start='ros2 launch autoware_launch logging_simulator.launch.xml map_path:=MAP'
    ' vehicle_model:=sample_vehicle sensor_model:=sample_sensor_kit',
    notes=(
        ('Its launch needs a map of its own and is not part of the launch file of --config, which'
        ' plays the drive.'),
        'map -> base_link is the ground truth; with localization started give --no-tf.',
    ),
)  # fmt: skip
ULTRALYTICS_ROS = Stack(
    name='ultralytics_ros',
    title='ultralytics_ros (YOLO)',
    what='2D and 3D boxes',
    version='757398e',
    points='x y z',
    demands=(
        Demand('images', 'Image on /kitti/camera_color_left/image_raw', Citation(*_TRACKER, 6)),
        Demand('info', 'CameraInfo on /kitti/camera_color_left/camera_info',
               Citation(*_TRACKER, 21)),
        Demand('cloud', 'PointCloud2 on /kitti/velo/pointcloud', Citation(*_TRACKER, 22)),
        Demand('encoding', 'an encoding that cv_bridge converts to bgr8',
               Citation('Alpaca-zip/ultralytics_ros', '757398e6d66b', 'script/tracker_node.py',
                      symbol='image_callback')),
        Demand('same-stamp', 'image, CameraInfo and cloud are matched by stamps',
               Citation('Alpaca-zip/ultralytics_ros', '757398e6d66b',
                      'src/tracker_with_cloud_node.cpp', symbol='sync_')),
        Demand('static-frame', "the cloud's frame to the image's is in /tf_static",
               Citation('Alpaca-zip/ultralytics_ros', '757398e6d66b',
                      'src/tracker_with_cloud_node.cpp', symbol='cloud2TransformedCloud')),
    ),
    settings=(Setting('preset', 'kitti2bag'), PIXELS),
    inputs=(f'{_CAMERA}/image_rect', f'{_CAMERA}/camera_info', SCAN),
    publishes=('/yolo_result', '/yolo_3d_result'),
    result=Result(('/yolo_result', '/yolo_3d_result')),
    launch=(
        Included('ultralytics_ros', 'launch/kitti_tracker_with_cloud.launch.xml'),
    ),
    start='ros2 launch ultralytics_ros kitti_tracker_with_cloud.launch.xml',
    notes=(
        'Its names are those of kitti2bag, which --preset kitti2bag has, too.',
        'Score the 3D boxes with: kitti-ros2 eval detection DRIVE RESULT --topic /yolo_3d_result',
    ),
)  # fmt: skip
VISION_MSGS = Stack(
    name='vision_msgs',
    title='vision_msgs_rviz_plugins',
    what='viewer of boxes',
    version='1adca4d',
    demands=(
        Demand('boxes', 'Detection3DArray, on a topic chosen in RViz',
               Citation(*_VIEWERS, 'vision_msgs_rviz_plugins/src/detection_3d_array.cpp',
                      symbol='onInitialize')),
        Demand('results', 'each detection has a result: its label and score are read without a'
               ' check',
               Citation(*_VIEWERS_BOXES, symbol='showBoxes')),
        Demand('box-frame', 'boxes are in the frame of the array, not in one of their own',
               Citation(*_VIEWERS_BOXES, symbol='showBoxes')),
    ),
    inputs=(_BOXES,),
    start='rviz2',
    notes=(f'Add the display Detection3DArray and choose {_BOXES}.',),
)  # fmt: skip
FOXGLOVE = Stack(
    name='foxglove',
    title='Foxglove (panels Image and 3D)',
    what='viewer',
    version='2026 docs',
    points='x y z',
    demands=(
        Demand('images', 'CompressedImage or Image, with CameraInfo for 3D',
               Citation('docs.foxglove.dev', '', '/docs/visualization/panels/image')),
        Demand('annotations', 'boxes on images are foxglove_msgs/msg/ImageAnnotations',
               Citation('docs.foxglove.dev', '', '/docs/sdk/schemas/image-annotations')),
    ),
    settings=(Setting('annotations', value=True),),
    inputs=(f'{_CAMERA}/camera_info',),
    start='kitti-ros2 play DRIVE --foxglove',
    notes=(
        'Its source is not public; these demands are from its documentation.',
        'It opens bags directly, or live with --foxglove or foxglove_bridge.',
    ),
)  # fmt: skip
