# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics to values of JSON, and back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.datasets.recording_statistics import (
    ObjectStatistics,
    RecordingStatistics,
    RouteStatistics,
)
from kitti_ros2.datasets.set_statistics import SetStatistics, plain_values, read_values
from kitti_ros2.files.output_rules import json_text
from kitti_ros2.model.errors import Loss

NUMBERS = st.lists(st.floats(0, 1000), max_size=20)


@st.composite
def recordings(draw):
    objects = ObjectStatistics(draw(st.integers(0, 99)), frames=3, most=2)
    objects.difficulty['easy'] += draw(st.integers(0, 9))
    for value in draw(NUMBERS):
        objects.distance_m.add(value)
    route = RouteStatistics(4, draw(st.floats(0, 1e6)), 2.5, 1)
    for value in draw(NUMBERS):
        route.speed_m_s.add(value)
    found = RecordingStatistics('name', 'raw', 5, 4, objects.count, route=route)
    found.samples.update({'scan': 5})
    found.classes['Car'] = objects
    for value in draw(NUMBERS):
        found.points_a_scan.add(value)
    found.point_classes.update({'road': 7})
    found.losses = (Loss('scan', 2, 'frames {}: cut off', (1, 2)),)
    found.notes = ('a note',)
    return found


@given(st.lists(recordings(), max_size=3))
def test_values_and_totals_come_back(parts):
    found = SetStatistics(Path('set'), tuple(parts))
    text = json_text(plain_values(found))
    back = read_values(json.loads(text))
    again = json.loads(json_text(plain_values(back)))
    assert again['recordings'] == _near(json.loads(text)['recordings'])
    assert again['total'] == _near(json.loads(text)['total'])


def _near(value):
    """Return the value with numbers that may differ in their last digits."""
    if isinstance(value, dict):
        return {key: _near(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_near(each) for each in value]
    return pytest.approx(value, rel=1e-9, abs=1e-9) if isinstance(value, float) else value


def test_every_figure_of_two_routes_is_added():
    route = RouteStatistics(2, 10.0, 1.0, 1)
    route.speed_m_s.add(3.0)
    route.merge(RouteStatistics(3, 5.0, 0.5, 2))
    assert (route.poses, route.length_m, route.duration_s, route.jumps) == (5, 15.0, 1.5, 3)
    assert route.speed_m_s.count == 1
