# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras and scanners that lean: boxes hold their points wherever KITTI's format can say so."""

from __future__ import annotations

import camera_rigs
import numpy as np
import pytest
from camera_rigs import Camera, Robot, boxes, inside, looking, pose, turned, world
from written_sets import WrittenSet

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions


def rolled(degrees):
    """(4, 4) a turn about the optical axis."""
    return pose(turned(degrees), (0, 0, 0))


def about_x(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def rig(base_t_camera, lidar=None):
    lidar = pose(np.eye(3) if lidar is None else lidar, (0.3, 0.0, 1.2))
    eye = Camera('/front', 'front_eye', base_t_camera)
    links = ('base_link', 'lidar', lidar), ('base_link', 'front_eye', base_t_camera)
    return Robot((eye,), links, 'lidar', lidar)


AHEAD = looking(0.0, (0.5, 0.0, 1.0))
CAMERAS = {
    'pitched': looking(0.0, (0.5, 0.0, 1.0), 25.0),
    'portrait': AHEAD @ rolled(90),
    'rolled': AHEAD @ rolled(30),
    'down': looking(0.0, (8.0, 1.0, 9.0), 90.0),
}
LIDARS = {f'pitched {degrees}': turned(0.0, degrees) for degrees in (4, 8, 16, 25, 40)}
LIDARS |= {'rolled': about_x(20), 'turned and pitched': turned(10.0, 12.0)}


def converted(robot, tmp_path, layout):
    bag = camera_rigs.write(robot, tmp_path / 'bag')
    options, survey = ImportOptions(layout=layout), survey_bags([bag])
    plan = guess([bag], survey, options).plan
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    return plan, report


def assert_boxes_hold_their_points(written):
    truth = [inside(world(), box) for box in boxes()]
    held = written.labels(0)
    assert held
    for each in held:
        assert any((each.points == solid).all() for solid in truth)


@pytest.mark.parametrize('name', CAMERAS)
def test_tracklets_do_not_lean_with_the_camera(name, tmp_path):
    _, report = converted(rig(CAMERAS[name]), tmp_path, Layout.RAW)
    assert report.losses == ()
    assert not any('lean' in note for note in report.notes)
    assert_boxes_hold_their_points(WrittenSet(tmp_path / 'out', 'raw'))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', ['raw', 'object'])
@pytest.mark.parametrize('name', LIDARS)
def test_scans_of_a_scanner_that_leans_are_level(name, layout, tmp_path):
    plan, report = converted(rig(AHEAD, LIDARS[name]), tmp_path, Layout(layout))
    assert plan.scan.forward == 'base_link'
    assert report.losses == ()
    assert_boxes_hold_their_points(WrittenSet(tmp_path / 'out', layout))


def test_scans_of_a_scanner_that_leans_a_little_stay_as_they_are(tmp_path):
    bag = camera_rigs.write(rig(AHEAD, turned(5.0, 2.0)), tmp_path / 'bag')
    guessed = guess([bag], survey_bags([bag]), ImportOptions(layout=Layout.OBJECT))
    assert guessed.plan.scan.forward == ''


@pytest.mark.parametrize('name', ['portrait', 'down'])
def test_boxes_that_a_label_cannot_hold_are_lost_and_named(name, tmp_path):
    _, report = converted(rig(CAMERAS[name]), tmp_path, Layout.OBJECT)
    (loss,) = report.losses
    assert loss.count == camera_rigs.FRAMES * len(boxes())
    assert 'lean by more than 45 degrees from the axis that labels turn about' in loss.text()


@pytest.mark.parametrize(('degrees', 'told'), [(2.0, False), (8.0, True)])
def test_a_camera_that_leans_is_told(degrees, told, tmp_path):
    robot = rig(looking(0.0, (0.5, 0.0, 1.0), degrees))
    _, report = converted(robot, tmp_path, Layout.OBJECT)
    notes = [
        note for note in report.notes if f'lean by up to {degrees:.0f} degrees from the' in note
    ]
    assert bool(notes) is told
