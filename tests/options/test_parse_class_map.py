# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Classes of results with KITTI's, as words and as a mapping."""

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.declare import parse_class_map, parse_labels
from kitti_ros2.options.evaluation import BagResultsOptions


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        (['car=Car', '3=Pedestrian'], (('car', 'Car'), ('3', 'Pedestrian'))),
        ('traffic light=', (('traffic light', ''),)),
        (['a=b=Car', '*='], (('a=b', 'Car'), ('*', ''))),
        ({'car': 'Car', 3: 'Van'}, (('car', 'Car'), ('3', 'Van'))),
        ((('car', 'Car'),), (('car', 'Car'),)),
        ([], ()),
    ],
)
def test_pairs(value, expected):
    assert parse_class_map('class_map', value) == expected
    assert BagResultsOptions(class_map=expected).class_map == expected


@pytest.mark.parametrize('value', ['car', '=Car', ['car=Car', 'x'], 'car=My Car', {'car': 3}, 5])
def test_what_is_no_pair_is_refused_in_one_line(value):
    with pytest.raises(UsageError, match='class_map takes NAME=CLASS') as error:
        parse_class_map('class_map', value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('parse', [parse_class_map, parse_labels])
def test_two_partners_of_one_name_are_refused(parse):
    assert parse('pairs', ['Van=TRUCK', 'Van=TRUCK'])
    with pytest.raises(UsageError, match=r'^pairs: Van is given twice, as TRUCK and BUS$'):
        parse('pairs', ['Van=TRUCK', 'Van=BUS'])


@pytest.mark.parametrize('value', ['Van', '=BUS', ''])
def test_the_error_of_labels_shows_labels(value):
    with pytest.raises(UsageError, match='takes CLASS=LABEL, such as Van=TRUCK Tram=BUS, not'):
        parse_labels('autoware_labels', value)


def test_a_tolerance_out_of_range_is_refused():
    with pytest.raises(UsageError, match='tolerance -1'):
        BagResultsOptions(tolerance_ns=-1_000_000_000)
