# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that Draco compressed, in the structures of point_cloud_transport and of others.

The first were made with libdraco 1.5.5 (speed 7, 14 bits where they are rounded) by the calls of
draco_point_cloud_transport's publisher: an attribute a field, and without duplicates.
"""

from __future__ import annotations

import sys
from base64 import b64decode, b64encode

import numpy as np
import pytest
from cloudini_encoder import Encoder

from kitti_ros2.messages.clouds import read_field, read_points
from kitti_ros2.messages.compressed_clouds import (
    OF_CLOUDS,
    decompress_cloud,
    decompress_packed_cloud,
    losses_of_cloud,
)
from kitti_ros2.messages.draco import read_draco_header
from kitti_ros2.messages.foxglove_fields import Fields, JsonFields
from kitti_ros2.messages.ros_types import TYPESTORE, Header, PointField, Time

ROWS = np.arange(6)
POINTS = np.zeros(
    6,
    [
        *((name, '<f4') for name in ('x', 'y', 'z', 'intensity')),
        *(('ring', '<u2'), ('byte', '|u1'), ('stamp', '<f8'), ('count', '<i4')),
    ],
)
POINTS['x'], POINTS['y'], POINTS['z'] = ROWS * 0.37 - 3, ROWS * 7 % 13, ROWS % 5 * 0.1
POINTS['intensity'], POINTS['ring'], POINTS['byte'] = ROWS / 100, ROWS, ROWS
POINTS['stamp'], POINTS['count'] = 1.7e9 + ROWS * 1e-4, -100003 * ROWS
POINTS[5] = POINTS[0]
XYZI = [*POINTS.dtype.names[:4]]

EXACT = b64decode(
    'RFJBQ08CAwAAAIAAAQtkZWR1cGxpY2F0ZQQBAAAAAAUAAAABBAAJAQAAAAkBAAEACQEAAgQJAQADAAAAAAAAQMDsUS'
    'jA16MQwIXr8b9cj8K/AAAAAAAA4EAAAIA/AAAAQQAAAEAAAAAAzczMPc3MTD6amZk+zczMPgAAAAAK1yM8CtejPI/C'
    '9TwK1yM9'
)
KD_TREE = b64decode(
    'RFJBQ08CAwABAIAAAQtkZWR1cGxpY2F0ZQQBAAAAAAUAAAABBAAJAQAAAAkBAAEACQEAAgQJAQADAw4AAAAFAAAA/w'
    'EzJAAAAPv//r+A/v//AAgAAv///1//AeD/ACAA+AAAAEAAAAAAAAAAAAQAAAAAAAAABAAAAAAAAEAAAEDApHC9Pw4A'
    'AAAAAAAAQQ4AAAAAzczMPg4AAAAACtcjPQ4='
)
ROUNDED = b64decode(
    'RFJBQ08CAwAAAIAAAQtkZWR1cGxpY2F0ZQQBAAAAAAUAAAABBAAJAQAAAAkBAAEACQEAAgQJAQADAgICAgABAQAPA8'
    '0MK80MaSYDJnCdAEAA0P8DgAAAAAD/PwAAAAEBAA8DzQwrmRmdGQO68LACoAAYAAVAAAAAAP8/AAAAAQEADwPNDCvN'
    'DGkmAyZwnQBAAND/A4AAAAAA/z8AAAABAQAPA80MK80MaSYDJnCdAEAA0P8DgAAAAAD/PwAAAABAwKRwvT8OAAAAAA'
    'AAAEEOAAAAAM3MzD4OAAAAAArXIz0O'
)
MANY_TYPES = b64decode(
    'RFJBQ08CAwAAAIAAAQtkZWR1cGxpY2F0ZQQBAAAAAAYAAAABCAAJAQAAAAkBAAEACQEAAgQJAQADBAQBAAQEAgEABQ'
    'QKAQAGBAUBAAcAAAAAAQEAAQAAQMDsUSjA16MQwIXr8b9cj8K/AABAwAAAAAAAAOBAAACAPwAAAEEAAABAAAAAAAAA'
    'AADNzMw9zcxMPpqZmT7NzMw+AAAAAAAAAAAK1yM8CtejPI/C9TwK1yM9AAAAAAABAQEBA60KA1U1A6OigwAAAAAEAA'
    'AAAAEBAQEDrQoDVTUDo6KDAAAAAAQAAAAAAABA/FTZQaMBAED8VNlBRwMAQPxU2UHqBABA/FTZQY4GAED8VNlBAAAA'
    'QPxU2UEAAQEAEwNVFT+tKgMQMIuKGi5quKjhooYDdOX5/wAAAAA='
)


def message(data, count, names=XYZI, **changes):
    """A CompressedPointCloud2 as Fields, with fields of POINTS in a point of its size."""
    kinds = {'<f4': 7, '<u2': 4, '|u1': 2, '<f8': 8, '<i4': 5}
    values = {
        'header': Header(Time(3, 4), 'velo'),
        'height': 1,
        'width': count,
        'fields': [
            PointField(name, POINTS.dtype.fields[name][1], kinds[POINTS.dtype[name].str], 1)
            for name in names
        ],
        'is_bigendian': False,
        'point_step': POINTS.itemsize,
        'row_step': POINTS.itemsize * count,
        'compressed_data': np.frombuffer(data, np.uint8),
        'is_dense': True,
        'format': 'draco',
    }
    made = TYPESTORE.types['point_cloud_interfaces/msg/CompressedPointCloud2']
    return Fields(made(**{**values, **changes}))


def decoded(fields):
    cloud = decompress_cloud(fields, 0)
    assert (cloud.header.stamp.sec, cloud.header.frame_id) == (3, 'velo')
    return cloud.data.view(POINTS.dtype)


needs_library = pytest.mark.usefixtures('draco')


@pytest.fixture
def draco():
    return pytest.importorskip('DracoPy')


@needs_library
@pytest.mark.parametrize('name', ['draco', ''])
def test_points_that_are_not_rounded_are_exact(name):
    fields = message(EXACT, 5, format=name)
    np.testing.assert_array_equal(decoded(fields)[XYZI], POINTS[:5][XYZI])
    assert losses_of_cloud(fields) == []


ROUNDING = 'compressed with loss by Draco, which rounded x y z intensity to 14 bits of their range'


@needs_library
@pytest.mark.parametrize(
    ('data', 'order'),
    [(ROUNDED, [0, 1, 2, 3, 4]), (KD_TREE, [3, 1, 4, 2, 0])],
    ids=['in order', 'KD-tree'],
)
def test_rounded_points_are_within_their_step_and_said_to_be_so(data, order):
    fields = message(data, 5)
    points = decoded(fields)
    rows = np.argsort(points['x'])
    for name in XYZI:
        step = np.ptp(POINTS[name]) / (2**14 - 1)
        assert np.abs(points[name][rows] - POINTS[name][:5]).max() < step
    is_sorted = order != sorted(order)
    assert (rows.tolist() == [0, 1, 2, 3, 4]) is not is_sorted
    more = ', and put the points in another order' if is_sorted else ''
    assert losses_of_cloud(fields) == [ROUNDING + more]


@needs_library
def test_values_that_the_library_gives_as_float32_are_named():
    fields = message(MANY_TYPES, 6, POINTS.dtype.names)
    points = decoded(fields)
    for name in POINTS.dtype.names:
        np.testing.assert_allclose(points[name], POINTS[name], rtol=1e-7, err_msg=name)
    assert losses_of_cloud(fields) == ['read with the precision of float32 in stamp count']


@needs_library
@pytest.mark.parametrize('names', [XYZI, ['intensity', 'x', 'y', 'z']], ids=['first', 'last'])
def test_positions_may_be_one_attribute_and_others_have_names(draco, names):
    xyz = np.column_stack([POINTS[name] for name in 'xyz'])
    named = {'intensity': POINTS['intensity'][:, None]}
    data = draco.encode(
        xyz,
        generic_attributes=named,
        quantization_bits=11,
        preserve_order=True,
        compression_level=0,
    )
    fields = message(data, 6, names)
    points = decoded(fields)
    np.testing.assert_array_equal(points['intensity'], POINTS['intensity'])
    assert np.abs(points['y'] - POINTS['y']).max() <= np.ptp(POINTS['y']) / 2**11
    [loss] = losses_of_cloud(fields)
    assert loss.endswith('rounded x y z to 11 bits of their range')


def foxglove(data, **pose):
    return JsonFields(
        {
            'timestamp': {'sec': 5, 'nsec': 6},
            'frame_id': 'lidar',
            'data': b64encode(data).decode(),
            'format': 'draco',
            **pose,
        }
    )


@needs_library
def test_clouds_of_foxglove_have_the_fields_that_their_data_name(draco):
    xyz = np.column_stack([POINTS[name] for name in 'xyz'])
    named = {'intensity': POINTS['intensity'][:, None], 'ring': POINTS['ring'][:, None]}
    data = draco.encode(xyz, generic_attributes=named, quantization_bits=16, preserve_order=True)
    quarter = {'orientation': {'z': np.sqrt(0.5), 'w': np.sqrt(0.5)}}
    pose = {'pose': {'position': {'x': 1.0, 'y': 2.0, 'z': 3.0}, **quarter}}
    moved = xyz @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [1, 2, 3]
    for fields, expected in ((foxglove(data), xyz), (foxglove(data, **pose), moved)):
        cloud = decompress_packed_cloud(fields, 0)
        assert (cloud.header.stamp.sec, cloud.header.frame_id, cloud.width) == (5, 'lidar', 6)
        assert [field.name for field in cloud.fields] == ['x', 'y', 'z', 'intensity', 'ring']
        np.testing.assert_allclose(read_points(cloud, None)[:, :3], expected, atol=1e-3)
        np.testing.assert_array_equal(read_field(cloud, 'ring'), POINTS['ring'])
    [loss] = OF_CLOUDS['CompressedPointCloud'].earlier_losses(foxglove(data))
    assert loss.endswith('rounded x y z to 16 bits of their range')


def test_clouds_of_foxglove_may_have_data_of_cloudini():
    """As pymcap-cli roscompress --pc-schema foxglove writes them, though the schema names Draco."""
    data = Encoder(steps=dict.fromkeys('xyz', 0.01)).encode(POINTS)
    cloud = decompress_packed_cloud(foxglove(data, format='cloudini'), 0)
    assert [field.name for field in cloud.fields] == [*POINTS.dtype.names]
    xyz = np.column_stack([POINTS[name] for name in 'xyz'])
    np.testing.assert_allclose(read_points(cloud, None)[:, :3], xyz, atol=0.0051)
    [loss] = OF_CLOUDS['CompressedPointCloud'].earlier_losses(foxglove(data))
    assert loss == 'compressed with loss by Cloudini, which rounded x y z to 0.01'


@pytest.mark.parametrize('data', [b'', b'CLOUDINI_V05', EXACT[:40]])
def test_clouds_of_foxglove_in_other_formats_are_refused(data):
    with pytest.raises(ValueError, match='its'):
        decompress_packed_cloud(foxglove(data), 0)


DAMAGES = {
    'no Draco': (message(b'DRAC' + bytes(20), 5), 'begin with'),
    'cut off': (message(EXACT[:30], 5), 'cut off'),
    'values cut off': (message(EXACT[:-9], 5), 'cannot be decoded'),
    'more points': (message(EXACT, 7), 'its points are 7, and 5 in its data'),
    'a field less': (message(EXACT, 5, XYZI[:3]), 'its fields are 3, and 4'),
    'short point': (message(EXACT, 5, point_step=14, row_step=70), 'beyond point_step'),
    'many points': (message(EXACT, 2**31, row_step=0), 'too many'),
    'a mesh': (message(EXACT.replace(b'\2\3\0\0', b'\2\2\1\1', 1), 5), 'are a mesh of Draco 2.2'),
}


@needs_library
@pytest.mark.parametrize(('fields', 'reason'), DAMAGES.values(), ids=DAMAGES)
def test_damaged_data_are_refused(fields, reason):
    with pytest.raises(ValueError, match=reason):
        decompress_cloud(fields, 0)


def test_any_beginning_is_refused_or_read():
    for data in (EXACT, KD_TREE, ROUNDED, MANY_TYPES):
        assert read_draco_header(data).count in {5, 6}
        for length in range(len(data)):
            try:
                read_draco_header(data[:length])
            except ValueError:
                assert length < 90


def test_a_missing_library_is_named_with_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, 'DracoPy', None)
    with pytest.raises(ValueError, match=r"pip install 'kitti_ros2\[clouds\]'"):
        decompress_cloud(message(EXACT, 5), 0)
