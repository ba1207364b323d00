# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that fuse sensors or map with known poses: robot_localization, OctoMap, nvblox."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

from .setting_texts import ros_parameters
from .stack import (
    DEFAULT_NAMES,
    OWN_TREE,
    Citation,
    Demand,
    Node,
    Result,
    Setting,
    Stack,
)
from .stack_names import IMU, SCAN, VELOCITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .rig_facts import RigFacts

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
