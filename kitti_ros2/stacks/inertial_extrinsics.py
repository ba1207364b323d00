# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that take scanner and Imu, and the extrinsics from a file: LIO-SAM, FAST-LIO2, DLIO."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .setting_texts import numbers, ros_parameters
from .stack import (
    DEFAULT_NAMES,
    OWN_TREE,
    TIMED,
    Citation,
    Demand,
    Node,
    Result,
    Stack,
)
from .stack_names import IMU, SCAN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .rig_facts import RigFacts

_SAM = ('TixiaoShan/LIO-SAM', '041f4e63d5be')
_SAM_CLOUDS = (*_SAM, 'src/imageProjection.cpp')
_SAM_PARAMETERS = (*_SAM, 'include/lio_sam/utility.hpp')
_FAST = ('Ericsii/FAST_LIO_ROS2', '5a2baaa83fe8')
_FAST_NODE = ('Ericsii/FAST_LIO_ROS2', '007aeb7d0e84', 'src/laserMapping.cpp')
_DLIO = ('vectr-ucla/direct_lidar_inertial_odometry', '1637f88cf078', 'src/dlio/odom.cc')
_DLIO_LAUNCH = (
    'vectr-ucla/direct_lidar_inertial_odometry',
    '977094b61b0a',
    'launch/dlio.launch.py',
)


def _lio_sam(rig: RigFacts) -> Mapping[str, str]:
    velo_t_imu = rig.velo_T_imu
    values = {
        'pointCloudTopic': 'points',
        'imuTopic': 'imu/data',
        'odomTopic': 'odometry/imu',
        'gpsTopic': 'odometry/gpsz',
        'lidarFrame': 'velo_link',
        'baselinkFrame': 'base_link',
        'odometryFrame': 'odom',
        'mapFrame': 'map',
        'sensor': 'velodyne',
        'N_SCAN': rig.rings,
        'Horizon_SCAN': rig.columns,
        'downsampleRate': 1,
        'lidarMinRange': 1.0,
        'lidarMaxRange': rig.most_range,
        'imu_rate': rig.imu_hz,
        'imuAccNoise': 3.9939570888238808e-03,
        'imuGyrNoise': 1.5636343949698187e-03,
        'imuAccBiasN': 6.4356659353532566e-05,
        'imuGyrBiasN': 3.5640318696367613e-05,
        'imuGravity': 9.80511,
        'imuRPYWeight': 0.01,
        'extrinsicTrans': numbers(velo_t_imu.translation),
        'extrinsicRot': numbers(velo_t_imu.rotation),
        'extrinsicRPY': numbers(velo_t_imu.rotation.T),
        'odometrySurfLeafSize': 0.4,
        'mappingCornerLeafSize': 0.2,
        'mappingSurfLeafSize': 0.4,
    }
    return {'lio-sam.yaml': ros_parameters(values)}


def _fast_lio(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'feature_extract_enable': False,
        'point_filter_num': 4,
        'max_iteration': 3,
        'filter_size_surf': 0.5,
        'filter_size_map': 0.5,
        'cube_side_length': 1000.0,
        'common': {
            'lid_topic': '/velodyne_points',
            'imu_topic': '/imu/data',
            'time_sync_en': False,
            'time_offset_lidar_to_imu': 0.0,
        },
        'preprocess': {
            'lidar_type': 2,
            'scan_line': rig.rings,
            'scan_rate': round(rig.scan_hz),
            'timestamp_unit': 0,
            'blind': 2.0,
        },
        'mapping': {
            'acc_cov': 0.1,
            'gyr_cov': 0.1,
            'b_acc_cov': 0.0001,
            'b_gyr_cov': 0.0001,
            'fov_degree': 360.0,
            'det_range': 100.0,
            'extrinsic_est_en': False,
            'extrinsic_T': numbers(rig.imu_T_velo.translation),
            'extrinsic_R': numbers(rig.imu_T_velo.rotation),
        },
        'publish': {
            'path_en': True,
            'scan_publish_en': True,
            'dense_publish_en': False,
            'scan_bodyframe_pub_en': False,
        },
        'pcd_save': {'pcd_save_en': False, 'interval': -1},
    }
    return {'fast-lio2.yaml': ros_parameters(values)}


def _dlio(rig: RigFacts) -> Mapping[str, str]:
    values = {
        'frames/odom': 'odom',
        'frames/baselink': 'base_link',
        'frames/lidar': 'lidar',
        'frames/imu': 'imu',
        'pointcloud/deskew': True,
        'pointcloud/voxelize': True,
        'imu/calibration': False,
        'odom/gravity': 9.80665,
        'extrinsics/baselink2imu/t': numbers(rig.base_T_imu.translation),
        'extrinsics/baselink2imu/R': numbers(rig.base_T_imu.rotation),
        'extrinsics/baselink2lidar/t': numbers(rig.base_T_velo.translation),
        'extrinsics/baselink2lidar/R': numbers(rig.base_T_velo.rotation),
    }
    return {'dlio.yaml': ros_parameters(values)}


LIO_SAM = Stack(
    name='lio-sam',
    title='LIO-SAM, MIT (branch ros2)',
    what='lidar-IMU SLAM',
    version='041f4e6',
    points='x y z i ring time',
    imu='100 Hz',
    demands=(
        Demand('cloud', 'PointCloud2 on points', Citation(*_SAM_PARAMETERS, 157)),
        Demand('imu', 'Imu on imu/data', Citation(*_SAM_PARAMETERS, 159)),
        Demand('qos', 'its subscriptions are best effort, so any publisher matches',
               Citation(*_SAM_CLOUDS, 113)),
        Demand('velodyne', 'x, y, z, intensity float32, ring uint16, time float32',
               Citation(*_SAM_CLOUDS, 14)),
        Demand('dense', 'is_dense is true: no point is NaN', Citation(*_SAM_CLOUDS, 272)),
        Demand('ring', 'a field ring', Citation(*_SAM_CLOUDS, 285)),
        Demand('time-order', "the end of the scan is the stamp plus the last point's time, seconds",
               Citation(*_SAM_CLOUDS, 265)),
        Demand('imu-covers', 'Imu messages before the start and after the end of the scan',
               Citation(*_SAM_CLOUDS, 327)),
        Demand('imu-rate', 'Imu at about imu_rate, 100 Hz by default',
               Citation(*_SAM_PARAMETERS, 222), of_option='imu_from'),
        Demand('orientation', 'the orientation of the Imu is a quaternion of norm 1',
               Citation(*_SAM_PARAMETERS, 339)),
        Demand('one-parent', 'it publishes odom -> baselinkFrame, and its launch file map -> odom',
               Citation(*_SAM_PARAMETERS, 168)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN, IMU),
    imu_hz=100.0,
    moving=(('map', 'odom'), ('odom', 'base_link')),
    publishes=('/lio_sam/mapping/odometry', '/lio_sam/mapping/path'),
    result=Result(('/lio_sam/mapping/odometry',), '/lio_sam/mapping/odometry', frame='velo_link'),
    launch=(
        Node('tf2_ros', 'static_transform_publisher', parameters=False,
             arguments=('--frame-id', 'map', '--child-frame-id', 'odom')),
        Node('lio_sam', 'lio_sam_imuPreintegration', 'lio_sam_imuPreintegration'),
        Node('lio_sam', 'lio_sam_imageProjection', 'lio_sam_imageProjection'),
        Node('lio_sam', 'lio_sam_featureExtraction', 'lio_sam_featureExtraction'),
        Node('lio_sam', 'lio_sam_mapOptimization', 'lio_sam_mapOptimization'),
    ),
    start='ros2 launch lio_sam run.launch.py params_file:=DIR/lio-sam.yaml',
    settings_files=_lio_sam,
    notes=(
        ('extrinsicRot and extrinsicTrans are velo_T_imu (utility.hpp:321), extrinsicRPY is the'
        ' inverse rotation (utility.hpp:333).'),
        ('Its run.launch.py also starts robot_state_publisher, whose frames collide with the'
        ' tree of the drive; the launch file of --config does not.'),
    ),
)  # fmt: skip
FAST_LIO2 = Stack(
    name='fast-lio2',
    title='FAST-LIO2, University of Hong Kong (port Ericsii/FAST_LIO_ROS2)',
    what='lidar-IMU odometry',
    version='5a2baaa',
    points='x y z i ring time',
    imu='100 Hz',
    demands=(
        Demand('cloud', 'PointCloud2 on /velodyne_points',
               Citation(*_FAST, 'config/velodyne.yaml', 13)),
        Demand('imu', 'Imu on /imu/data', Citation(*_FAST, 'config/velodyne.yaml', 14)),
        Demand('qos', 'its subscription is best effort, so any publisher matches',
               Citation(*_FAST_NODE, symbol='sub_pcl_pc_')),
        Demand('velodyne', 'x, y, z, intensity float32, time float32, ring uint16',
               Citation(*_FAST, 'src/preprocess.h', 78)),
        Demand('time-unit', 'with timestamp_unit 0 times are seconds; the file of the stack has 2,'
               ' microseconds', Citation(*_FAST, 'config/velodyne.yaml', 23)),
        Demand('time-order', "the last point's time is above 0, and ends the scan",
               Citation(*_FAST, 'src/preprocess.cpp', 215)),
        Demand('imu-covers', 'a scan waits for an Imu after its end',
               Citation(*_FAST_NODE, symbol='sync_packages')),
        Demand('imu-rate', 'several Imu messages per scan: the scan is deskewed between them',
               Citation('Ericsii/FAST_LIO_ROS2', '5a2baaa83fe8', 'src/IMU_Processing.hpp',
                      symbol='UndistortPcl'), of_option='imu_from'),
        Demand('one-parent', 'it publishes camera_init -> body on /tf: a tree of its own',
               Citation(*_FAST_NODE, symbol='publish_odometry')),
    ),
    settings=(DEFAULT_NAMES, TIMED),
    inputs=(SCAN, IMU),
    imu_hz=100.0,
    moving=(('camera_init', 'body'),),
    publishes=('/Odometry', '/path', '/cloud_registered'),
    result=Result(('/Odometry', '/path'), '/Odometry', frame='imu_link'),
    launch=(Node('fast_lio', 'fastlio_mapping', 'laser_mapping'),),
    start='ros2 launch fast_lio mapping.launch.py config_path:=$(realpath DIR)'
    ' config_file:=fast-lio2.yaml use_sim_time:=true',
    settings_files=_fast_lio,
    notes=(
        'extrinsic_R and extrinsic_T are imu_T_velo (laserMapping.cpp: offset_R_L_I * p + T).',
        'It takes the first Imu messages as at rest; most drives begin in motion.',
        'Odometry is that of the Imu at the end of the scan: body is imu_link.',
    ),
)  # fmt: skip
DLIO = Stack(
    name='dlio',
    title='Direct LiDAR-Inertial Odometry, UCLA (branch feature/ros2)',
    what='lidar-IMU odometry',
    version='1637f88',
    points='x y z i time',
    imu='100 Hz',
    demands=(
        Demand('cloud', 'PointCloud2 on points', Citation(*_DLIO_LAUNCH, 23)),
        Demand('imu', 'Imu on imu', Citation(*_DLIO_LAUNCH, 24)),
        Demand('qos', 'the subscription of clouds is reliable, depth 1: so must the publisher be',
               Citation(*_DLIO, 37)),
        Demand('velodyne-time', 'time of float32 is seconds from the stamp; without a field t,'
               ' which is read as that of an Ouster', Citation(*_DLIO, 514)),
        Demand('imu-covers', 'Imu messages until the last point',
               Citation(*_DLIO, symbol='deskewPointcloud')),
        Demand('imu-rate', 'several Imu messages per scan: the scan is deskewed between them',
               Citation(*_DLIO, symbol='deskewPointcloud'), of_option='imu_from'),
        Demand('one-parent', 'it publishes odom -> baselink -> lidar and imu on /tf',
               Citation(*_DLIO, 408)),
    ),
    settings=(DEFAULT_NAMES, TIMED, OWN_TREE),
    inputs=(SCAN, IMU),
    imu_hz=100.0,
    moving=(('odom', 'base_link'), ('base_link', 'lidar'), ('base_link', 'imu')),
    publishes=('/dlio/odom_node/odom', '/dlio/odom_node/pose', '/dlio/odom_node/path'),
    result=Result(('/dlio/odom_node/odom',), '/dlio/odom_node/odom'),
    launch=(
        Node('direct_lidar_inertial_odometry', 'dlio_odom_node', 'dlio_odom_node', {
            'pointcloud': '/points',
            'imu': '/imu',
            'odom': 'dlio/odom_node/odom',
            'pose': 'dlio/odom_node/pose',
            'path': 'dlio/odom_node/path',
            'kf_pose': 'dlio/odom_node/keyframes',
            'kf_cloud': 'dlio/odom_node/pointcloud/keyframe',
            'deskewed': 'dlio/odom_node/pointcloud/deskewed',
        }),
        Node('direct_lidar_inertial_odometry', 'dlio_map_node', 'dlio_map_node', {
            'keyframes': 'dlio/odom_node/pointcloud/keyframe',
        }),
    ),
    start='ros2 launch direct_lidar_inertial_odometry dlio.launch.py pointcloud_topic:=/points'
    ' imu_topic:=/imu',
    settings_files=_dlio,
    notes=(
        'baselink2imu and baselink2lidar are base_T_imu and base_T_velo.',
        'imu/calibration takes 3 s at rest (odom.cc:265); most drives begin in motion.',
        'Its frames are called lidar and imu: with the names of the drive they had two parents.',
    ),
)  # fmt: skip
