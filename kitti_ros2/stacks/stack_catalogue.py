# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""All stacks by name, and those that take images: stereo pairs, detection, viewers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .lidar_inertial import DLIO, FAST_LIO2, GLIM, LIO_SAM, MOLA, RKO_LIO
from .lidar_odometry import GENZ_ICP, KISS_ICP, NVBLOX, OCTOMAP, ROBOT_LOCALIZATION, RTABMAP_LIDAR
from .stack import (
    DEFAULT_NAMES,
    OWN_TREE,
    PIXELS,
    Citation,
    Demand,
    Included,
    Node,
    Result,
    Setting,
    Stack,
    opencv_yaml,
    ros_parameters,
)
from .stack_names import FIX, IMU, SCAN, VELOCITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .stack import RigFacts


# Stacks that take a stereo pair: RTAB-Map, stereo_image_proc, cuVSLAM, ORB-SLAM3.


_GRAY = ('/kitti/camera_gray_left', '/kitti/camera_gray_right')
_COLOR = ('/kitti/camera_color_left', '/kitti/camera_color_right')
_RTABMAP = ('introlab/rtabmap_ros', '18d6e34d9f1d', 'rtabmap_launch/launch/rtabmap.launch.py')
_PROC = (
    'ros-perception/image_pipeline',
    '2290f495d7ac',
    'stereo_image_proc/src/stereo_image_proc/disparity_node.cpp',
)
_GEOMETRY = (
    'ros-perception/vision_opencv',
    'e8884ed',
    'image_geometry/src/stereo_camera_model.cpp',
)
_CUVSLAM = ('NVIDIA-ISAAC-ROS/isaac_ros_visual_slam', '8d7f280457d7')
_CUVSLAM_NODE = (*_CUVSLAM, 'isaac_ros_visual_slam/src/visual_slam_node.cpp')
_CUVSLAM_RIG = (*_CUVSLAM, 'isaac_ros_visual_slam/src/impl/visual_slam_impl.cpp')
_ORB = ('zang09/ORB_SLAM3_ROS2', 'b6104a19ac78', 'src/stereo/stereo-slam-node.cpp')
_ORB_SETTINGS = ('UZ-SLAMLab/ORB_SLAM3', '0df83dde1c85', 'Examples/Stereo/KITTI00-02.yaml')
_STEREO = Setting('stereo', value=True)
_LEFT_FRAME = Setting('stereo_frame', 'left')


def _inputs(pair: tuple[str, str], *, info: bool = True) -> tuple[str, ...]:
    parts = ('image_rect', 'camera_info') if info else ('image_rect',)
    return tuple(f'{camera}/{part}' for camera in pair for part in parts)


def _stereo_image_proc(rig: RigFacts) -> Mapping[str, str]:
    del rig
    values = {'approximate_sync': True, 'stereo_algorithm': 1, 'disparity_range': 128}
    return {'stereo_image_proc.yaml': ros_parameters(values)}


def _cuvslam(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'num_cameras': 2,
        'rectified_images': True,
        'enable_imu_fusion': False,
        'sync_matching_threshold_ms': 5.0,
        'image_jitter_threshold_ms': 1500.0 / rig.scan_hz,
        'map_frame': 'map',
        'odom_frame': 'odom',
        'base_frame': 'base_link',
    }
    return {'cuvslam.yaml': ros_parameters(values)}


def _orb_slam3(rig: RigFacts) -> Mapping[str, str]:
    left, right = rig.cameras[0], rig.cameras[1]
    values: dict[str, str | float | int] = {
        'File.version': '1.0',
        'Camera.type': 'Rectified',
        'Camera1.fx': left.fx,
        'Camera1.fy': left.fy,
        'Camera1.cx': left.cx,
        'Camera1.cy': left.cy,
        'Camera.width': left.width,
        'Camera.height': left.height,
        'Camera.fps': round(rig.scan_hz),
        'Camera.RGB': 1,
        'Stereo.b': right.baseline,
        'Stereo.ThDepth': 35.0,
        'ORBextractor.nFeatures': 2000,
        'ORBextractor.scaleFactor': 1.2,
        'ORBextractor.nLevels': 8,
        'ORBextractor.iniThFAST': 20,
        'ORBextractor.minThFAST': 7,
        'Viewer.KeyFrameSize': 0.6,
        'Viewer.KeyFrameLineWidth': 2.0,
        'Viewer.GraphLineWidth': 1.0,
        'Viewer.PointSize': 2.0,
        'Viewer.CameraSize': 0.7,
        'Viewer.CameraLineWidth': 3.0,
        'Viewer.ViewpointX': 0.0,
        'Viewer.ViewpointY': -100.0,
        'Viewer.ViewpointZ': -0.1,
        'Viewer.ViewpointF': 2000.0,
    }
    return {'orb-slam3.yaml': opencv_yaml(values)}


RTABMAP_STEREO = Stack(
    name='rtabmap-stereo',
    title='RTAB-Map with a stereo camera, Université de Sherbrooke',
    what='stereo SLAM',
    version='18d6e34',
    demands=(
        Demand('images', 'Image on /stereo_camera/left/image_rect_color and right/image_rect,'
               ' CameraInfo on left/camera_info and right/camera_info',
               Citation(*_RTABMAP, symbol='stereo_namespace')),
        Demand('same-stamp', 'approx_sync is false: the four messages have the same stamp',
               Citation(*_RTABMAP, symbol='approx_sync')),
        Demand('baseline', 'P[3] of the right CameraInfo is -fx times the baseline',
               Citation(*_PROC, symbol='connectCb')),
        Demand('static-frame', "frame_id to the images' frame is in /tf_static",
               Citation(*_RTABMAP, symbol='frame_id')),
        Demand('one-parent', 'it publishes map -> odom -> frame_id on /tf',
               Citation(*_RTABMAP, symbol='vo_frame_id')),
    ),
    settings=(DEFAULT_NAMES, PIXELS, _STEREO, OWN_TREE),
    inputs=_inputs(_COLOR),
    moving=(('map', 'odom'), ('odom', 'base_link')),
    publishes=('/rtabmap/odom', '/rtabmap/mapPath', '/rtabmap/cloud_map'),
    result=Result(('/rtabmap/odom', '/rtabmap/mapPath'), '/rtabmap/odom'),
    launch=(
        Included(
            'rtabmap_launch',
            'launch/rtabmap.launch.py',
            {
                'stereo': 'true',
                'stereo_namespace': '/stereo_camera',
                'frame_id': 'base_link',
                'approx_sync': 'true',
                'use_sim_time': 'true',
            },
        ),
    ),
    start='ros2 launch rtabmap_launch rtabmap.launch.py stereo:=true frame_id:=base_link'
    ' approx_sync:=true use_sim_time:=true',
    notes=(
        ('The stamps of a pair of KITTI differ by up to 1 ms; the launch file of --config has'
        ' approx_sync.'),
        'Its launch file takes arguments only; it has no file of parameters.',
    ),
)  # fmt: skip
STEREO_IMAGE_PROC = Stack(
    name='stereo_image_proc',
    title='stereo_image_proc of image_pipeline',
    what='disparity, points',
    version='2290f49',
    demands=(
        Demand('images', 'Image on left/image_rect and right/image_rect, CameraInfo on'
               ' left/camera_info and right/camera_info', Citation(*_PROC, symbol='connectCb')),
        Demand('qos', 'its subscriptions are best effort, so any publisher matches',
               Citation(*_PROC, symbol='connectCb')),
        Demand('same-stamp', 'approximate_sync is false: the four messages have the same stamp',
               Citation(*_PROC, symbol='approximate_sync')),
        Demand('encoding', 'an encoding that cv_bridge converts to mono8',
               Citation(*_PROC, symbol='imageCb')),
        Demand('baseline', 'P[3] of the right CameraInfo is -fx times the baseline',
               Citation(*_PROC, symbol='imageCb')),
        Demand('one-frame', 'both CameraInfo have one frame, as image_geometry asserts',
               Citation(*_GEOMETRY, 33)),
    ),
    settings=(DEFAULT_NAMES, PIXELS, _STEREO, _LEFT_FRAME),
    inputs=_inputs(_COLOR),
    publishes=('/disparity', '/points2'),
    result=Result(('/disparity', '/points2')),
    launch=(
        Node('stereo_image_proc', 'disparity_node', 'disparity_node'),
        Node('stereo_image_proc', 'point_cloud_node', 'point_cloud_node', {
            'left/image_rect_color': '/left/image_rect',
        }),
    ),
    start='ros2 launch stereo_image_proc stereo_image_proc.launch.py',
    settings_files=_stereo_image_proc,
    notes=(
        ('The stamps of a pair of KITTI differ by up to 1 ms; the parameters of --config have'
        ' approximate_sync.'),
        'It has no trajectory to score; images are rectified already.',
    ),
)  # fmt: skip
CUVSLAM = Stack(
    name='cuvslam',
    title='Isaac ROS Visual SLAM (cuVSLAM), NVIDIA',
    what='stereo SLAM',
    version='8d7f280',
    imu='optional',
    demands=(
        Demand('images', 'Image on visual_slam/image_N, CameraInfo on visual_slam/camera_info_N',
               Citation(*_CUVSLAM_NODE, symbol='num_cameras')),
        Demand('qos', 'its subscriptions are best effort, so any publisher matches',
               Citation(*_CUVSLAM_NODE, symbol='image_qos')),
        Demand('same-stamp', 'images are at most sync_matching_threshold_ms apart, 5 ms',
               Citation(*_CUVSLAM_NODE, symbol='sync_matching_threshold_ms')),
        Demand('encoding', 'rgb8: its subscriptions are of nitros_image_rgb8',
               Citation(*_CUVSLAM_NODE, symbol='nitros_image_rgb8')),
        Demand('own-frames', 'each camera has a frame of its own, which base_frame to it places',
               Citation(*_CUVSLAM_RIG, symbol='Initialize')),
        Demand('one-parent', 'it publishes map -> odom -> base_frame on /tf',
               Citation(*_CUVSLAM_NODE, symbol='publish_map_to_odom_tf')),
    ),
    settings=(DEFAULT_NAMES, PIXELS, _STEREO, Setting('color_encoding', 'rgb8'), OWN_TREE),
    inputs=_inputs(_COLOR),
    moving=(('map', 'odom'), ('odom', 'base_link')),
    publishes=('/visual_slam/tracking/odometry',),
    result=Result(('/visual_slam/tracking/odometry',), '/visual_slam/tracking/odometry'),
    launch=(
        Node('isaac_ros_visual_slam', '', 'visual_slam_node',
             component='nvidia::isaac_ros::visual_slam::VisualSlamNode'),
    ),
    start='ros2 launch DIR/cuvslam.launch.py',
    settings_files=_cuvslam,
    notes=('With enable_imu_fusion it reads /visual_slam/imu, which then must have 100 Hz.',),
)  # fmt: skip
ORB_SLAM3 = Stack(
    name='orb-slam3',
    title='ORB-SLAM3, Universidad de Zaragoza (node zang09/ORB_SLAM3_ROS2)',
    what='stereo SLAM',
    version='b6104a1',
    demands=(
        Demand('images', 'Image on camera/left and camera/right', Citation(*_ORB, 52)),
        Demand('same-stamp', 'an approximate synchronizer with a queue of 10', Citation(*_ORB, 55)),
        Demand('rectified', 'images are rectified, as Camera.type says',
               Citation(*_ORB_SETTINGS, symbol='Camera.type')),
    ),
    settings=(DEFAULT_NAMES, PIXELS),
    inputs=_inputs(_GRAY, info=False),
    publishes=('KeyFrameTrajectory.txt, at the end',),
    result=Result(file='KeyFrameTrajectory.txt'),
    launch=(
        Node('orbslam3', 'stereo', 'stereo', parameters=False,
             arguments=('ORBvoc.txt', '{dir}/orb-slam3.yaml', 'false')),
    ),
    start='ros2 run orbslam3 stereo ORBvoc.txt DIR/orb-slam3.yaml false',
    settings_files=_orb_slam3,
    notes=(
        'The vocabulary ORBvoc.txt is part of its sources; start the launch file beside it.',
        'The trajectory is of key frames in the left camera, in a TUM file.',
    ),
)  # fmt: skip


# Stacks that detect objects or show them: Autoware, ultralytics_ros, vision_msgs, Foxglove.


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


# All stacks by name. One stack is one entry; its names are in stack_names.py.


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
