# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that take scanner and Imu, and the extrinsics from /tf_static: RKO-LIO, MOLA, GLIM."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .setting_texts import json_text, place_and_quaternion, plain_yaml, quaternion_and_place
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
from .stack_names import FIX, IMU, SCAN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .rig_facts import RigFacts

_RKO = 'PRBonn/rko_lio'
_RKO_BASE = (_RKO, '053efd5a46dd', 'rko_lio/ros/base_node.cpp')
_RKO_TIMES = (_RKO, '2250832d5b20', 'rko_lio/core/process_timestamps.cpp')
_RKO_CLOUDS = (_RKO, '534e0cab2559', 'rko_lio/ros/utils/point_cloud_read.cpp')
_MOLA = ('MOLAorg/mola_lidar_odometry', '0cf373c4eaeb')
_MOLA_SYSTEM = (*_MOLA, 'mola-cli-launchs/lidar_odometry_ros2.yaml')
_MRPT_CLOUDS = ('MRPT/mrpt', '0ef46b98a471', 'libs/ros2bridge/src/point_cloud2.cpp')
_GLIM = 'koide3/glim'
_GLIM_ROS = ('koide3/glim_ros2', '13a6bcb26e17', 'src/glim_ros/rviz_viewer.cpp')


def _rko_lio(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'imu_topic': IMU,
        'lidar_topic': SCAN,
        'base_frame': 'base_link',
        'imu_frame': 'imu_link',
        'lidar_frame': 'velo_link',
        'odom_frame': 'odom',
        'odom_topic': 'rko_lio/odom',
        'extrinsic_imu2base_quat_xyzw_xyz': quaternion_and_place(rig.base_T_imu),
        'extrinsic_lidar2base_quat_xyzw_xyz': quaternion_and_place(rig.base_T_velo),
        'deskew': True,
        'voxel_size': 1.0,
        'max_range': min(100.0, rig.most_range),
        'min_range': 1.0,
        'initialization_phase': False,
    }
    return {'rko_lio.yaml': plain_yaml(values)}


def _glim(rig: RigFacts) -> Mapping[str, str]:
    ros = {
        'enable_local_mapping': True,
        'enable_global_mapping': True,
        'keep_raw_points': False,
        'imu_time_offset': 0.0,
        'acc_scale': 1.0,
        'extension_modules': ['librviz_viewer.so'],
        'imu_topic': '/os_cloud_node/imu',
        'points_topic': '/os_cloud_node/points',
        'image_topic': '/image',
    }
    viewer = {
        'imu_frame_id': 'imu_link',
        'lidar_frame_id': 'velo_link',
        'base_frame_id': 'base_link',
        'odom_frame_id': 'odom',
        'map_frame_id': 'map',
        'publish_imu2lidar': False,
    }
    sensors = {
        'T_lidar_imu': place_and_quaternion(rig.velo_T_imu),
        'imu_acc_noise': 0.05,
        'imu_gyro_noise': 0.02,
        'imu_int_noise': 0.001,
    }
    return {
        'config_ros.json': json_text({'glim_ros': {**ros, **viewer}}),
        'config_sensors.json': json_text({'sensors': sensors}),
    }


RKO_LIO = Stack(
    name='rko_lio',
    title='RKO-LIO, University of Bonn',
    what='lidar-IMU odometry',
    version='053efd5',
    points='x y z + time',
    imu='yes',
    demands=(
        Demand('cloud', 'PointCloud2 on the topic of lidar_topic, which has no default',
               Citation(*_RKO_BASE, 68)),
        Demand('imu', 'Imu on the topic of imu_topic, which has no default',
               Citation(*_RKO_BASE, 67)),
        Demand('qos', 'its subscriptions are best effort, so any publisher matches',
               Citation(_RKO, '2250832d5b20', 'rko_lio/ros/online_node.cpp', 43)),
        Demand('time-field', 'one field t, timestamp, time or stamps', Citation(*_RKO_CLOUDS, 62)),
        Demand('time-span', 'times that span more than 100 are nanoseconds, others seconds',
               Citation(*_RKO_TIMES, 59)),
        Demand('time-start', 'relative times: the first within 1 ms of 0, or the last within 10 ms',
               Citation(*_RKO_TIMES, 91)),
        Demand('imu-covers', 'a scan waits for an Imu after its last point',
               Citation(_RKO, '2250832d5b20', 'rko_lio/ros/threaded_node.cpp', 52)),
        Demand('static-frame', 'imu_frame and lidar_frame to base_frame are in /tf_static',
               Citation(*_RKO_BASE, 221)),
        Demand('one-parent', 'it publishes odom -> base_frame on /tf',
               Citation(_RKO, '053efd5a46dd', 'launch/odometry.launch.py', symbol='odom_frame')),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN, IMU),
    moving=(('odom', 'base_link'),),
    publishes=('/rko_lio/odom',),
    result=Result(('/rko_lio/odom',), '/rko_lio/odom'),
    launch=(
        Included(
            'rko_lio',
            'launch/odometry.launch.py',
            {'mode': 'online', 'config_file': '{dir}/rko_lio.yaml', 'rviz': 'false'},
        ),
    ),
    start=f'ros2 launch rko_lio odometry.launch.py imu_topic:={IMU} lidar_topic:={SCAN}'
    ' base_frame:=base_link',
    settings_files=_rko_lio,
    notes=(
        'extrinsic_X2base are base_T_X: qx qy qz qw x y z. Without them it asks /tf_static.',
        'initialization_phase takes the first Imu as at rest; most drives begin in motion.',
    ),
)  # fmt: skip
MOLA = Stack(
    name='mola',
    title='MOLA-LO, University of Almería',
    what='lidar-IMU odometry',
    version='0cf373c',
    points='x y z + time',
    imu='optional',
    demands=(
        Demand('cloud', 'PointCloud2 on the topic of lidar_topic_name, which has no default',
               Citation(*_MOLA_SYSTEM, 138)),
        Demand('imu', 'Imu on /imu', Citation(*_MOLA_SYSTEM, 161)),
        Demand('fix', 'NavSatFix on /gps', Citation(*_MOLA_SYSTEM, 146)),
        Demand('field-types', 'x, y, z, intensity, time are float32 or float64, ring is uint16 or'
               ' uint8; another type refuses the cloud', Citation(*_MRPT_CLOUDS, 32)),
        Demand('time-field', 'the field time', Citation(*_MRPT_CLOUDS, symbol='fromROS')),
        Demand('time-span', 'times that span more than 1e5 are nanoseconds, others seconds',
               Citation('MOLAorg/mola', '0c8e695af35a', 'mola_bridge_ros2/src/BridgeROS2.cpp',
                      symbol='callbackOnPointCloud2')),
        Demand('static-frame', 'base_link to the frames of cloud and Imu are in /tf_static',
               Citation('MOLAorg/mola', '0c8e695af35a', 'mola_bridge_ros2/src/BridgeROS2.cpp',
                      symbol='callbackOnPointCloud2')),
        Demand('one-parent', 'it publishes map -> base_link on /tf', Citation(*_MOLA_SYSTEM, 95)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN, IMU, FIX),
    moving=(('map', 'base_link'),),
    publishes=('/tf',),
    result=Result(tf=('map', 'base_link')),
    launch=(
        Included(
            'mola_lidar_odometry',
            'ros2-launchs/ros2-lidar-odometry.launch.py',
            {
                'lidar_topic_name': SCAN,
                'imu_topic_name': '/imu',
                'gnss_topic_name': '/gps',
                'publish_localization_following_rep105': 'False',
                'use_rviz': 'False',
                'use_mola_gui': 'False',
            },
            {'MOLA_TF_FOOTPRINT_LINK': ''},
        ),
    ),
    start=f"MOLA_TF_FOOTPRINT_LINK='' ros2 launch mola_lidar_odometry ros2-lidar-odometry.launch.py"
    f' lidar_topic_name:={SCAN} publish_localization_following_rep105:=False',
    notes=(
        ('By default it gives base_link the parent base_footprint (line 72); an empty'
        ' MOLA_TF_FOOTPRINT_LINK keeps it from that.'),
        'By default it publishes map -> odom and expects odom -> base_link of another node.',
        'Its launch file takes arguments only; it has no file of parameters.',
    ),
)  # fmt: skip
GLIM = Stack(
    name='glim',
    title='GLIM, AIST',
    what='lidar-IMU SLAM',
    version='1f07929',
    points='x y z + time',
    imu='100 Hz',
    demands=(
        Demand('cloud', 'PointCloud2 on /os_cloud_node/points',
               Citation(_GLIM, '08cb600397bc', 'config/config_ros.json', 20)),
        Demand('imu', 'Imu on /os_cloud_node/imu',
               Citation(_GLIM, '08cb600397bc', 'config/config_ros.json', 19)),
        Demand('qos', 'its subscriptions are best effort, so any publisher matches',
               Citation('koide3/glim_ros2', '5eab847b5e04', 'src/glim_ros/glim_ros.cpp',
                      symbol='SensorDataQoS')),
        Demand('time-field', 'one field t, time, time_stamp or timestamp; uint32 is nanoseconds,'
               ' floats are seconds',
               Citation(_GLIM, '1f07929a6a23', 'include/glim/util/ros_cloud_converter.hpp', 87)),
        Demand('time-start', 'times begin at 0: negative ones shift the stamp of the scan',
               Citation(_GLIM, '01d46b6e4d1d', 'src/glim/util/time_keeper.cpp', 111)),
        Demand('imu-rate', 'Imu messages are at most 0.1 s apart',
               Citation(_GLIM, '01d46b6e4d1d', 'src/glim/util/time_keeper.cpp', 51),
               of_option='imu_from'),
        Demand('one-parent', 'it publishes map -> odom -> base_frame_id, and imu -> lidar, on /tf',
               Citation(*_GLIM_ROS, 21)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN, IMU),
    imu_hz=100.0,
    moving=(('map', 'odom'), ('odom', 'base_link')),
    publishes=('/glim_ros/odom', '/glim_ros/pose', '/glim_ros/points', '/glim_ros/map'),
    result=Result(('/glim_ros/odom',), '/glim_ros/odom'),
    launch=(
        Node('glim_ros', 'glim_rosnode', 'glim_ros', values={'config_path': '{dir}'},
             parameters=False),
    ),
    start='ros2 run glim_ros glim_rosnode --ros-args -p use_sim_time:=true'
    ' -p config_path:=$(realpath DIR)',
    settings_files=_glim,
    notes=(
        'T_lidar_imu is velo_T_imu: x y z qx qy qz qw.',
        ('Its configuration is a folder; copy the other files beside those of --config:'
        ' cp -n $(ros2 pkg prefix --share glim)/config/*.json DIR'),
        ('Without base_frame_id it moves imu_link, and publish_imu2lidar moves velo_link; both have'
        ' parents already.'),
    ),
)  # fmt: skip
