# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import KITTI_COLUMNS, ScanColumns


@pytest.mark.parametrize(
    ('text', 'size', 'extra', 'skipped'),
    [
        ('x y z intensity', 16, (), ()),
        ('x,y,z,intensity,-,-', 24, (), (5, 6)),
        ('x y z', 12, (), ()),
        ('ring z y x - reflectance time:f8', 32, ('ring', 'time'), (5,)),
        ('x:f8 y:f8 z:f8 intensity -:f8', 36, (), (5,)),
    ],
)
def test_notation(text, size, extra, skipped):
    columns = ScanColumns.parse(text)
    assert (columns.point_bytes, columns.extra, columns.skipped) == (size, extra, skipped)
    assert ScanColumns.parse(columns.text) == columns


def test_kittis_own():
    assert KITTI_COLUMNS.is_kitti
    assert ScanColumns.parse('x y z reflectance').is_kitti
    assert not ScanColumns.parse('x y z ring').is_kitti
    assert not ScanColumns.parse('x y z intensity:f8').is_kitti


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'no x'),
        ('x y intensity', 'no z'),
        ('x y z z', 'z occurs twice'),
        ('x y z intensity reflectance', 'intensity occurs twice'),
        ('x y z i:f2', "'i:f2' is no column"),
        ('x y z 4th', "'4th' is no column"),
        ('x y z label', 'has a field label'),
        ('x y z x_rest', 'has a field x_rest'),
        ('x y z ' + '- ' * 62, '65 columns'),
    ],
)
def test_invalid(text, said):
    with pytest.raises(UsageError, match=said):
        ScanColumns.parse(text)
