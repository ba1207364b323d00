# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The route of a report: length, speed, altitude, yaw, and their plots."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.datasets import statistics
from kitti_ros2.evaluation.odometry import score_odometry
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import route_of
from kitti_ros2.model.samples import Pose
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.evaluation import OdometryOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.report.gather import gather
from kitti_ros2.report.page import route_section
from kitti_ros2.report.plots import course_plot

from builders import convert_recording  # isort: skip

ANY = ReadOptions()
PERIOD = 100_000_000
START = 1_317_042_145_951_199_337


def every(count: int) -> list[int]:
    return [START + number * PERIOD for number in range(count)]


def at(x, y=0.0, yaw=0.0, velocity=None):
    return Pose(Transform(rotation_from_rpy(0, 0, yaw), np.array([x, y, 0.0])), velocity)


def test_a_route_is_as_long_as_its_steps_and_jumps_are_none():
    corner = [at(0), at(3), at(3, 4)]
    route = route_of(every(3), corner)
    assert (route.length_m, route.net_m, route.jumps) == (7, 5, 0)
    np.testing.assert_allclose(route.speeds_m_s, [30, 30, 40])
    torn = route_of(every(4), [*corner, at(9e5)])
    assert (torn.length_m, torn.jumps) == (7, 1)
    np.testing.assert_allclose(torn.speeds_m_s, [30, 30, 40, np.nan])


def test_routes_are_put_in_order_and_without_nan():
    route = route_of([30, 10, 15, 20], [at(x) for x in (2, 0, np.nan, 1)])
    assert route.positions[:, 0].tolist() == [0, 1, 2]
    assert route_of([1], [at(0)]) is None
    assert route_of([], []) is None


def test_speeds_are_measured_where_they_are():
    forward = np.array([3.0, 4.0, 0.0])
    route = route_of(every(3), [at(0, velocity=forward), at(0), at(0, velocity=-forward)])
    np.testing.assert_allclose(route.speeds_m_s, [5, np.nan, 5])


def test_equal_stamps_have_no_speed():
    route = route_of([START, START, START + PERIOD], [at(0), at(0.5), at(1)])
    np.testing.assert_allclose(route.speeds_m_s, [np.nan, np.nan, 5])


def test_yaw_is_continuous_around_the_block():
    turns = np.arange(0, 4 * np.pi, 0.5)
    route = route_of(every(len(turns)), [at(0, yaw=turn) for turn in turns])
    np.testing.assert_allclose(route.yaws_rad, turns, atol=1e-9)


def test_a_pose_without_rotation_has_no_yaw_and_its_neighbours_have():
    broken = Pose(Transform(np.full((3, 3), np.nan), np.zeros(3)))
    route = route_of(every(3), [at(0, yaw=3), broken, at(0, yaw=3.5)])
    np.testing.assert_allclose(route.yaws_rad, [3, np.nan, 3.5])


@pytest.mark.parametrize('layout', list(Layout), ids=[layout.value for layout in Layout])
def test_a_page_has_the_plots_that_its_layout_has_data_for(recordings, layout):
    report = gather(recordings[layout], ANY)
    section = route_section(report)
    recording = open_recording(recordings[layout])
    if Stream.POSE not in recording.streams:
        assert section is None
        return
    extents = {name: extent for name, extent, _ in section['courses']}
    assert list(extents) == ['Speed', 'Altitude', 'Yaw']
    measured = Stream.OXTS in recording.streams
    assert ('sea level' in extents['Altitude']) == measured
    assert ('east' in extents['Yaw']) == measured
    if measured:
        index = recording.streams[Stream.POSE]
        packets = [recording.read(Stream.OXTS, number) for number in index.numbers.tolist()]
        route = report.route
        altitudes = route.positions[:, 2] + route.altitude_m
        np.testing.assert_allclose(altitudes, [packet.alt for packet in packets], atol=1e-6)
        speeds = [np.linalg.norm([packet.ve, packet.vn, packet.vu]) for packet in packets]
        # Files of poses have no velocity.
        off = 1e-6 if recording.layout.traits.packet_poses else 0.1
        np.testing.assert_allclose(route.speeds_m_s, speeds, atol=off)
        yaws = [packet.yaw for packet in packets]
        np.testing.assert_allclose(np.cos(route.yaws_rad - yaws), 1, atol=1e-9)


def test_real_speeds_altitudes_and_yaws(real_kitti):
    drive = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0001_sync'
    if not drive.is_dir():
        pytest.skip(f'no {drive}')
    route = gather(drive, ANY).route
    assert route.positions[0, 2] + route.altitude_m == pytest.approx(116.43032836914)
    # By Mercator 106.96 m, by the measured velocity 108.00 m.
    seconds = np.diff(route.stamps_ns) / 1e9
    assert (route.speeds_m_s[:-1] * seconds).sum() == pytest.approx(108.0, abs=0.01)


@given(
    st.lists(
        st.tuples(st.floats(0, 1e4), st.floats(-1e5, 1e5)),
        min_size=2,
        max_size=30,
        unique_by=lambda pair: pair[0],
    ),
    st.sampled_from([1, 60]),
)
def test_a_course_is_inside_and_shows_its_extremes(pairs, dense):
    times, values = np.array(sorted(pairs)).T
    times -= times[0]
    grid = np.linspace(0, times[-1], len(times) * dense)
    values = np.interp(grid, times, values)
    drawn = course_plot('c', 'Speed', grid, values, 'm/s')
    _, _, width, height = map(float, re.search(r'viewBox="([^"]+)"', drawn)[1].split())
    path = re.search(r'd="M([^"]+)" class="course"', drawn)[1]
    x, y = np.array([[float(n) for n in pair.split()] for pair in path.split('L')]).T
    assert (np.diff(x) >= 0).all()
    assert x.min() >= 0
    assert x.max() <= width
    assert y.min() >= 0
    assert y.max() <= height
    assert len(x) <= 700
    share = (values.max() - values.min()) / max(np.ptp(values) * 1.12, np.ptp(values) + 0.1)
    assert np.ptp(y) == pytest.approx(share * (height - 44), abs=0.02)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.ODOMETRY, Layout.TRACKING, Layout.KITTI_360])
def test_the_length_is_that_of_stats(recordings, tmp_path, layout):
    source = recordings[layout]
    convert_recording(source, tmp_path / 'bag.mcap')
    for path in (source, tmp_path / 'bag.mcap'):
        counted = statistics(path).total.route.length_m
        assert gather(path, ANY).route.length_m == pytest.approx(counted, abs=1e-9)
    if layout is Layout.ODOMETRY:  # camera 0 is not where the unit is: their ways differ in turns
        (poses,) = source.glob('poses/*.txt')
        scores = score_odometry(tmp_path / 'bag.mcap', poses, ANY, OdometryOptions())
        assert counted == pytest.approx(scores.distances_m[-1], abs=1e-6)
