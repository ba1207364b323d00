# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of other distributions are read where they have what is read of them."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.messages.cdr import lacking_field
from kitti_ros2.messages.ros_types import TYPESTORE

READ = (
    'sensor_msgs/msg/PointCloud2',
    'sensor_msgs/msg/Image',
    'sensor_msgs/msg/CompressedImage',
    'sensor_msgs/msg/CameraInfo',
    'sensor_msgs/msg/Imu',
    'sensor_msgs/msg/NavSatFix',
    'geometry_msgs/msg/TwistStamped',
    'nav_msgs/msg/Odometry',
    'nav_msgs/msg/Path',
    'visualization_msgs/msg/MarkerArray',
)


@pytest.mark.parametrize('store', [each for each in Stores if each.name.startswith('ROS2_')])
@pytest.mark.parametrize('msgtype', READ)
def test_every_distribution_has_what_is_read(store, msgtype):
    assert lacking_field(get_typestore(store), msgtype) == ''


@pytest.mark.parametrize('msgtype', sorted(TYPESTORE.fielddefs))
def test_nothing_lacks_of_our_own(msgtype):
    assert lacking_field(TYPESTORE, msgtype) == ''


TIME = 'MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'


@pytest.mark.parametrize(
    ('text', 'lacking'),
    [
        ('std_msgs/Header header\nstring format\nuint8[] data\nuint8 more', ''),
        ('std_msgs/Header header\nstring format\nint8[] data', ''),
        ('std_msgs/Header header\nuint8[] data', 'format'),
        ('std_msgs/Header header\nuint8 format\nuint8[] data', 'format'),
        ('std_msgs/Header header\nstring format\nuint8[4] data', 'data'),
        ('std_msgs/Header header\nstring format\nstring[] data', 'data'),
        ('std_msgs/Header[] header\nstring format\nuint8[] data', 'header'),
        ('string format\nuint8[] data', 'header'),
    ],
)
def test_the_first_field_that_lacks_is_named(text, lacking):
    store = get_typestore(Stores.EMPTY)
    rule = '=' * 80 + '\n'
    text = f'{text}\n{rule}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
    types = get_types_from_msg(f'{text}{rule}{TIME}', 'sensor_msgs/msg/CompressedImage')
    store.register({name: each for name, each in types.items() if name not in store.fielddefs})
    assert lacking_field(store, 'sensor_msgs/msg/CompressedImage') == lacking


def test_a_field_within_is_named_by_its_way():
    store = get_typestore(Stores.EMPTY)
    known = {name: TYPESTORE.fielddefs[name] for name in TYPESTORE.fielddefs}
    constants, fields = known['geometry_msgs/msg/Vector3']
    known['geometry_msgs/msg/Vector3'] = (constants, fields[:2])
    store.register({name: each for name, each in known.items() if name not in store.fielddefs})
    assert lacking_field(store, 'sensor_msgs/msg/Imu') == 'angular_velocity.z'


POINT = 'MSG: vision_msgs/Point2D\nfloat64 x\nfloat64 y\n'


@pytest.mark.parametrize(
    ('center', 'lacking'),
    [
        (f'vision_msgs/Point2D position\nfloat64 theta\n={POINT}', ''),
        ('float64 x\nfloat64 y\nfloat64 theta\n', ''),
        ('float64 x\nfloat64 theta\n', 'center.position.x'),
        (f'vision_msgs/Point2D place\nfloat64 theta\n={POINT}', 'center.position.x'),
        (f'vision_msgs/Point2D position\n={POINT}', 'center.position.x'),
        ('string x\nfloat64 y\nfloat64 theta\n', 'center.position.x'),
        ('float64 position\nfloat64 theta\n', 'center.position.x'),
    ],
)
def test_a_box_has_the_center_of_one_version(center, lacking):
    store = get_typestore(Stores.EMPTY)
    rule = '=' * 80 + '\n'
    text = 'vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n'
    text += f'{rule}MSG: vision_msgs/Pose2D\n' + center.replace('=', rule)
    store.register(get_types_from_msg(text, 'vision_msgs/msg/BoundingBox2D'))
    assert lacking_field(store, 'vision_msgs/msg/BoundingBox2D') == lacking
