# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan is read as it was printed, and what cannot be meant is named by its key."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.importer.plan import (
    CameraPlan,
    Incomplete,
    LabelPlan,
    Plan,
    PosePlan,
    ScanPlan,
    format_plan,
    parse_plan,
)
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout

PATH = Path('plan.yaml')
LEAST = 'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'

names = st.text(st.characters(codec='utf-8', categories=['L', 'N', 'P']), min_size=1, max_size=12)
seconds = st.floats(1e-6, 1e3)
plans = st.builds(
    Plan,
    layout=st.sampled_from(Layout),
    name=names,
    reference=names,
    tolerance_s=seconds,
    incomplete=st.sampled_from(Incomplete),
    scan=st.none() | st.builds(ScanPlan, names, names, seconds),
    cameras=st.dictionaries(
        st.integers(0, 4), st.builds(CameraPlan, names, names, st.booleans(), names)
    ),
    pose=st.none() | st.builds(PosePlan, names, names, names),
    labels=st.none()
    | st.builds(LabelPlan, names, st.integers(0, 4), st.booleans(), st.integers(0, 3)),
    imu=names,
    fix=names,
    velocity=names,
    imu_frame=names,
    calibration=names,
)


@given(plans)
def test_a_plan_is_read_as_it_was_printed(plan):
    assert parse_plan(format_plan(plan, ('a note', 'another: one')), PATH) == plan


def test_notes_are_comments():
    text = format_plan(parse_plan(LEAST, PATH), ('missing: images',))
    assert text.startswith('# missing: images\nlayout: object\n')


def test_whole_numbers_are_numbers_where_fractions_are_expected():
    assert parse_plan(LEAST.replace('0.05', '1'), PATH).tolerance_s == 1.0


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'is not a plan'),
        ('- 1', 'is not a plan'),
        ('a: [', 'is not valid YAML'),
        (
            'layout: nuscenes',
            "layout: 'nuscenes'; expected raw or object or odometry or tracking or kitti360",
        ),
        ('layout: object', 'missing name, reference, tolerance_s'),
        (LEAST.replace('training', '0'), 'name: 0; expected a text (quote numbers)'),
        (LEAST.replace('0.05', 'soon'), "tolerance_s: 'soon'; expected a number"),
        (LEAST + 'incomplete: maybe', "incomplete: 'maybe'; expected drop or keep"),
        (LEAST + 'scans: 1', "unknown key 'scans'"),
        (LEAST + 'scan: /points', 'scan: expected topic, frame'),
        (LEAST + 'scan: {topic: /points}', 'scan: missing frame'),
        (LEAST + 'cameras: {left: {topic: /i}}', 'cameras: expected KITTI camera numbers'),
        (LEAST + 'cameras: {9: {topic: /i}}', 'cameras: expected KITTI camera numbers'),
        (LEAST + 'cameras: {2: {topic: /i, rectify: 3}}', 'cameras: 2: rectify: 3; expected true'),
        (LEAST + 'labels: {topic: /b, occluded: 4}', 'labels: occluded: 4; expected 0 to 3'),
    ],
)
def test_what_cannot_be_meant_is_named(text, said):
    with pytest.raises(UsageError) as caught:
        parse_plan(text, PATH)
    assert said in str(caught.value)
    assert str(caught.value).startswith('plan.yaml')
    assert '\n' not in str(caught.value)
