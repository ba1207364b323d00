# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The checker of each stack: a check for each of its demands.

The demands, with the file and the line that each is from, are in kitti_ros2/options/stacks.
"""

from __future__ import annotations

import numpy as np
from checks import (
    a_turn,
    begins_at_0,
    cloud_on,
    encodings,
    every,
    fields,
    images_on,
    imu_covers,
    infos_on,
    is_type,
    last_is_the_end,
    near_stamps,
    of_clouds,
    one_frame,
    one_parent,
    one_time,
    pose_at_stamp,
    reliable,
    same_stamps,
    static_frames,
    stereo_pair,
    times,
    velodyne,
    xyz,
)
from seen import FLOAT32, FLOAT64, UINT8, UINT16, UINT32, stamp_ns

from kitti_ros2.model.bag_formats import COMPRESSED, DETECTIONS_3D, FIX, IMU

TWIST_COVARIANCE = 'geometry_msgs/msg/TwistWithCovarianceStamped'
OWN_SCAN, OWN_IMU = '/kitti/velo/points', '/kitti/oxts/imu'
TOP = '/sensing/lidar/top/pointcloud_raw_ex'
CAMERA = '/kitti/camera_color_left'
NAMED = ('t', 'time', 'timestamp', 'stamps', 'time_stamp')
XYZIRCAEDT = {
    'x': (FLOAT32, 0),
    'y': (FLOAT32, 4),
    'z': (FLOAT32, 8),
    'intensity': (UINT8, 12),
    'return_type': (UINT8, 13),
    'channel': (UINT16, 14),
    'azimuth': (FLOAT32, 16),
    'elevation': (FLOAT32, 20),
    'distance': (FLOAT32, 24),
    'time_stamp': (UINT32, 28),
}


def imu_rate(topic):
    def check(seen):
        stamps = [stamp_ns(each) for each in seen.messages.get(topic, [])]
        return [] if len(stamps) > 1 and np.median(np.diff(stamps)) < 2e7 else ['too slow']

    return check


def unit_quaternions(seen):
    turns = [each.orientation for each in seen.messages['/imu/data']]
    norms = [np.hypot(np.hypot(each.x, each.y), np.hypot(each.z, each.w)) for each in turns]
    return [] if np.allclose(norms, 1.0, atol=1e-6) else ['not of norm 1']


def dense(cloud):
    values = [cloud.points[name] for name in ('x', 'y', 'z', 'time')]
    finite = all(np.isfinite(each).all() for each in values)
    return '' if cloud.message.is_dense and finite else 'NaN, or is_dense is false'


def rings(cloud):
    found = cloud.points['ring']
    return '' if found.max() < 64 else f'ring {found.max()}'


def without_t(cloud):
    return '' if {'t', 'timestamp'}.isdisjoint(cloud.fields) else 'a time of other drivers'


def seconds(cloud):
    return '' if 0 <= cloud.points['time'].max() < 1 else 'not seconds'


def whole_nanoseconds(cloud):
    found = [name for name in ('t', 'timestamp', 'time') if name in cloud.fields]
    if len(found) != 1 or cloud.fields[found[0]][0] != UINT32:
        return f'fields {list(cloud.fields)}'
    return '' if 8e7 < cloud.points[found[0]].max() < 1.2e8 else 'not nanoseconds'


def in_view(cloud):
    """The parameter file has the elevations of the drive; those of KITTI reach 6.6 degrees."""
    x, y, z = (cloud.points[name].astype(np.float64) for name in 'xyz')
    up = np.degrees(np.arctan2(z, np.hypot(x, y)))
    up = up[np.isfinite(up)]
    return '' if up.min() >= -25.8 and up.max() <= 8.0 else f'{up.min():.1f} to {up.max():.1f} deg'


def types_of_mrpt(cloud):
    kinds = dict.fromkeys(('x', 'y', 'z', 'intensity', 'time'), (FLOAT32, FLOAT64))
    for name, allowed in {**kinds, 'ring': (UINT16, UINT8)}.items():
        if name in cloud.fields and cloud.fields[name][0] not in allowed:
            return f'{name} is of type {cloud.fields[name][0]}'
    return ''


def rising_azimuth(cloud):
    """By less than half a turn; the synthetic scans have columns of more than a degree."""
    azimuth, channel = (cloud.points[name] for name in ('azimuth', 'channel'))
    steps = np.concatenate([np.diff(azimuth[channel == each]) for each in np.unique(channel)])
    rises = (steps.astype(np.float64) % (2 * np.pi) < np.pi).mean()
    return '' if rises > 0.9 else f'azimuth rises between {rises:.0%} of the neighbours'


def exact_type(cloud):
    right = cloud.fields == XYZIRCAEDT and list(cloud.fields) == list(XYZIRCAEDT)
    return '' if right and cloud.message.point_step == 32 else f'fields {cloud.fields}'


def imu_variances(seen):
    kinds = ('orientation_covariance', 'angular_velocity_covariance')
    found = [getattr(each, kind)[i] for each in seen.messages[OWN_IMU] for kind in kinds
             for i in (0, 4, 8)]  # fmt: skip
    return [] if min(found) > 1e-9 else ['variances of 0']


def some_topic_is(msgtype):
    return lambda seen: [] if msgtype in seen.types.values() else [f'no {msgtype}']


def frames_of_their_own(seen):
    left, right = (seen.messages[f'/visual_slam/camera_info_{i}'][0] for i in (0, 1))
    return [] if left.header.frame_id != right.header.frame_id else ['one frame for both cameras']


def rectified(seen):
    infos = [each for side in ('left', 'right')
             for each in seen.messages[f'/kitti/camera_gray_{side}/camera_info']]  # fmt: skip
    flat = all(not np.any(each.d) and np.array_equal(each.r, np.eye(3).ravel()) for each in infos)
    return [] if infos and flat else ['distortion or rotation']


def have_results(seen):
    found = [each for message in seen.messages['/kitti/labels/detections']
             for each in message.detections]  # fmt: skip
    named = all(each.results and each.results[0].hypothesis.class_id for each in found)
    return [] if found and named else ['a detection without a result']


def in_the_frame_of_the_array(seen):
    faults = [
        each.header.frame_id
        for message in seen.messages['/kitti/labels/detections']
        for each in message.detections
        if each.header.frame_id not in {'', message.header.frame_id}
    ]
    return [f'a box in {faults[0]}'] if faults else []


def shown_images(seen):
    right = COMPRESSED in seen.types.values()
    return infos_on(f'{CAMERA}/camera_info')(seen) + ([] if right else ['no CompressedImage'])


CHECKERS = {
    'kiss-icp': {
        'cloud': cloud_on(OWN_SCAN),
        'qos': reliable(OWN_SCAN),
        'xyz': xyz(OWN_SCAN),
        'time-field': one_time(OWN_SCAN, ('t', 'timestamp', 'time'), UINT32, FLOAT32, FLOAT64),
        'time-span': times(OWN_SCAN, a_turn, 'times do not differ'),
        'static-frame': static_frames('base_link', OWN_SCAN),
        'one-parent': one_parent(('odom_lidar', 'base_link')),
    },
    'genz-icp': {
        'cloud': cloud_on(OWN_SCAN),
        'qos': reliable(OWN_SCAN),
        'xyz': xyz(OWN_SCAN),
        'time-field': one_time(OWN_SCAN, ('t', 'timestamp', 'time'), UINT32, FLOAT32, FLOAT64),
        'time-span': times(OWN_SCAN, a_turn, 'times do not differ'),
        'one-parent': one_parent(('odom', 'base_link')),
    },
    'rko_lio': {
        'cloud': cloud_on(OWN_SCAN),
        'imu': is_type(OWN_IMU, IMU),
        'qos': reliable(OWN_SCAN, OWN_IMU),
        'time-field': one_time(OWN_SCAN, NAMED[:4], UINT32, FLOAT32, FLOAT64),
        'time-span': times(OWN_SCAN, a_turn, 'neither seconds nor nanoseconds'),
        'time-start': times(OWN_SCAN, begins_at_0, 'times do not begin at 0'),
        'imu-covers': imu_covers(OWN_SCAN, OWN_IMU),
        'static-frame': static_frames('base_link', OWN_SCAN, OWN_IMU),
        'one-parent': one_parent(('odom', 'base_link')),
    },
    'mola': {
        'cloud': cloud_on(OWN_SCAN),
        'imu': is_type('/imu', IMU),
        'fix': is_type('/gps', FIX),
        'field-types': of_clouds(OWN_SCAN, types_of_mrpt),
        'time-field': one_time(OWN_SCAN, ('time',), FLOAT32, FLOAT64),
        'time-span': times(OWN_SCAN, a_turn, 'neither seconds nor nanoseconds'),
        'static-frame': static_frames('base_link', OWN_SCAN, '/imu'),
        'one-parent': one_parent(('map', 'base_link')),
    },
    'lio-sam': {
        'cloud': cloud_on('/points'),
        'imu': is_type('/imu/data', IMU),
        'qos': reliable('/points', '/imu/data'),
        'velodyne': velodyne('/points'),
        'dense': of_clouds('/points', dense),
        'ring': of_clouds('/points', rings),
        'time-order': times('/points', last_is_the_end, 'the last point is not the end'),
        'imu-covers': imu_covers('/points', '/imu/data'),
        'imu-rate': imu_rate('/imu/data'),
        'orientation': unit_quaternions,
        'one-parent': one_parent(('map', 'odom'), ('odom', 'base_link')),
    },
    'fast-lio2': {
        'cloud': cloud_on('/velodyne_points'),
        'imu': is_type('/imu/data', IMU),
        'qos': reliable('/velodyne_points', '/imu/data'),
        'velodyne': velodyne('/velodyne_points'),
        'time-unit': of_clouds('/velodyne_points', seconds),
        'time-order': times('/velodyne_points', last_is_the_end, 'the last point is not the end'),
        'imu-covers': imu_covers('/velodyne_points', '/imu/data'),
        'imu-rate': imu_rate('/imu/data'),
        'one-parent': one_parent(('camera_init', 'body')),
    },
    'dlio': {
        'cloud': cloud_on('/points'),
        'imu': is_type('/imu', IMU),
        'qos': reliable('/points', '/imu'),
        'velodyne-time': every(
            fields('/points', x=FLOAT32, y=FLOAT32, z=FLOAT32, intensity=FLOAT32, time=FLOAT32),
            of_clouds('/points', without_t),
        ),
        'imu-covers': imu_covers('/points', '/imu'),
        'imu-rate': imu_rate('/imu'),
        'one-parent': one_parent(
            ('odom', 'base_link'), ('base_link', 'lidar'), ('base_link', 'imu')
        ),
    },
    'glim': {
        'cloud': cloud_on('/os_cloud_node/points'),
        'imu': is_type('/os_cloud_node/imu', IMU),
        'qos': reliable('/os_cloud_node/points', '/os_cloud_node/imu'),
        'time-field': one_time('/os_cloud_node/points', NAMED, UINT32, FLOAT32, FLOAT64),
        'time-start': times('/os_cloud_node/points', begins_at_0, 'times do not begin at 0'),
        'imu-rate': imu_rate('/os_cloud_node/imu'),
        'one-parent': one_parent(('map', 'odom'), ('odom', 'base_link')),
    },
    'rtabmap-lidar': {
        'cloud': every(cloud_on('/velodyne_points'), reliable('/velodyne_points')),
        'xyz': xyz('/velodyne_points'),
        'time-field': one_time('/velodyne_points', NAMED[:4], UINT32, FLOAT32),
        'time-order': times('/velodyne_points', last_is_the_end, 'not in order of time'),
        'static-frame': static_frames('base_link', '/velodyne_points'),
        'one-parent': one_parent(('new_map', 'icp_odom'), ('icp_odom', 'base_link')),
    },
    'rtabmap-stereo': {
        'images': every(
            images_on('/stereo_camera/left/image_rect_color', '/stereo_camera/right/image_rect'),
            infos_on('/stereo_camera/left/camera_info', '/stereo_camera/right/camera_info'),
        ),
        'same-stamp': same_stamps(
            '/stereo_camera/left/image_rect_color',
            '/stereo_camera/right/image_rect',
            '/stereo_camera/left/camera_info',
            '/stereo_camera/right/camera_info',
        ),
        'baseline': stereo_pair(
            '/stereo_camera/left/camera_info', '/stereo_camera/right/camera_info'
        ),
        'static-frame': static_frames('base_link', '/stereo_camera/left/image_rect_color'),
        'one-parent': one_parent(('map', 'odom'), ('odom', 'base_link')),
    },
    'stereo_image_proc': {
        'images': every(
            images_on('/left/image_rect', '/right/image_rect'),
            infos_on('/left/camera_info', '/right/camera_info'),
        ),
        'qos': reliable('/left/image_rect', '/right/image_rect'),
        'same-stamp': same_stamps(
            '/left/image_rect', '/right/image_rect', '/left/camera_info', '/right/camera_info'
        ),
        'encoding': encodings(
            'mono8', 'bgr8', 'rgb8', topics=('/left/image_rect', '/right/image_rect')
        ),
        'baseline': stereo_pair('/left/camera_info', '/right/camera_info'),
        'one-frame': one_frame('/left/camera_info', '/right/camera_info'),
    },
    'cuvslam': {
        'images': every(
            images_on('/visual_slam/image_0', '/visual_slam/image_1'),
            infos_on('/visual_slam/camera_info_0', '/visual_slam/camera_info_1'),
        ),
        'qos': reliable('/visual_slam/image_0', '/visual_slam/image_1'),
        'same-stamp': near_stamps(5e6, '/visual_slam/image_0', '/visual_slam/image_1'),
        'encoding': encodings('rgb8', topics=('/visual_slam/image_0', '/visual_slam/image_1')),
        'own-frames': frames_of_their_own,
        'one-parent': one_parent(('map', 'odom'), ('odom', 'base_link')),
    },
    'orb-slam3': {
        'images': images_on('/camera/left', '/camera/right'),
        'same-stamp': near_stamps(5e7, '/camera/left', '/camera/right'),
        'rectified': rectified,
    },
    'robot_localization': {
        'imu': is_type(OWN_IMU, IMU),
        'twist': is_type('/kitti/oxts/vel_with_covariance', TWIST_COVARIANCE),
        'covariance': imu_variances,
        'static-frame': static_frames('base_link', OWN_IMU),
        'one-parent': one_parent(('odom', 'base_link')),
    },
    'octomap': {
        'cloud': cloud_on('/cloud_in'),
        'qos': reliable('/cloud_in'),
        'xyz': xyz('/cloud_in'),
        'pose-at-stamp': pose_at_stamp('map', '/cloud_in'),
    },
    'nvblox': {
        'cloud': cloud_on('/pointcloud'),
        'xyz': xyz('/pointcloud'),
        'time-integer': of_clouds('/pointcloud', whole_nanoseconds),
        'field-of-view': of_clouds('/pointcloud', in_view),
        'pose-at-stamp': pose_at_stamp('odom', '/pointcloud'),
    },
    'autoware': {
        'cloud': cloud_on(TOP),
        'point-type': of_clouds(TOP, exact_type),
        'point-type-exact': of_clouds(TOP, exact_type),
        'azimuth': of_clouds(TOP, rising_azimuth),
        'imu': is_type('/sensing/imu/tamagawa/imu_raw', IMU),
        'fix': is_type('/sensing/gnss/ublox/nav_sat_fix', FIX),
        'twist': is_type(
            '/sensing/vehicle_velocity_converter/twist_with_covariance', TWIST_COVARIANCE
        ),
        'objects': some_topic_is('autoware_perception_msgs/msg/DetectedObjects'),
        'static-frame': static_frames('base_link', TOP),
    },
    'ultralytics_ros': {
        'images': images_on(f'{CAMERA}/image_raw'),
        'info': infos_on(f'{CAMERA}/camera_info'),
        'cloud': every(cloud_on('/kitti/velo/pointcloud'), xyz('/kitti/velo/pointcloud')),
        'encoding': encodings('mono8', 'bgr8', 'rgb8', topics=[f'{CAMERA}/image_raw']),
        'same-stamp': every(
            same_stamps(f'{CAMERA}/image_raw', f'{CAMERA}/camera_info'),
            near_stamps(5e7, f'{CAMERA}/image_raw', '/kitti/velo/pointcloud'),
        ),
        'static-frame': static_frames('base_link', f'{CAMERA}/image_raw', '/kitti/velo/pointcloud'),
    },
    'vision_msgs': {
        'boxes': is_type('/kitti/labels/detections', DETECTIONS_3D),
        'results': have_results,
        'box-frame': in_the_frame_of_the_array,
    },
    'foxglove': {
        'images': shown_images,
        'annotations': some_topic_is('foxglove_msgs/msg/ImageAnnotations'),
    },
}
"""By stack and key of demand: a function of what it sees that returns the faults."""
