# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parts of messages that cannot be used are losses, and cost themselves alone."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import livox_robot
import named_boxes
import numpy as np
import pytest
import robot_bags as bags
from ten_robots import ROBOTS

from kitti_ros2.cli import main
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

OBJECT = ImportOptions(layout=Layout.OBJECT)


def converted(bag, out, change=lambda plan: plan):
    survey = survey_bags([bag])
    plan = change(guess([bag], survey, OBJECT).plan)
    return convert_by_plan([bag], plan, survey, out, OBJECT)


def livox(path, spoil):
    said = livox_robot.said('livox_ros_driver2')
    spoil(said[2].values)
    return bags.write(path, said)


def test_points_that_a_livox_message_declares_and_does_not_have(tmp_path):
    bag = livox(tmp_path / 'bag', lambda values: values.update(points=values['points'][:50]))
    report = converted(bag, tmp_path / 'out')
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/livox/lidar', 150)
    assert 'points that point_num counts' in loss.text()
    assert report.counts['scan'] == livox_robot.FRAMES


def test_a_livox_message_without_points(tmp_path):
    bag = livox(tmp_path / 'bag', lambda values: values.update(points=[], point_num=0))
    report = converted(bag, tmp_path / 'out')
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/livox/lidar', 1)
    assert loss.text().endswith('it has no point')
    assert report.counts['scan'] == livox_robot.FRAMES - 1
    listed = (tmp_path / 'out/ImageSets/trainval.txt').read_text().split()
    assert '000002' not in listed


def test_scans_that_lose_all_their_points_by_the_plan(tmp_path):
    bag = bags.write(tmp_path / 'bag', livox_robot.said('livox_ros_driver2'))
    report = converted(
        bag,
        tmp_path / 'out',
        lambda plan: replace(plan, scan=replace(plan.scan, minimum_range_m=500.0)),
    )
    (loss,) = report.losses
    assert (loss.stream, loss.count) == ('/livox/lidar', livox_robot.FRAMES)
    assert 'no point is left of it: ' in loss.text()
    assert 'nearer than 500 m' in loss.text()
    assert 'scan' not in report.counts


def spoilt(made, tmp_path, monkeypatch, spoil):
    """The bags of one of the ten robots, with messages changed in place."""
    write = bags.write

    def changed(path, said, *_container):
        return write(path, [spoil(each._replace(values=deepcopy(each.values))) for each in said])

    monkeypatch.setattr(bags, 'write', changed)
    return [str(path) for path in made.write(tmp_path)]


def robot(name):
    return next(each for each in ROBOTS if each.name == name)


def test_a_marker_without_a_frame_costs_itself_alone(tmp_path, monkeypatch, capsys):
    made = robot('velodyne')
    frames = len(made.truth().moments)

    def spoil(each):
        if each.topic == '/boxes':
            lost = deepcopy(each.values['markers'][0])
            lost['id'] = 99
            lost['header']['frame_id'] = ''
            each.values['markers'].append(lost)
        return each

    found = spoilt(made, tmp_path, monkeypatch, spoil)
    out = tmp_path / 'out'
    assert main(['to-kitti', *found, str(out), '--layout', 'object']) == 1
    said = capsys.readouterr().err
    assert f'skipped /boxes ({frames}): /boxes: boxes in a frame that nothing joins' in said
    labels = sorted((out / 'training/label_2').iterdir())
    assert len(labels) == frames
    assert all(len(label.read_text().splitlines()) == 1 for label in labels)


@pytest.mark.parametrize('layout', ['object', 'raw'])
def test_links_of_nan_are_named(layout, tmp_path, monkeypatch, capsys):
    made = robot('livox')
    count = 0

    def spoil(each):
        nonlocal count
        if each.topic == '/tf':
            for link in each.values['transforms']:
                link['transform']['translation']['x'] = float('nan')
                count += 1
        return each

    found = spoilt(made, tmp_path, monkeypatch, spoil)
    assert main(['to-kitti', *found, str(tmp_path / 'out'), '--layout', layout]) == 1
    said = capsys.readouterr().err
    assert f'({count}): the transforms odom -> base_link of /tf are no transforms: NaN' in said


def test_one_transform_of_nan_does_not_stop_a_link(tmp_path, monkeypatch, capsys):
    """Also if it is the first: the link moves."""
    made, seen = robot('livox'), []

    def spoil(each):
        if each.topic == '/odom':
            each.values['child_frame_id'] = 'elsewhere'
        if each.topic == '/tf':
            seen.append(each)
            if len(seen) == 1:
                each.values['transforms'][0]['transform']['rotation']['w'] = np.nan
        return each

    found = spoilt(made, tmp_path, monkeypatch, spoil)
    assert main(['to-kitti', *found, '--layout', 'odometry', '--plan']) == 0
    assert 'missing: poses' not in capsys.readouterr().out


def test_classes_of_the_plan_that_match_no_box_are_noted(tmp_path):
    bag = named_boxes.write(tmp_path / 'bag', ['vehicle.car', 'pallet'])

    def change(plan):
        classes = {'vehicel.car': 'Van', 'PALLET': 'Truck', 'vehicle.car': 'Car'}
        return replace(plan, labels=replace(plan.labels, classes=classes))

    report = converted(bag, tmp_path / 'out', change)
    (note,) = [line for line in report.notes if 'labels.classes' in line]
    assert note == '/detections: no box is of these labels.classes of the plan: vehicel.car'
