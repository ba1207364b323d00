# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CustomMsg of either Livox driver becomes scans."""

from __future__ import annotations

import livox_robot as robot
import numpy as np
import pytest
import robot_bags as bags

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.kitti.text_file import parse_packet
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions


@pytest.mark.parametrize('package', ['livox_ros_driver', 'livox_ros_driver2'])
@pytest.mark.parametrize(
    ('container', 'bare'), [('mcap', False), ('mcap', True), ('ros1', False), ('sqlite3', False)]
)
def test_points_are_those_of_the_messages(tmp_path, package, container, bare):
    bag = bags.write(tmp_path / 'bag', robot.said(package), container, bare=bare)
    options = ImportOptions(layout=Layout.OBJECT)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    assert (plan.scan.topic, plan.scan.frame) == ('/livox/lidar', 'livox_frame')
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    assert report.losses == ()
    recording = open_recording(tmp_path / 'out', ReadOptions(layout=Layout.OBJECT))
    for frame in range(robot.FRAMES):
        true = np.delete(robot.points(frame), robot.NONE_AT, axis=0)
        found = recording.read(Stream.SCAN, frame).points
        assert np.array_equal(found[:, :3], true[:, :3])
        assert np.allclose(found[:, 3], true[:, 3] / 255)


@pytest.mark.parametrize('package', ['livox_ros_driver', 'livox_ros_driver2'])
@pytest.mark.parametrize(
    ('point_ns', 'base_ns', 'turn_ns'),
    [
        (400_000, 0, (0, 199 * 400_000)),
        (400_000, 2_000_000, (2_000_000, 2_000_000 + 199 * 400_000)),
        (400_000, -robot.START_NS, (0, 199 * 400_000)),
        (1, 0, None),
    ],
)
def test_scans_are_of_the_middle_of_their_turn(tmp_path, package, point_ns, base_ns, turn_ns):
    bag = bags.write(tmp_path / 'bag', robot.said(package, point_ns, base_ns))
    options = ImportOptions(layout=Layout.RAW)
    survey = survey_bags([bag])
    assert survey.topics['/livox/lidar'].turn_ns == turn_ns
    plan = guess([bag], survey, options).plan
    convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    start, end = turn_ns or (0, 0)
    first = robot.START_NS + 100_000_000 * np.arange(robot.FRAMES)
    true = first[:, None] + ((start + end) // 2, start, end)
    assert np.abs(bags.scan_stamps(tmp_path / 'out') - true).max() <= 1


@pytest.mark.parametrize(
    ('topic', 'up', 'written', 'told'),
    [
        ('/livox/imu', 1.003, 1.003 * 9.80665, 'are in g, as Livox'),
        ('/livox/imu', 9.79, 9.79, ''),
        ('/imu', 1.003, 1.003, 'look like g (1.00 up in the mean'),
    ],
)
def test_accelerations_in_g(tmp_path, topic, up, written, told):
    said = robot.said('livox_ros_driver2')
    said += [robot.imu(topic, number, up) for number in range(10 * robot.FRAMES)]
    said.sort(key=lambda each: each.log_ns)
    bag = bags.write(tmp_path / 'bag', said)
    options = ImportOptions(layout=Layout.RAW)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    packets = sorted((tmp_path / 'out').glob('*/*_sync/oxts/data/*.txt'))
    assert len(packets) == robot.FRAMES
    for path in packets:
        packet = parse_packet(path.read_text(), path)
        assert (packet.az, packet.au) == pytest.approx((written, written))
    notes = [note for note in report.notes if 'its accelerations' in note]
    assert len(notes) == bool(told)
    assert all(told in note for note in notes)
