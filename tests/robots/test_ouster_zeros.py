# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points that are no returns are dropped, and counted by reason."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import clocks_apart as base
import numpy as np
import ouster_zeros as robots
import pytest

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.clouds import AT_ZERO, NOT_FINITE, RANGE_ZERO, decode_returns
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions


@pytest.mark.parametrize('organised', [True, False])
@pytest.mark.parametrize('minimum_m', [0.0, 1.0])
def test_returns_alone_become_points(organised, minimum_m, tmp_path):
    bag = robots.write(tmp_path / 'bag', organised=organised)
    survey, options = survey_bags([bag]), ImportOptions(layout=Layout.OBJECT)
    plan = guess([bag], survey, options).plan
    assert 'minimum_range_m' not in format_plan(plan)
    plan = replace(plan, scan=replace(plan.scan, minimum_range_m=minimum_m))
    assert parse_plan(format_plan(plan), Path('plan.yaml')) == plan
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    recording = open_recording(tmp_path / 'out', ReadOptions(layout=Layout.OBJECT))
    for number in range(base.FRAMES):
        made, good = robots.points(number)
        found = recording.read(Stream.SCAN, number).points
        if minimum_m:
            expected = np.column_stack([made[name][good] for name in 'xyz'])
            np.testing.assert_array_equal(found[:, :3], expected)
        else:
            assert len(found) == len(good) + robots.NEAR
    counts = {
        'x y z not finite': robots.NOT_FINITE,
        'x y z 0 0 0': robots.ZEROS,
        'range 0': robots.MOVED,
    }
    if minimum_m:
        counts['nearer than 1 m'] = robots.NEAR
    total = base.FRAMES * sum(counts.values())
    reasons = ', '.join(f'{name} ({base.FRAMES * count})' for name, count in counts.items())
    assert f'/points: {total} points without a return were dropped: {reasons}' in report.notes
    assert report.losses == ()


def test_a_point_is_counted_once_by_its_first_reason():
    found = decode_returns(base.cloud(robots.points(3)[0], 1))
    assert found.dropped == {
        NOT_FINITE: robots.NOT_FINITE,
        AT_ZERO: robots.ZEROS,
        RANGE_ZERO: robots.MOVED,
    }
    assert len(found.points) == robots.ROWS * robots.COLUMNS - sum(found.dropped.values())


@pytest.mark.parametrize(('unfilled', 'moved'), [(200, 0), (60, 0), (1, 0), (60, 70)])
def test_points_with_range_0_and_a_place_of_their_own_are_returns(unfilled, moved):
    """A driver leaves the field at 0; zeros that were moved are at one place."""
    rng = np.random.default_rng(unfilled)
    made = np.zeros(200, robots.POINT)
    for name in 'xyz':
        made[name] = rng.uniform(1, 9, len(made))
    made['x'][:2], made['y'][:2], made['z'][:2] = 3, 4, 5  # by chance at one place
    made['range'][unfilled:] = 9000
    at = slice(200 - moved, 200)
    made['range'][at] = 0
    for name, value in zip('xyz', (0.4, 0.0, 1.2), strict=True):
        made[name][at] = value
    found = decode_returns(base.cloud(made, 1))
    assert len(found.points) == 200 - moved
    assert found.dropped == ({RANGE_ZERO: moved} if moved else {})


def test_an_empty_cloud_has_nothing_to_drop():
    found = decode_returns(base.cloud(robots.points(3)[0][:0], 1))
    assert found.points.shape == (0, 4)
    assert not found.dropped


@pytest.mark.parametrize(
    ('value', 'said'),
    [
        ('-1', 'scan: minimum_range_m: -1.0; expected 0 or more'),
        ('.nan', 'scan: minimum_range_m: nan; expected a finite number'),
        ('near', "scan: minimum_range_m: 'near'; expected a number"),
    ],
)
def test_a_range_that_cannot_be_meant_is_refused_by_name(value, said):
    text = (
        'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
        f'scan: {{topic: /points, frame: lidar, minimum_range_m: {value}}}\n'
    )
    with pytest.raises(UsageError) as caught:
        parse_plan(text, Path('plan.yaml'))
    assert str(caught.value) == f'plan.yaml: {said}'
