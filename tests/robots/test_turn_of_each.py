# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans whose turns differ: each has the times of its own message, whatever the type."""

from __future__ import annotations

from itertools import pairwise

import drive_world
import livox_robot
import numpy as np
import pytest
import robot_bags as bags
import turtlebot
import velodyne_unit

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

MS = 1_000_000
START_NS = 1_680_000_000_000_000_000
FIRST_MS = 3
"""The first message holds the end of a turn alone: too short to tell the unit of its times."""
TURNS_MS = [FIRST_MS, *[130, 130, 130, 130, 260, 130, 390, 130, 130, 260, 131, 130, 60, 130, 130]]
"""None of the uneven ones is one of the messages at doubling distances, but for the first."""
STAMPS_NS = (START_NS + np.cumsum([0, *TURNS_MS[:-1]]) * MS).tolist()


def ring(stamp_ns, turn_ms):
    increment = turn_ms / 1000 / (turtlebot.RAYS - 1)
    found = turtlebot.laser_scan(stamp_ns, time_increment=increment, scan_time=turn_ms / 1000)
    return bags.Said('/scan', stamp_ns, 'sensor_msgs/msg/LaserScan', found)


def cloud(stamp_ns, turn_ms, stamped_at=0.0, field=('t', '<u4', 1.0)):
    name, kind, unit = field
    rows = drive_world.rows_of(np.random.default_rng(1).uniform(2, 20, (90, 3)), (name, kind))
    rows[name] = np.linspace(-stamped_at, 1 - stamped_at, len(rows)) * turn_ms * MS * unit
    at_ns = stamp_ns + round(stamped_at * turn_ms * MS)
    said = drive_world.cloud(at_ns, 'lidar', rows)
    return bags.Said('/points', stamp_ns + turn_ms * MS, 'sensor_msgs/msg/PointCloud2', said)


def cloud_stamped_at_its_end(stamp_ns, turn_ms):
    return cloud(stamp_ns, turn_ms, 1.0, ('time', '<f4', 1e-9))


def cloud_stamped_in_the_middle(stamp_ns, turn_ms):
    return cloud(stamp_ns, turn_ms, 0.5, ('time', '<f4', 1e-9))


def livox(stamp_ns, turn_ms):
    (said, *_) = livox_robot.said('livox_ros_driver2', turn_ms * MS // 199)
    said.values['header'] = bags.header(stamp_ns, 'livox_frame')
    said.values['timebase'] = stamp_ns
    return bags.Said(said.topic, stamp_ns, said.msgtype, said.values)


def packets(stamp_ns, turn_ms):
    few, _ = velodyne_unit.encode(velodyne_unit.UNITS['VLP-16'], sequences=240)
    times = np.linspace(stamp_ns, stamp_ns + turn_ms * MS, len(few)).round().astype(int).tolist()
    said = velodyne_unit.scan_message(few, times[-1], times)
    return bags.Said('/packets', times[-1], 'velodyne_msgs/msg/VelodyneScan', said)


KINDS = [ring, cloud, cloud_stamped_at_its_end, cloud_stamped_in_the_middle, livox, packets]


def converted(path):
    chosen, survey = ImportOptions(layout=Layout.RAW), survey_bags([path])
    plan = guess([path], survey, chosen).plan
    report = convert_by_plan([path], plan, survey, path.with_name('out'), chosen)
    return report, bags.scan_stamps(path.with_name('out'))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('container', ['mcap', 'sqlite3', 'ros1'])
@pytest.mark.parametrize('kind', KINDS)
def test_each_scan_is_stamped_in_the_middle_of_its_own_turn(kind, container, tmp_path):
    said = [kind(*each) for each in zip(STAMPS_NS, TURNS_MS, strict=True)]
    bag = bags.write(tmp_path / 'bag', said, container)
    report, found = converted(bag)
    assert report.losses == ()
    assert report.frames == len(TURNS_MS)
    true = np.array([[at, at - turn, at + turn] for at, turn in middles()])
    assert np.abs(found - true).max() < 0.02 * MS
    notes = [note for note in report.notes if 'paired and stamped in the middle' in note]
    if kind is cloud_stamped_in_the_middle:
        assert not notes
    else:
        assert '(medians; 5 of 16 differ by more than 5 ms, from ' in notes[0]


def middles():
    for stamp_ns, turn_ms in zip(STAMPS_NS, TURNS_MS, strict=True):
        yield stamp_ns + turn_ms * MS // 2, turn_ms * MS // 2


@pytest.mark.one_in(3)
@pytest.mark.parametrize('kind', KINDS)
def test_images_are_paired_with_the_turn_that_they_were_exposed_in(kind, tmp_path):
    """Each in the middle of its turn, which by the median would be up to 130 ms away."""
    said = [kind(*each) for each in zip(STAMPS_NS, TURNS_MS, strict=True)]
    grey = np.zeros((turtlebot.SIZE[1], turtlebot.SIZE[0], 3), np.uint8)
    for number, (at_ns, _) in enumerate(middles()):
        image = bags.image(at_ns, 'camera', grey + number, 'rgb8')
        said.append(bags.Said('/image', at_ns, 'sensor_msgs/msg/Image', image))
    bag = bags.write(tmp_path / 'bag', sorted(said, key=lambda each: each.log_ns))
    report, _ = converted(bag)
    assert (report.frames, report.counts['image_2']) == (len(TURNS_MS), len(TURNS_MS))
    (note,) = (line for line in report.notes if line.startswith('image_2 (/image):'))
    assert 'off by 0.0 ms in the mean, 0.' in note


def test_turns_that_are_alike_are_told_as_before(tmp_path):
    said = [ring(at, 130) for at in range(START_NS, START_NS + 10**9, 130 * MS)]
    report, found = converted(bags.write(tmp_path / 'bag', said))
    (note,) = (line for line in report.notes if 'paired and stamped in the middle' in line)
    assert note.endswith('65.0 ms from it')
    assert {int(b - a) // MS for a, b in pairwise(found[:, 0])} == {130}


def test_rings_that_are_measured_at_once_keep_their_stamps(tmp_path):
    said = [
        bags.Said(
            '/scan',
            at,
            'sensor_msgs/msg/LaserScan',
            turtlebot.laser_scan(at, time_increment=0.0, scan_time=0.1),
        )
        for at in STAMPS_NS
    ]
    _, found = converted(bags.write(tmp_path / 'bag', said))
    assert found[:, 0].tolist() == STAMPS_NS


@pytest.mark.parametrize(('later_s', 'told'), [(37.0, 1), (0.0, 0)])
def test_times_of_another_clock_are_said_to_be_unused(later_s, told, tmp_path):
    """Scanners have TAI by PTP, 37 s ahead of the UTC of stamps."""
    said = []
    for at in range(START_NS, START_NS + 10**9, 100 * MS):
        rows = drive_world.rows_of(np.full((90, 3), 9.0), ('timestamp', '<f8'))
        rows['timestamp'] = at / 1e9 + later_s + np.linspace(0, 0.1, len(rows))
        found = drive_world.cloud(at, 'lidar', rows)
        said.append(bags.Said('/points', at + 100 * MS, 'sensor_msgs/msg/PointCloud2', found))
    report, found = converted(bags.write(tmp_path / 'bag', said))
    assert sum('(timestamp) are not used' in note for note in report.notes) == told
    assert (int(found[0, 0]) == START_NS) == bool(told)
