# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The IoU of true positives: one for all classes, or by class."""

from __future__ import annotations

import pytest

from kitti_ros2.model.classes import KITTI_OVERLAPS, LeastOverlaps
from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.declare import parse_least_overlaps
from kitti_ros2.options.table import make_settings, make_view_settings


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        (0.5, LeastOverlaps((), 0.5)),
        ('0.5', LeastOverlaps((), 0.5)),
        (0, LeastOverlaps((), 0.0)),
        (['Car=0.5'], LeastOverlaps((('car', 0.5),))),
        ('Car=0.5,cyclist=0.25 0.4', LeastOverlaps((('car', 0.5), ('cyclist', 0.25)), 0.4)),
        (['Person (sitting)=0.5'], None),
    ],
)
def test_overlaps(value, expected):
    if expected is None:
        with pytest.raises(UsageError, match='iou takes an IoU'):
            parse_least_overlaps('iou', value)
        return
    assert parse_least_overlaps('iou', value) == expected


@pytest.mark.parametrize(
    'value', ['', [], '1', '-0.1', 'nan', 'inf', 'Car', 'Car=', 'Car=0.5 car=0.6']
)
def test_what_is_no_overlap_is_refused(value):
    with pytest.raises(UsageError, match=r'iou takes an IoU of at least 0 and below 1, such as'):
        parse_least_overlaps('iou', value)


def test_classes_without_a_value_have_the_common_one_or_that_of_kitti():
    chosen = parse_least_overlaps('iou', 'Car=0.5 0.25')
    assert [chosen.of(name) for name in ('Car', 'car', 'Van', 'x')] == [0.5, 0.5, 0.25, 0.25]
    assert parse_least_overlaps('iou', 'Car=0.5').of('Van') == 0.7


@pytest.mark.parametrize('make', [make_settings, make_view_settings])
def test_an_overlap_is_for_predictions(make):
    assert make({}).predictions.overlaps is KITTI_OVERLAPS
    chosen = make({'predictions': 'results', 'iou': 0.5}).predictions
    assert chosen.overlaps.of('Car') == 0.5
    with pytest.raises(UsageError, match='--iou is for --predictions'):
        make({'iou': 0.5})
