# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PointCloud2 in every shape that drivers give it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.messages.cdr import deserialize, join, make_header, serialize
from kitti_ros2.messages.clouds import decode_cloud, guess_intensity_scale
from kitti_ros2.messages.ros_types import PointCloud2, PointField
from kitti_ros2.messages.scan import encode_scan
from kitti_ros2.model.bag_formats import Points
from kitti_ros2.model.samples import Scan

KINDS = ['i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8']
FLOATS = ['f4', 'f8']
INTENSITIES = ['intensity', 'reflectivity', 'reflectance', 'i']


def make_cloud(columns, shape=None, *, big=False, padding=(0, 0), spread=0):
    """A cloud of columns (name, kind, values), in that order.

    padding is of bytes after each point and each row, spread of bytes before each field.
    """
    count = len(columns[0][2]) if columns else 0
    height, width = shape or (1, count)
    order = '>' if big else '<'
    offsets, end = [], 0
    for _, kind, _ in columns:
        offsets.append(end + spread)
        end = offsets[-1] + np.dtype(kind).itemsize
    step = end + padding[0]
    rows = np.full((height, width * step + padding[1]), 0xA5, dtype=np.uint8)
    points = np.full((height, width, step), 0xA5, dtype=np.uint8)
    for (_, kind, values), offset in zip(columns, offsets, strict=True):
        data = np.asarray(values).astype(order + kind).reshape(height, width)
        size = data.itemsize
        points[..., offset : offset + size] = data.view(np.uint8).reshape(height, width, size)
    rows[:, : width * step] = points.reshape(height, width * step)
    return PointCloud2(
        header=make_header(1, 'lidar'),
        height=height,
        width=width,
        fields=[
            PointField(name, offset, KINDS.index(kind) + 1, 1)
            for (name, kind, _), offset in zip(columns, offsets, strict=True)
        ],
        is_bigendian=big,
        point_step=step,
        row_step=rows.shape[1],
        data=rows.reshape(-1),
        is_dense=True,
    )


def xyz(points, kind='f4'):
    return [(name, kind, points[:, index]) for index, name in enumerate('xyz')]


def kitti_cloud(points):
    return make_cloud([*xyz(points), ('intensity', 'f4', points[:, 3])])


@st.composite
def clouds(draw):
    """A cloud, its points, and the scale of its intensity."""
    height, width = draw(st.integers(1, 4)), draw(st.integers(1, 5))
    count = height * width
    kinds = [draw(st.sampled_from(KINDS)) for _ in range(4)]
    columns, expected = [], []
    for name, kind in zip('xyz', kinds, strict=False):
        elements = None if kind[0] in 'iu' else st.floats(-1e4, 1e4, width=32)
        values = draw(arrays.arrays(np.dtype(kind), count, elements=elements))
        columns.append((name, kind, values))
        expected.append(values)
    intensity_name = draw(st.sampled_from([*INTENSITIES, None]))
    scale = draw(st.sampled_from([1.0, 100.0, 255.0, 65535.0]))
    intensity = np.zeros(count)
    if intensity_name is not None:
        intensity = draw(arrays.arrays(np.uint8, count, elements=st.integers(0, 100)))
        columns.append((intensity_name, kinds[3], intensity))
    others = draw(st.lists(st.sampled_from(KINDS), max_size=2))
    columns += [(f'other_{index}', kind, np.ones(count)) for index, kind in enumerate(others)]
    message = make_cloud(
        draw(st.permutations(columns)),
        (height, width),
        big=draw(st.booleans()),
        padding=(draw(st.integers(0, 5)), draw(st.integers(0, 5))),
        spread=draw(st.integers(0, 3)),
    )
    expected.append(np.clip(intensity / scale, 0, 1))
    return message, np.column_stack([values.astype(np.float32) for values in expected]), scale


@given(clouds())
def test_points_come_back_from_any_order_type_padding_and_byte_order(made):
    message, expected, scale = made
    points, dropped = decode_cloud(message, scale)
    assert points.dtype == np.float32
    is_return = expected[:, :3].any(axis=1) | (message.height == 1)
    assert dropped == np.count_nonzero(~is_return)
    np.testing.assert_array_equal(points, expected[is_return])


@given(
    arrays.arrays(
        np.float32,
        st.integers(0, 30).map(lambda n: (n, 4)),
        elements=st.floats(0, 1, width=32),
    )
)
def test_a_scan_that_was_encoded_is_a_view_of_the_same_bytes(points):
    message = deserialize(
        join(serialize(encode_scan(Scan(points), 1, 'velo_link'))), PointCloud2.__msgtype__
    )
    decoded, dropped = decode_cloud(message)
    assert decoded.tobytes() == points.tobytes()
    assert decoded.dtype == np.float32
    assert dropped == 0
    assert not len(points) or np.shares_memory(decoded, message.data)


def test_a_scan_with_rings_and_times_is_read_by_its_names():
    points = np.random.default_rng(1).uniform(0, 1, (20, 4)).astype(np.float32)
    decoded, _ = decode_cloud(encode_scan(Scan(points), 1, 'velo_link', points=Points.XYZIRT))
    np.testing.assert_array_equal(decoded, points)


@given(
    arrays.arrays(np.float32, (12, 4), elements=st.floats(width=32)),
    st.sampled_from(FLOATS),
    st.booleans(),
)
def test_points_that_are_nowhere_are_dropped_and_counted(points, kind, big):
    message = make_cloud(
        [*xyz(points, kind), ('intensity', kind, points[:, 3])], (3, 4), big=big, padding=(1, 2)
    )
    decoded, dropped = decode_cloud(message)
    finite = np.isfinite(points[:, :3]).all(axis=1) & points[:, :3].any(axis=1)
    np.testing.assert_array_equal(decoded[:, :3], points[finite, :3])
    assert dropped == np.count_nonzero(~finite)
    assert ((decoded[:, 3] >= 0) & (decoded[:, 3] <= 1)).all()


@pytest.mark.parametrize('place', [0, 1, 2])
def test_a_kitti_like_cloud_with_a_nan_loses_that_point_alone(place):
    points = np.full((5, 4), 0.5, dtype=np.float32)
    points[3, place] = np.nan
    decoded, dropped = decode_cloud(kitti_cloud(points))
    assert (len(decoded), dropped) == (4, 1)


def test_a_coordinate_beyond_float32_is_dropped_as_infinite():
    points = np.array([[1e300, 0, 0], [1, 2, 3]])
    decoded, dropped = decode_cloud(make_cloud(xyz(points, 'f8')))
    np.testing.assert_array_equal(decoded, [[1, 2, 3, 0]])
    assert dropped == 1


@pytest.mark.parametrize(
    ('intensity', 'scale', 'reflectance'),
    [
        (51, 255.0, 0.2),
        (300, 255.0, 1),
        (-3, 255.0, 0),
        (np.nan, 1.0, 0),
        (np.inf, 1.0, 1),
        (7, 1.0, 1),
    ],
)
def test_intensity_is_divided_and_clipped(intensity, scale, reflectance):
    points = np.array([[1, 2, 3, intensity]], dtype=np.float32)
    decoded, dropped = decode_cloud(kitti_cloud(points), scale)
    np.testing.assert_allclose(decoded, [[1, 2, 3, reflectance]], rtol=1e-6)
    assert dropped == 0


def test_zeros_are_missing_returns_in_an_organised_cloud_alone():
    columns = [*xyz(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, -2]]))]
    assert decode_cloud(make_cloud(columns))[1] == 0
    points, dropped = decode_cloud(make_cloud(columns, (2, 2)))
    np.testing.assert_array_equal(points, [[1, 0, 0, 0], [0, 0, -2, 0]])
    assert dropped == 2


def test_the_message_stays_as_it_was():
    points = np.array([[1, 2, 3, 200]], dtype=np.float32)
    message = kitti_cloud(points)
    decode_cloud(message, 255.0)
    assert message.data.tobytes() == points.tobytes()


def test_intensity_comes_before_its_other_names():
    points = np.ones((2, 3))
    others = [(name, 'f4', np.full(2, 0.25)) for name in INTENSITIES[:0:-1]]
    message = make_cloud([*others, *xyz(points), ('intensity', 'f4', np.full(2, 0.75))])
    assert (decode_cloud(message)[0][:, 3] == 0.75).all()


@pytest.mark.parametrize('name', ['Intensity', 'INTENSITY', 'I', 'Reflectivity'])
def test_intensity_is_found_in_any_case(name):
    message = make_cloud([*xyz(np.ones((2, 3))), (name, 'f4', np.full(2, 0.75))])
    assert (decode_cloud(message)[0][:, 3] == 0.75).all()


def test_an_empty_cloud_has_no_points_whatever_its_fields():
    points, dropped = decode_cloud(make_cloud([]))
    assert points.shape == (0, 4)
    assert points.dtype == np.float32
    assert dropped == 0


def test_row_step_of_a_single_row_does_not_matter():
    points = np.full((3, 4), 0.5, dtype=np.float32)
    decoded, _ = decode_cloud(replace(kitti_cloud(points), row_step=0))
    np.testing.assert_array_equal(decoded, points)


def field(message, which, **changes):
    fields = [replace(f, **changes) if f.name == which else f for f in message.fields]
    return replace(message, fields=fields)


GOOD = make_cloud([*xyz(np.ones((6, 3))), ('intensity', 'f4', np.ones(6))], (2, 3), padding=(4, 8))


@pytest.mark.parametrize(
    ('message', 'complaint'),
    [
        (field(GOOD, 'y', name='range'), 'a cloud without y; its fields: x, range, z, intensity'),
        (replace(GOOD, fields=[]), 'a cloud without x and y and z; its fields: none'),
        (field(GOOD, 'z', offset=18), 'field z ends at byte 22 of a point, which has 20 bytes'),
        (field(GOOD, 'x', count=3), 'field x has 3 values a point; expected 1'),
        (field(GOOD, 'x', datatype=9), 'field x has the datatype 9; known are 1 to 8'),
        (field(GOOD, 'intensity', offset=99), 'field intensity ends at byte 103'),
        (replace(GOOD, data=GOOD.data[:-1]), '135 bytes of data; 2 rows of 68 bytes are 136'),
        (replace(GOOD, height=3), '136 bytes of data; 3 rows of 68 bytes are 204'),
        (replace(GOOD, row_step=59), 'a row of 3 points of 20 bytes does not fit in row_step, 59'),
        (replace(GOOD, point_step=0, row_step=0), 'field x ends at byte 4 of a point, which has 0'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_a_cloud_that_contradicts_itself_is_refused_with_numbers(message, complaint):
    assert len(decode_cloud(GOOD)[0]) == 6
    with pytest.raises(ValueError, match=complaint):
        decode_cloud(message)


def test_an_odd_field_that_is_not_read_does_no_harm():
    points = np.full((2, 4), 0.5, dtype=np.float32)
    message = kitti_cloud(points)
    odd = PointField('descriptor', 400, 77, 33)
    decoded, _ = decode_cloud(replace(message, fields=[odd, *message.fields]))
    np.testing.assert_array_equal(decoded, points)


def bright(kind, peak):
    return make_cloud([*xyz(np.ones((3, 3))), ('intensity', kind, np.array([0, peak / 2, peak]))])


@pytest.mark.parametrize(
    ('kind', 'peaks', 'scale'),
    [
        ('f4', [0.99], 1),
        ('f8', [1.0, 0.2], 1),
        ('f4', [0.9, 100.0], 255),
        ('u1', [1], 255),
        ('u1', [255], 255),
        ('u2', [255], 255),
        ('u2', [256], 4095),
        ('f4', [4095.0], 4095),
        ('u2', [3000, 4096], 65535),
        ('f4', [np.inf, 0.5], 1),
        ('f4', [70000.0], 70000),
        ('f4', [0.0], 1),
    ],
)
def test_the_divisor_follows_the_peak_of_all_clouds(kind, peaks, scale):
    assert guess_intensity_scale([bright(kind, peak) for peak in peaks]) == scale


def test_the_divisor_of_clouds_without_intensity_is_1():
    no_number = make_cloud([*xyz(np.ones((1, 3))), ('intensity', 'f4', np.array([np.nan]))])
    refused = replace(bright('u1', 9), data=np.empty(0, np.uint8))
    clouds = [make_cloud([]), make_cloud(xyz(np.ones((1, 3)))), no_number, refused]
    assert guess_intensity_scale(clouds) == 1
    assert guess_intensity_scale([]) == 1
    assert guess_intensity_scale([*clouds, bright('u1', 9)]) == 255
