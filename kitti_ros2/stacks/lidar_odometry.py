# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that follow the scanner by its points, fuse sensors, or map with known poses."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

from .stack import (
    DEFAULT_NAMES,
    OWN_TREE,
    TIMED,
    Citation,
    Demand,
    Included,
    Node,
    Result,
    Setting,
    Stack,
    ros_parameters,
)
from .stack_names import IMU, SCAN, VELOCITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .stack import RigFacts


# Stacks that follow the scanner by its points: KISS-ICP, GenZ-ICP, RTAB-Map.


_KISS = ('PRBonn/kiss-icp', '07020e8c0311')
_KISS_LAUNCH = Citation('PRBonn/kiss-icp', '0090cce64baf', 'ros/launch/odometry.launch.py', 66)
_GENZ_CLOUDS = ('leedongzheo/mode-hybric', '86c122c4b963', 'ros/ros2/Utils.hpp')  # a copy
_GENZ = ('cocel-postech/genz-icp', '03cf3e59f0ab', 'ros/ros2/OdometryServer.cpp')
_RTABMAP = ('introlab/rtabmap_ros', '2477bc21c32b', 'rtabmap_examples/launch/lidar3d.launch.py')
_RTABMAP_CLOUDS = (
    'introlab/rtabmap_ros',
    '0243f58a8b83',
    'rtabmap_conversions/src/MsgConversion.cpp',
)


def _kiss_icp(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'base_frame': 'base_link',
        'lidar_odom_frame': 'odom_lidar',
        'publish_odom_tf': True,
        'invert_odom_tf': False,
        'max_range': min(100.0, rig.most_range),
        'min_range': 0.0,
        'deskew': True,
        'max_points_per_voxel': 20,
        'initial_threshold': 2.0,
        'min_motion_th': 0.1,
        'publish_debug_clouds': False,
    }
    return {'kiss-icp.yaml': ros_parameters(values)}


def _genz_icp(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'odom_frame': 'odom',
        'base_frame': 'base_link',
        'publish_odom_tf': True,
        'visualize': False,
        'deskew': rig.deskew,
        'max_range': min(100.0, rig.most_range),
        'min_range': 0.3,
        'voxel_size': 0.3,
        'map_cleanup_radius': 100.0,
        'planarity_threshold': 0.2,
        'desired_num_voxelized_points': 2000,
        'max_points_per_voxel': 1,
        'max_num_iterations': 100,
        'convergence_criterion': 0.0001,
        'initial_threshold': 2.0,
        'min_motion_th': 0.1,
    }
    return {'genz-icp.yaml': ros_parameters(values)}


KISS_ICP = Stack(
    name='kiss-icp',
    title='KISS-ICP, University of Bonn',
    what='lidar odometry',
    version='07020e8',
    points='x y z + time',
    demands=(
        Demand(
            'cloud',
            'PointCloud2 on the topic of the launch argument topic, which has no default',
            _KISS_LAUNCH,
        ),
        Demand(
            'qos',
            'its subscription is best effort, so any publisher matches',
            Citation(*_KISS, 'ros/src/OdometryServer.cpp', 110),
        ),
        Demand('xyz', 'x, y, z are float32', Citation(*_KISS, 'ros/src/Utils.hpp', 206)),
        Demand(
            'time-field',
            'to deskew, a field t, timestamp or time of uint32, float32 or float64',
            Citation(*_KISS, 'ros/src/Utils.hpp', 97),
        ),
        Demand(
            'time-span',
            'times are scaled to the lowest and the highest of the scan, which must differ',
            Citation(*_KISS, 'ros/src/Utils.hpp', 117),
        ),
        Demand(
            'static-frame',
            "base_frame to the cloud's frame is in /tf_static",
            Citation(*_KISS, 'ros/src/OdometryServer.cpp', 159),
        ),
        Demand(
            'one-parent',
            'it moves base_frame on /tf, so nothing else may',
            Citation(*_KISS, 'ros/src/OdometryServer.cpp', 167),
        ),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN,),
    moving=(('odom_lidar', 'base_link'),),
    publishes=('/kiss/odometry', '/kiss/frame', '/kiss/keypoints', '/kiss/local_map'),
    result=Result(('/kiss/odometry',), '/kiss/odometry'),
    launch=(Node('kiss_icp', 'kiss_icp_node', 'kiss_icp_node', {'pointcloud_topic': SCAN}),),
    start=f'ros2 launch kiss_icp odometry.launch.py topic:={SCAN} use_sim_time:=true',
    settings_files=_kiss_icp,
    notes=(
        (
            'Its launch file inverts the transform (base_link -> odom_lidar); the parameters of'
            ' --config do not.'
        ),
        (
            'It stamps poses like the cloud, at the start of the turn (OdometryServer.cpp'
            ' PublishOdometry); deskewed ones are of its end (cpp/kiss_icp/core/Preprocessing.cpp).'
        ),
    ),
)
GENZ_ICP = Stack(
    name='genz-icp',
    title='GenZ-ICP, POSTECH',
    what='lidar odometry',
    version='03cf3e5',
    points='x y z + time',
    demands=(
        Demand(
            'cloud',
            'PointCloud2 on the topic of the launch argument topic, which has no default',
            Citation(
                'cocel-postech/genz-icp',
                '0c57a53b8f53',
                'ros/launch/odometry.launch.py',
                symbol='topic',
            ),
        ),
        Demand('qos', 'its subscription is reliable, depth 1: the publisher must be reliable',
               Citation(*_GENZ, 143)),
        Demand('xyz', 'x, y, z are float32', Citation(*_GENZ, symbol='RegisterFrame')),
        Demand('time-field', 'to deskew, a field t, timestamp or time of uint32, float32 or'
               ' float64; without one it stops', Citation(*_GENZ_CLOUDS, symbol='GetTimestamps')),
        Demand('time-span', 'times are scaled to the lowest and the highest of the scan, which must'
               ' differ', Citation(*_GENZ_CLOUDS, symbol='NormalizeTimestamps')),
        Demand('one-parent', 'it moves base_frame, or else the frame of the cloud, on /tf',
               Citation(*_GENZ, 221)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN,),
    moving=(('odom', 'base_link'),),
    publishes=('/genz/odometry', '/genz/trajectory'),
    result=Result(('/genz/odometry',), '/genz/odometry', frame='base_link'),
    launch=(Node('genz_icp', 'odometry_node', 'odometry_node', {'pointcloud_topic': SCAN}),),
    start=f'ros2 launch genz_icp odometry.launch.py topic:={SCAN} base_frame:=base_link'
    ' visualize:=false',
    settings_files=_genz_icp,
    notes=(
        'Without base_frame it moves velo_link, which has a parent already.',
        'Its Odometry has no child_frame_id (OdometryServer.cpp:235), so the score names it.',
        ('Deskewing is off by default. --config switches it on where points have times; without'
         ' them its node stops.'),
        ('The reader of its Python package 0.3.2 does not scale times (tools/point_cloud2.py'
         ' read_point_cloud), so that deskewing has no effect there.'),
    ),
)  # fmt: skip
RTABMAP_LIDAR = Stack(
    name='rtabmap-lidar',
    title='RTAB-Map with a 3D lidar, Université de Sherbrooke',
    what='lidar SLAM',
    version='2477bc2',
    points='x y z + time',
    demands=(
        Demand('cloud', 'PointCloud2 on /velodyne_points',
               Citation(*_RTABMAP, symbol='lidar_topic')),
        Demand('xyz', 'x, y, z are float32', Citation(*_RTABMAP_CLOUDS, symbol='deskew_impl')),
        Demand(
            'time-field',
            'to deskew, one field of t, time, stamps, timestamp: uint32 nanoseconds or float32'
            ' seconds from the stamp, or float64 absolute seconds',
            Citation(*_RTABMAP_CLOUDS, symbol='deskew_impl'),
        ),
        Demand(
            'time-order',
            'points are in order of time, and the first and last times differ',
            Citation(*_RTABMAP_CLOUDS, symbol='deskew_impl'),
        ),
        Demand(
            'static-frame',
            "frame_id to the cloud's frame is in /tf_static",
            Citation(*_RTABMAP, symbol='frame_id'),
        ),
        Demand('one-parent', 'it publishes new_map -> icp_odom -> frame_id on /tf',
               Citation(*_RTABMAP, 91)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN,),
    moving=(('new_map', 'icp_odom'), ('icp_odom', 'base_link')),
    publishes=('/icp_odom', '/mapData', '/mapPath', '/cloud_map'),
    result=Result(('/icp_odom', '/mapPath'), '/icp_odom'),
    launch=(
        Included(
            'rtabmap_examples',
            'launch/lidar3d.launch.py',
            {
                'lidar_topic': '/velodyne_points',
                'frame_id': 'base_link',
                'deskewing': 'true',
                'voxel_size': '0.5',
                'expected_update_rate': '15.0',
                'use_sim_time': 'true',
            },
        ),
    ),
    start='ros2 launch rtabmap_examples lidar3d.launch.py frame_id:=base_link voxel_size:=0.5'
    ' use_sim_time:=true',
    notes=(
        'frame_id is velodyne by default, which is not in the tree of a drive.',
        'Its launch file takes arguments only; it has no file of parameters.',
    ),
)  # fmt: skip


# Stacks that fuse sensors or map with known poses: robot_localization, OctoMap, nvblox.


_EKF = ('cra-ros-pkg/robot_localization', '0439976097df', 'params/ekf.yaml')
_OCTOMAP = (
    'OctoMap/octomap_mapping',
    '054f21d5c072',
    'octomap_server/src/octomap_server.cpp',
)
_NVBLOX = ('NVIDIA-ISAAC-ROS/isaac_ros_nvblox', '042e723b6922')
_NVBLOX_PARAMETERS = (*_NVBLOX, 'nvblox_ros/include/nvblox_ros/node_params.hpp')
_NVBLOX_CLOUDS = (
    'NVIDIA-ISAAC-ROS/isaac_ros_nvblox',
    '',
    'nvblox_ros/src/lib/conversions/pointcloud_conversions.cu',
)


def _robot_localization(rig: RigFacts) -> Mapping[str, str]:
    off, on = [False] * 3, [True] * 3
    values = {
        'frequency': max(30.0, rig.imu_hz),
        'two_d_mode': False,
        'publish_tf': True,
        'map_frame': 'map',
        'odom_frame': 'odom',
        'base_link_frame': 'base_link',
        'world_frame': 'odom',
        'imu0': IMU,
        'imu0_config': [*off, *on, *off, *on, *on],
        'imu0_remove_gravitational_acceleration': True,
        'twist0': VELOCITY,
        'twist0_config': [*off, *off, *on, *off, *off],
    }
    return {'robot_localization.yaml': ros_parameters(values, 'ekf_filter_node')}


def _octomap(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'frame_id': 'map',
        'base_frame_id': 'base_link',
        'resolution': 0.2,
        'sensor_model.max_range': min(80.0, rig.most_range),
    }
    return {'octomap.yaml': ros_parameters(values)}


def _nvblox(rig: RigFacts) -> Mapping[str, str]:
    # A point outside the field of view refuses the scan, so that a degree is left on either side.
    values = {
        'global_frame': 'odom',
        'use_lidar': True,
        'use_depth': False,
        'use_color': False,
        'voxel_size': 0.2,
        'lidar_width': rig.columns,
        'lidar_height': rig.rings,
        'use_non_equal_vertical_fov_lidar_params': True,
        'min_angle_below_zero_elevation_rad': round(radians(1.0 - rig.lowest_deg), 6),
        'max_angle_above_zero_elevation_rad': round(radians(1.0 + rig.highest_deg), 6),
        'use_lidar_motion_compensation': True,
        'pointcloud2_timestamps_are_relative': True,
        'map_clearing_radius_m': 100.0,
    }
    return {'nvblox.yaml': ros_parameters(values)}


ROBOT_LOCALIZATION = Stack(
    name='robot_localization',
    title='robot_localization (ekf_node)',
    what='sensor fusion',
    version='0439976',
    imu='covariances',
    demands=(
        Demand('imu', 'Imu on the topic of imu0', Citation(*_EKF, symbol='imu0')),
        Demand('twist', 'TwistWithCovarianceStamped on the topic of twist0',
               Citation(*_EKF, symbol='twist0')),
        Demand('covariance', 'variances above 0; below 1e-9 they become 1e-9',
               Citation('cra-ros-pkg/robot_localization', '0108d3f47a41', 'src/ekf.cpp',
                      symbol='Ekf::correct')),
        Demand('static-frame', "base_link_frame to the messages' frames is in /tf_static",
               Citation(*_EKF, symbol='base_link_frame')),
        Demand('one-parent', 'it publishes odom -> base_link on /tf',
               Citation(*_EKF, symbol='publish_tf')),
    ),
    settings=(DEFAULT_NAMES, Setting('covariances', value=True), OWN_TREE),
    inputs=(IMU, VELOCITY),
    imu_hz=30.0,
    moving=(('odom', 'base_link'),),
    publishes=('/odometry/filtered',),
    result=Result(('/odometry/filtered',), '/odometry/filtered'),
    launch=(Node('robot_localization', 'ekf_node', 'ekf_filter_node'),),
    start='ros2 run robot_localization ekf_node --ros-args --params-file'
    ' DIR/robot_localization.yaml -r __node:=ekf_filter_node',
    settings_files=_robot_localization,
)  # fmt: skip
OCTOMAP = Stack(
    name='octomap',
    title='octomap_server of octomap_mapping',
    what='map, known poses',
    version='054f21d',
    points='x y z',
    demands=(
        Demand('cloud', 'PointCloud2 on cloud_in', Citation(*_OCTOMAP, symbol='cloud_in')),
        Demand('qos', 'its subscription is best effort, so any publisher matches',
               Citation(*_OCTOMAP, symbol='cloud_in')),
        Demand('xyz', 'x, y, z are float32', Citation(*_OCTOMAP, symbol='insertCloudCallback')),
        Demand('pose-at-stamp', "frame_id to the cloud's frame is on /tf at the stamp of the cloud",
               Citation(*_OCTOMAP, symbol='tf_point_cloud_sub')),
    ),
    settings=(DEFAULT_NAMES, Setting('tf', value=True)),
    inputs=(SCAN,),
    publishes=('/octomap_binary', '/octomap_full', '/octomap_point_cloud_centers'),
    result=Result(('/octomap_full',)),
    launch=(Node('octomap_server', 'octomap_server_node', 'octomap_server'),),
    start='ros2 run octomap_server octomap_server_node --ros-args --params-file DIR/octomap.yaml',
    settings_files=_octomap,
    notes=(
        ('It has no motion compensation: give --deskew. It maps with the ground truth, so there is'
        ' no trajectory to score.'),
        'base_frame_id is base_footprint by default, which is not in the tree of a drive.',
    ),
)  # fmt: skip
NVBLOX = Stack(
    name='nvblox',
    title='Isaac ROS nvblox, NVIDIA',
    what='map, known poses',
    version='042e723',
    points='x y z + uint32 ns',
    demands=(
        Demand('cloud', 'PointCloud2 on pointcloud',
               Citation('NVIDIA-ISAAC-ROS/isaac_ros_nvblox', '316c8d27ae4f',
                      'nvblox_ros/src/lib/nvblox_node.cpp', symbol='pointcloud')),
        Demand('xyz', 'x, y, z are float32',
               Citation(*_NVBLOX_CLOUDS, symbol='copyPointsFromPointcloudMsgAsync')),
        Demand('time-integer', 'one field t, timestamp or time of whole nanoseconds, 0 or more;'
               ' seconds in float32 are read as 0',
               Citation(*_NVBLOX_CLOUDS, symbol='copyTimestampsFromPointcloudMsgAsync')),
        Demand('field-of-view', 'every point is within the elevations of the parameters',
               Citation(*_NVBLOX_CLOUDS, symbol='checkLidarPointcloud')),
        Demand('pose-at-stamp', "global_frame, odom, to the cloud's frame is on /tf at the stamp",
               Citation(*_NVBLOX_PARAMETERS, symbol='global_frame')),
    ),
    settings=(
        DEFAULT_NAMES,
        Setting('points', 'ouster'),
        Setting('tf', value=True),
    ),
    inputs=(SCAN,),
    publishes=('/nvblox_node/mesh', '/nvblox_node/static_esdf_pointcloud'),
    result=Result(('/nvblox_node/static_esdf_pointcloud',)),
    launch=(
        Node('nvblox_ros', 'nvblox_node', 'nvblox_node', {'pointcloud': '/pointcloud'}),
    ),
    start='ros2 run nvblox_ros nvblox_node --ros-args --params-file DIR/nvblox.yaml'
    ' -r pointcloud:=/pointcloud',
    settings_files=_nvblox,
    notes=(
        'It maps with the ground truth as odom -> base_link, so there is no trajectory to score.',
        ('Without times in nanoseconds set use_lidar_motion_compensation to false, and give'
        ' --deskew.'),
    ),
)  # fmt: skip
