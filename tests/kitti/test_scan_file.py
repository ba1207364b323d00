# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.kitti.scan_file import format_scan, format_scan_text, parse_scan, parse_scan_text
from kitti_ros2.model.errors import BadFileError

POINTS = arrays.arrays(
    np.float32,
    st.integers(1, 50).map(lambda n: (n, 4)),
    elements=st.floats(-200, 200, width=32) | st.sampled_from([np.nan, np.inf, -np.inf]),
)


@given(POINTS)
def test_bin_and_back_to_the_byte(points):
    data = format_scan(points)
    assert format_scan(parse_scan(data, 'x.bin')) == data
    assert parse_scan(data, 'x.bin').tobytes() == points.tobytes()


@given(st.lists(st.tuples(*[st.integers(-90_000, 90_000)] * 3, st.integers(0, 100)), min_size=1))
def test_text_and_back(thousandths):
    points = np.array([[x / 1e3, y / 1e3, z / 1e3, r / 1e2] for x, y, z, r in thousandths])
    again = parse_scan_text(format_scan_text(points.astype(np.float32)), 'x.txt')
    np.testing.assert_array_equal(again, points.astype(np.float32))


def test_text_keeps_nan_and_infinity():
    points = parse_scan_text(b'nan 1 2 0.5\n1 inf 2 0\n', 'x.txt')
    assert np.isnan(points[0, 0])
    assert np.isinf(points[1, 1])


@pytest.mark.parametrize(
    ('data', 'said'), [(b'', 'empty'), (bytes(17), '17 bytes'), (bytes(15), 'multiple of 16')]
)
def test_bad_bin(data, said):
    with pytest.raises(BadFileError, match=said) as caught:
        parse_scan(data, 'd/7.bin')
    assert str(caught.value).startswith('d/7.bin: ')


@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (b'', 'empty'),
        (b'1 2 3 4\n1 2 3\n', 'x.txt:2: 3 values'),
        (b'1 2 3 4\n1 2 3 4 5\n1 2 3\n', 'x.txt:2: 5 values'),
        (b'1 2 3 four\n', "x.txt:1: b'1 2 3 four'"),
    ],
)
def test_bad_text(data, said):
    with pytest.raises(BadFileError, match=said):
        parse_scan_text(data, 'x.txt')
