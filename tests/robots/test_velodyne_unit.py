# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of Velodyne's scanners become the points that they stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import robot_bags as bags
import turtlebot
import velodyne_unit as robot
import yaml

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import BadFileError, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import RecordingFrames

RESOLUTION_M = 0.002


def convert(bag, out, change=lambda plan: plan):
    """(report, points of the first scan) of a bag in layout odometry."""
    options = ImportOptions(layout=Layout.OBJECT)
    survey = survey_bags([bag])
    plan = change(guess([bag], survey, options).plan)
    report = convert_by_plan([bag], plan, survey, out, options)
    recording = open_recording(out, ReadOptions(layout=Layout.OBJECT))
    return report, recording.read(Stream.SCAN, 0).points


def nearest(points, true):
    """(N,) distance of each point to a true one of the same laser, which is told by reflectance."""
    found = []
    for shine in np.unique(true[:, 3].astype(np.float32)):
        mine, theirs = (
            each[np.abs(each[:, 3] - shine) < 1e-6, :3].astype(np.float64)
            for each in (points, true)
        )
        assert len(mine) == len(theirs)
        squares = (mine**2).sum(1)[:, None] + (theirs**2).sum(1) - 2 * mine @ theirs.T
        places = squares.argmin(axis=1)
        assert len(set(places.tolist())) == len(theirs)
        found.append(np.linalg.norm(mine - theirs[places], axis=1))
    return np.concatenate(found)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('second', [False, True], ids=['single', 'dual'])
@pytest.mark.parametrize('name', list(robot.UNITS))
def test_points_are_those_of_the_packets(tmp_path, name, second):
    packets, _ = robot.encode(robot.UNITS[name], second=second)
    whole = len(packets) * 12 // (2 if second else 1) * robot.UNITS[name].per_block
    packets, true = robot.encode(robot.UNITS[name], second=second, sequences=whole)
    report, points = convert(robot.write(tmp_path / 'bag', packets), tmp_path / 'out')
    assert report.losses == ()
    # Values of a block are in the order of firing, those of the world as well.
    assert points.shape == true.shape
    assert nearest(points, true).max() < RESOLUTION_M


@pytest.mark.parametrize('container', ['ros1', 'sqlite3'])
def test_other_containers(tmp_path, container):
    packets, true = robot.encode(robot.UNITS['VLP-16'], sequences=240)
    bag = robot.write(tmp_path / 'bag', packets, container)
    _, points = convert(bag, tmp_path / 'out')
    assert nearest(points, true).max() < RESOLUTION_M


@pytest.mark.parametrize('container', ['mcap', 'sqlite3'])
def test_a_bag_without_definitions(tmp_path, container):
    packets, true = robot.encode(robot.UNITS['VLP-16'], sequences=240)
    bag = robot.write(tmp_path / 'bag', packets, container, bare=True)
    _, points = convert(bag, tmp_path / 'out')
    assert nearest(points, true).max() < RESOLUTION_M


class TestHdl64:
    @pytest.fixture
    def unit(self, tmp_path):
        """(bag, calibration file, points)."""
        file = robot.hdl_64_file(np.random.default_rng(3))
        path = tmp_path / 'unit.yaml'
        path.write_text(yaml.safe_dump(file))
        packets, true = robot.encode_hdl_64(file)
        return robot.write(tmp_path / 'bag', packets), path, true

    def test_by_the_calibration_of_the_unit(self, tmp_path, unit):
        bag, path, true = unit

        def name_file(plan):
            plan = replace(plan, scan=replace(plan.scan, calibration=str(path)))
            return parse_plan(format_plan(plan), tmp_path / 'plan.yaml')

        _, points = convert(bag, tmp_path / 'out', name_file)
        assert np.abs(points - true).max() < 1e-4

    def test_a_return_that_is_there_twice_counts_once(self, tmp_path, unit):
        _, path, _ = unit
        file = yaml.safe_load(path.read_text())
        packets, true = robot.encode_hdl_64(file, 60, twice=True)
        bag = robot.write(tmp_path / 'dual', packets)
        _, points = convert(
            bag,
            tmp_path / 'out',
            lambda plan: replace(plan, scan=replace(plan.scan, calibration=str(path))),
        )
        assert np.abs(points - true).max() < 1e-4

    def test_without_it_the_plan_says_so(self, tmp_path, unit):
        bag, _, _ = unit
        guessed = guess([bag], survey_bags([bag]), ImportOptions(layout=Layout.OBJECT))
        assert any('HDL-64E' in note and 'scan.calibration' in note for note in guessed.notes)
        with pytest.raises(UsageError, match=r'scan\.calibration'):
            convert(bag, tmp_path / 'out')

    @pytest.mark.one_in(3)
    @pytest.mark.parametrize(
        'text',
        [
            *(
                '',
                'lasers: 3',
                'lasers: [1]',
                'lasers: [{laser_id: 0, vert_correction: .nan}]',
                '{',
            ),
            pytest.param(f'lasers: [{{laser_id: 0, vert_correction: {10**400}}}]', id='huge'),
        ],
    )
    def test_a_wrong_file(self, tmp_path, unit, text):
        bag, path, _ = unit
        path.write_text(text)
        with pytest.raises(BadFileError, match=r'unit\.yaml'):
            convert(
                bag,
                tmp_path / 'out',
                lambda plan: replace(plan, scan=replace(plan.scan, calibration=str(path))),
            )

    def test_a_file_of_fewer_lasers(self, tmp_path, unit):
        bag, path, _ = unit
        path.write_text('lasers: [{laser_id: 0}]')
        with pytest.raises(UsageError, match='1 lasers; a HDL-64E has 64'):
            convert(
                bag,
                tmp_path / 'out',
                lambda plan: replace(plan, scan=replace(plan.scan, calibration=str(path))),
            )


class TestHostile:
    def test_damaged_packets_are_losses_and_the_others_stay(self, tmp_path):
        packets, true = robot.encode(robot.UNITS['VLP-16'], sequences=240)
        broken = bytearray(packets[3])
        broken[0] = 0
        far = bytearray(packets[4])
        far[2:4] = b'\xff\xff'
        packets[3], packets[4] = bytes(broken), bytes(far)
        report, points = convert(robot.write(tmp_path / 'bag', packets), tmp_path / 'out')
        assert 0 < len(points) < len(true)
        assert [(loss.stream, loss.count) for loss in report.losses] == [
            ('/velodyne_packets', 2 * robot.FRAMES)
        ]

    def test_packets_of_an_unknown_product(self, tmp_path):
        packets, true = robot.encode(robot.UNITS['VLP-16'], sequences=240)
        packets = [packet[:-1] + b'\x00' for packet in packets]
        bag = robot.write(tmp_path / 'bag', packets)
        with pytest.raises(UsageError, match=r'0x00.*scan\.model'):
            convert(bag, tmp_path / 'out')
        _, points = convert(
            bag,
            tmp_path / 'given',
            lambda plan: replace(plan, scan=replace(plan.scan, model='VLP-16')),
        )
        assert nearest(points, true).max() < RESOLUTION_M

    @pytest.mark.parametrize('packets', [[], [b'\0' * 1206]], ids=['none', 'zeros'])
    def test_no_packet_at_all(self, tmp_path, packets):
        bag = robot.write(tmp_path / 'bag', packets)
        with pytest.raises(Exception, match=r'velodyne_packets|no point cloud') as caught:
            convert(bag, tmp_path / 'out')
        assert '\n' not in str(caught.value)

    def test_a_plan_of_a_model_with_other_lasers(self, tmp_path):
        packets, _ = robot.encode(robot.UNITS['VLP-16'], sequences=240)
        bag = robot.write(tmp_path / 'bag', packets)

        def wrong(plan):
            return replace(plan, scan=replace(plan.scan, model='HDL-32E'))

        with pytest.raises(UsageError, match=r'scan.model: HDL-32E, but .* VLP-16, with 16 lasers'):
            convert(bag, tmp_path / 'out', wrong)
        assert not (tmp_path / 'out').exists()

    def test_a_plan_of_an_unknown_model(self, tmp_path):
        with pytest.raises(UsageError, match=r"plan.yaml: scan: model: 'VLP-17'; expected one of"):
            parse_plan(
                'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
                'scan: {topic: /a, frame: b, model: VLP-17}\n',
                tmp_path / 'plan.yaml',
            )


@pytest.mark.parametrize('place', [0, -1])
def test_scans_are_of_the_middle_of_their_packets(tmp_path, place):
    """The driver stamps a message as its last packet, or as its first."""
    packets, _ = robot.encode(robot.UNITS['VLP-16'], sequences=240)
    starts = robot.START_NS + 100_000_000 * np.arange(robot.FRAMES)
    said = []
    for start in starts.tolist():
        stamps = [start + 90_000_000 * n // (len(packets) - 1) for n in range(len(packets))]
        message = robot.scan_message(packets, stamps[place], stamps)
        said.append(bags.Said('/packets', stamps[-1], 'velodyne_msgs/msg/VelodyneScan', message))
    bag = bags.write(tmp_path / 'bag', said)
    options = ImportOptions(layout=Layout.RAW)
    survey = survey_bags([bag])
    plan = guess([bag], survey, options).plan
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    assert any('paired and stamped in the middle' in note for note in report.notes)
    true = starts[:, None] + (45_000_000, 0, 90_000_000)
    assert np.abs(bags.scan_stamps(tmp_path / 'out') - true).max() <= 1


def test_pictures_of_a_bag_without_the_calibration_show_its_images(tmp_path):
    packets, _ = robot.encode_hdl_64(robot.hdl_64_file(np.random.default_rng(3)), 60)
    said = turtlebot.said(scans=False)
    said = [each for each in said if '/depth/' not in each.topic]
    for frame in range(turtlebot.FRAMES):
        stamp = turtlebot.START_NS + frame * turtlebot.PERIOD_NS
        message = robot.scan_message(packets, stamp)
        said.append(bags.Said('/packets', stamp, 'velodyne_msgs/msg/VelodyneScan', message))
    bag = bags.write(tmp_path / 'bag', said)
    frames = RecordingFrames(PlannedRecording(bag, survey_bags([bag])))
    assert len(frames.numbers) == turtlebot.FRAMES
    assert list(frames.cameras) == [2]
    frames.close()
