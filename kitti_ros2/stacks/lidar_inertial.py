# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stacks that take scanner and Imu, with the extrinsics from /tf_static or from a file."""

from __future__ import annotations

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
    Stack,
    json_text,
    numbers,
    place_and_quaternion,
    plain_yaml,
    quaternion_and_place,
    ros_parameters,
)
from .stack_names import FIX, IMU, SCAN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .stack import RigFacts


# Stacks that take scanner and Imu, and the extrinsics from /tf_static: RKO-LIO, MOLA, GLIM.


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


# Stacks that take scanner and Imu, and the extrinsics from a file: LIO-SAM, FAST-LIO2, DLIO.


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
