# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that follow the scanner by its points: KISS-ICP, GenZ-ICP, RTAB-Map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .setting_texts import ros_parameters
from .stack import (
    DEFAULT_NAMES,
    OWN_TREE,
    TIMED,
    Citation,
    Demand,
    Included,
    Node,
    Result,
    Stack,
)
from .stack_names import SCAN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .rig_facts import RigFacts

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
