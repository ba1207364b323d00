# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frame map, in bags read by others' readers, against sums made here and pykitti's poses."""

from __future__ import annotations

from math import cos, log, pi, radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap_ros2.reader import read_ros2_messages

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.planned_recording import PlannedRecording
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.naming import map_from_world
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import Start
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MapFrame, MarkerOptions, MessageOptions, Preset
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import Bound, ReadOptions, SelectionOptions
from kitti_ros2.pictures.recording_frames import RecordingFrames

from builders import convert_recording  # isort: skip

ODOMETRY = '/kitti/ground_truth/odometry'
BASE_TO_IMU = np.array([-0.05, 0.32, 0.93])
NO_GRAVITY = 'map is base_link at the first pose, not east-north-up: the layout has no gravity'
MAPS = pytest.mark.parametrize('kind', list(MapFrame))


def write(source, out, sequence=None, selection=None, **options):
    read = ReadOptions(sequence=sequence)
    return convert_recording(source, out, MessageOptions(**options), selection, read=read)


def messages(bag, topic):
    return [item.ros_msg for item in read_ros2_messages(str(bag), topics=[topic])]


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def matrix(place, q):
    """(4, 4) of a position and a quaternion, both as messages have them."""
    made = np.eye(4)
    x, y, z, w = q.x, q.y, q.z, q.w
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = place.x, place.y, place.z
    return made


def base_poses(bag):
    """(N, 4, 4) of base_link in map."""
    found = [each.pose.pose for each in messages(bag, ODOMETRY)]
    return np.array([matrix(pose.position, pose.orientation) for pose in found])


def imu_poses(bag):
    """(N, 4, 4) of imu_link in map."""
    arm = np.eye(4)
    arm[:3, 3] = BASE_TO_IMU
    return base_poses(bag) @ arm


def packets(drive):
    """(N, 30) columns of dataformat.txt."""
    return np.loadtxt([path.read_text() for path in sorted((drive / 'oxts/data').glob('*.txt'))])


def turn(roll, pitch, yaw):
    rx = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    ry = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    rz = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
    return np.array(rz) @ np.array(ry) @ np.array(rx)


def w_t_imu(columns):
    """(N, 4, 4) as pykitti.utils.load_oxts_packets_and_poses has them, T_w_imu."""
    scale = cos(radians(columns[0, 0]))
    made = np.tile(np.eye(4), (len(columns), 1, 1))
    for pose, (lat, lon, alt, roll, pitch, yaw) in zip(made, columns[:, :6], strict=True):
        pose[:3, :3] = turn(roll, pitch, yaw)
        north = scale * 6378137.0 * log(tan((90.0 + lat) * pi / 360.0))
        pose[:3, 3] = scale * lon * pi * 6378137.0 / 180.0, north, alt
    made[:, :3, 3] -= made[0, :3, 3].copy()
    return made


@pytest.fixture(scope='module')
def drives(real_kitti):
    return {name: real_kitti / f'raw/2011_09_26/2011_09_26_drive_{name}_sync'
            for name in ('0001', '0005')}  # fmt: skip


@pytest.mark.parametrize('name', ['0001', '0005'])
def test_height_is_that_of_the_altitudes(drives, tmp_path, name):
    write(drives[name], tmp_path / 'o.mcap')
    altitudes = packets(drives[name])[:, 2]
    heights = imu_poses(tmp_path / 'o.mcap')[:, 2, 3]
    np.testing.assert_allclose(heights - heights[0], altitudes - altitudes[0], atol=1e-6)
    # base_link is a metre below the unit, so it rolls and pitches with it by a centimetre or two.
    climb = np.ptp(base_poses(tmp_path / 'o.mcap')[:, 2, 3])
    assert climb == pytest.approx(np.ptp(altitudes), abs=0.05)


@pytest.mark.parametrize('name', ['0001', '0005'])
def test_gravity_points_up_and_headings_east_and_north(drives, tmp_path, name):
    write(drives[name], tmp_path / 'o.mcap')
    poses, columns = base_poses(tmp_path / 'o.mcap'), packets(drives[name])
    felt = np.array([
        [m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z]
        for m in messages(tmp_path / 'o.mcap', '/kitti/oxts/imu')
    ])  # fmt: skip
    stamps = np.array([stamp_of(m) for m in messages(tmp_path / 'o.mcap', ODOMETRY)]) / 1e9
    # What is felt is gravity and the change of velocity, east north up.
    gained = (columns[-1, [7, 6, 10]] - columns[0, [7, 6, 10]]) / (stamps[-1] - stamps[0])
    up = np.einsum('nij,nj->ni', poses[:, :3, :3], felt).mean(axis=0) - gained
    assert np.degrees(np.arctan2(np.hypot(up[0], up[1]), up[2])) < 1
    yaws = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    np.testing.assert_allclose(np.angle(np.exp(1j * (yaws - columns[:, 5]))), 0, atol=1e-6)
    places = imu_poses(tmp_path / 'o.mcap')[:, :3, 3]
    speeds = (places[2:] - places[:-2]) / (stamps[2:] - stamps[:-2])[:, None]
    east_north = columns[1:-1, [7, 6]]
    assert np.sqrt(np.mean((speeds[:, :2] - east_north) ** 2)) < 0.25
    directions = np.arctan2(speeds[:, 1], speeds[:, 0])
    moving = np.hypot(*east_north.T) > 3
    off = np.degrees(np.angle(np.exp(1j * (directions - columns[1:-1, 5]))))[moving]
    assert abs(np.median(off)) < 1.5


@pytest.mark.parametrize('name', ['0001', '0005'])
def test_devkit_keeps_kitti_s_relative_poses(drives, tmp_path, name):
    write(drives[name], tmp_path / 'o.mcap', map=MapFrame.DEVKIT)
    expected = w_t_imu(packets(drives[name]))
    relative = np.linalg.inv(expected[0]) @ expected
    np.testing.assert_allclose(imu_poses(tmp_path / 'o.mcap'), relative, atol=1e-8)


@pytest.mark.parametrize('name', ['0001', '0005'])
def test_both_maps_agree_with_pykitti(real_kitti, drives, tmp_path, name):
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    loaded = pykitti.raw(str(real_kitti / 'raw'), '2011_09_26', name)
    expected = np.array([oxts.T_w_imu for oxts in loaded.oxts])
    write(drives[name], tmp_path / 'devkit.mcap', map=MapFrame.DEVKIT)
    relative = np.linalg.inv(expected[0]) @ expected
    np.testing.assert_allclose(imu_poses(tmp_path / 'devkit.mcap'), relative, atol=1e-8)
    write(drives[name], tmp_path / 'enu.mcap')
    found = imu_poses(tmp_path / 'enu.mcap')
    found[:, :3, 3] -= found[0, :3, 3].copy()
    np.testing.assert_allclose(found, expected, atol=1e-8)


@pytest.mark.parametrize('options', [
    {}, {'preset': Preset.KITTI2BAG}, {'base_to_imu': (-1.4, 0.3, 2.0)},
])  # fmt: skip
@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING, Layout.ODOMETRY, Layout.KITTI_360])
def test_the_first_base_link_is_the_origin(recordings, tmp_path, layout, options):
    write(recordings[layout], tmp_path / 'o.mcap', **options)
    first = messages(tmp_path / 'o.mcap', ODOMETRY)[0].pose.pose.position
    assert (first.x, first.y, first.z) == pytest.approx((0, 0, 0), abs=1e-12)


METRES = st.floats(-1e3, 1e3)
POSES = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.tuples(METRES, METRES, METRES),
)


@given(POSES, POSES, st.tuples(METRES, METRES, METRES), st.sampled_from(MapFrame), st.booleans())
def test_every_map_keeps_what_lies_between_poses(first, later, arm, kind, level):
    base_t_imu = Transform.from_translation(arm)
    map_t_world = map_from_world(Start(first, level), base_t_imu, kind)
    here, there = map_t_world @ first, map_t_world @ later
    moved = (here.inverse() @ there).matrix()
    np.testing.assert_allclose(moved, (first.inverse() @ later).matrix(), atol=1e-9)
    if kind is MapFrame.ENU:
        base = here @ base_t_imu.inverse()
        np.testing.assert_allclose(base.translation, 0, atol=1e-9)
        rotation = first.rotation if level else np.eye(3)
        np.testing.assert_allclose(base.rotation, rotation, atol=1e-12)
    elif level:
        np.testing.assert_allclose(here.matrix(), np.eye(4), atol=1e-9)


def test_the_first_readable_packet_counts(drive, tmp_path):
    for number in (0, 1):
        (drive / f'oxts/data/{number:010d}.txt').write_text('unreadable')
    report = write(drive, tmp_path / 'o.mcap')
    assert report.losses
    poses = base_poses(tmp_path / 'o.mcap')
    assert len(poses) == 3
    assert poses[0, :3, 3].tolist() == [0, 0, 0]


@MAPS
def test_a_part_of_a_recording_has_the_map_of_the_whole(recordings, tmp_path, kind):
    source = recordings[Layout.TRACKING]
    write(source, tmp_path / 'whole.mcap', map=kind)
    selection = SelectionOptions(start=Bound(frame=2), end=Bound(frame=3))
    write(source, tmp_path / 'part.mcap', selection=selection, map=kind)
    whole, part = base_poses(tmp_path / 'whole.mcap'), base_poses(tmp_path / 'part.mcap')
    np.testing.assert_array_equal(part, whole[2:4])
    assert part[0, :3, 3].tolist() != [0, 0, 0]


@MAPS
def test_path_tf_and_odometry_are_one(recordings, tmp_path, kind):
    write(recordings[Layout.RAW], tmp_path / 'o.mcap', map=kind)
    poses = base_poses(tmp_path / 'o.mcap')
    (path,) = messages(tmp_path / 'o.mcap', '/kitti/ground_truth/path')
    along = [matrix(each.pose.position, each.pose.orientation) for each in path.poses]
    np.testing.assert_array_equal(along, poses)
    moved = [each.transforms[0].transform for each in messages(tmp_path / 'o.mcap', '/tf')]
    turned = [matrix(each.translation, each.rotation) for each in moved]
    np.testing.assert_array_equal(turned, poses)


@MAPS
def test_trails_end_at_their_boxes(recordings, tmp_path, kind):
    """By the bag's own transforms: map -> base_link -> imu_link -> velo_link."""
    options = {'markers': MarkerOptions(trails=True), 'map': kind}
    write(recordings[Layout.TRACKING], tmp_path / 'o.mcap', **options)
    bag = tmp_path / 'o.mcap'
    (static,) = messages(bag, '/tf_static')
    links = {each.child_frame_id: each.transform for each in static.transforms}
    base_t_velo = np.eye(4)
    for child in ('imu_link', 'velo_link'):
        base_t_velo = base_t_velo @ matrix(links[child].translation, links[child].rotation)
    compared = 0
    for place, markers in enumerate(messages(bag, '/kitti/labels/markers')):
        map_t_velo = base_poses(bag)[place] @ base_t_velo
        for marker in markers.markers:
            boxes = [m for m in markers.markers if (m.id, m.ns) == (marker.id, 'box')]
            if marker.header.frame_id != 'map' or not boxes:
                continue
            box = boxes[0].pose.position
            expected = map_t_velo @ [box.x, box.y, box.z, 1]
            last = marker.points[-1]
            np.testing.assert_allclose([last.x, last.y, last.z], expected[:3], atol=1e-6)
            compared += 1
    assert compared > 5


def test_odometry_has_no_gravity_and_says_so(recordings, tmp_path):
    source = recordings[Layout.ODOMETRY]
    report = write(source, tmp_path / 'o.mcap')
    assert NO_GRAVITY in report.notes
    np.testing.assert_allclose(base_poses(tmp_path / 'o.mcap')[0], np.eye(4), atol=1e-12)
    devkit = write(source, tmp_path / 'd.mcap', map=MapFrame.DEVKIT)
    assert NO_GRAVITY not in devkit.notes
    np.testing.assert_allclose(imu_poses(tmp_path / 'd.mcap')[0], np.eye(4), atol=1e-6)
    scans = write(source, tmp_path / 's.mcap', selection=SelectionOptions(streams=('scan',)))
    assert NO_GRAVITY not in scans.notes
    for layout in (Layout.RAW, Layout.TRACKING):
        assert NO_GRAVITY not in write(recordings[layout], tmp_path / f'{layout.value}.mcap').notes


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING, Layout.ODOMETRY, Layout.KITTI_360])
def test_odometry_made_of_either_map_is_the_same(recordings, tmp_path, layout):
    made = []
    for kind in MapFrame:
        bag = tmp_path / f'{kind.value}.mcap'
        write(recordings[layout], bag, map=kind)
        options, survey = ImportOptions(layout=Layout.ODOMETRY), survey_bags([bag])
        plan = guess([bag], survey, options).plan
        convert_by_plan([bag], plan, survey, tmp_path / kind.value, options)
        made.append(np.loadtxt(tmp_path / kind.value / 'poses/00.txt'))
    assert len(made[0]) >= 4
    np.testing.assert_allclose(made[0], made[1], atol=2e-6)  # they are written with seven digits


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
def test_pictures_of_a_folder_and_of_its_bag_have_one_map(recordings, tmp_path, layout):
    write(recordings[layout], tmp_path / 'o.mcap')
    folder = RecordingFrames(open_recording(recordings[layout]))
    bag = RecordingFrames(PlannedRecording(tmp_path / 'o.mcap', survey_bags([tmp_path / 'o.mcap'])))
    found = 0
    for number in (1, 3):
        # A raw drive's packets have stamps of their own, between which the bag's are interpolated.
        pair = [source.frame(number, frozenset({'pose'})).pose for source in (folder, bag)]
        expected, pose = (each.world_T_imu.translation for each in pair)
        atol = 0.1 if layout is Layout.RAW else 1e-6
        np.testing.assert_allclose(pose, expected, atol=atol)
        found += 1
    bag.close()
    assert found == 2
