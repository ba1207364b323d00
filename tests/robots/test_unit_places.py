# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of oxts between fixes, at their ends and in gaps; and velocities from places alone.

The vehicle stands for two seconds, then drives off in a bend: its truth is integrated here.
"""

from __future__ import annotations

import drive_world
import numpy as np
import pytest
import robot_bags as bags

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.text_file import parse_packet
from kitti_ros2.model.geometry import rotation_from_rpy
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

MS = 1_000_000
START_NS = 1_690_000_000_000_000_000
SECONDS = 7
SCANS_NS = np.arange(START_NS + 13 * MS, START_NS + SECONDS * 10**9, 100 * MS)
STANDING_S, AHEAD = 2.0, 1.4  # m/s^2
RATE = 0.3  # rad/s
ANTENNA = np.array([-0.8, 0.4, 1.3])
EARTH_M = 6378137.0
ORIGIN = (49.0, 8.4, 110.0)


def speed(seconds):
    return AHEAD * np.maximum(seconds - STANDING_S, 0.0)


def yaw(seconds):
    return 0.8 + RATE * np.maximum(seconds - STANDING_S, 0.0)


_AXIS = np.linspace(-1, SECONDS + 1, 20_001)
_STEPS = speed(_AXIS)[:, None] * np.column_stack([np.cos(yaw(_AXIS)), np.sin(yaw(_AXIS))])
_WAY = np.vstack(
    [np.zeros(2), np.cumsum((_STEPS[1:] + _STEPS[:-1]) / 2 * np.diff(_AXIS)[:, None], axis=0)]
)


def place(seconds):
    return np.array([*(np.interp(seconds, _AXIS, column) for column in _WAY.T), 0.0])


def since(stamp_ns):
    return (stamp_ns - START_NS) / 1e9


def geographic(east, north, up, origin=ORIGIN):
    lat, lon, alt = origin
    radius = EARTH_M * np.cos(np.radians(lat))
    longitude = lon + np.degrees(east / radius)
    longitude = (longitude + 180) % 360 - 180
    return lat + np.degrees(north / EARTH_M), longitude, alt + up


def fix(stamp_ns, *, antenna=False, status=0, origin=ORIGIN, noise=None):
    seconds = since(stamp_ns)
    lever = rotation_from_rpy(0, 0, yaw(seconds)) @ ANTENNA if antenna else np.zeros(3)
    wander = np.zeros(3) if noise is None else noise(seconds)
    lat, lon, alt = geographic(*(place(seconds) + lever + wander), origin)
    if status < 0:
        lat = lon = alt = 0.0
    values = {
        'header': bags.header(stamp_ns, 'antenna' if antenna else 'imu'),
        'status': {'status': status, 'service': 1},
        'latitude': float(lat),
        'longitude': float(lon),
        'altitude': float(alt),
    }
    return bags.Said('/fix', stamp_ns, 'sensor_msgs/msg/NavSatFix', values)


def imu(stamp_ns):
    turn = rotation_from_rpy(0.02, -0.03, yaw(since(stamp_ns)))
    rate = RATE * (since(stamp_ns) > STANDING_S)
    values = {
        'header': bags.header(stamp_ns, 'imu'),
        'orientation': drive_world.quaternion(turn),
        'angular_velocity': drive_world.vector((0, 0, rate)),
        'linear_acceleration': drive_world.vector((0, 0, 9.81)),
    }
    return bags.Said('/imu', stamp_ns, 'sensor_msgs/msg/Imu', values)


def twist(stamp_ns, share=0.0):
    forward = float(share * speed(since(stamp_ns)))
    said = {'linear': drive_world.vector((forward, 0, 0)), 'angular': drive_world.vector((0, 0, 0))}
    values = {'header': bags.header(stamp_ns, 'imu'), 'twist': said}
    return bags.Said('/vel', stamp_ns, 'geometry_msgs/msg/TwistStamped', values)


def pose_of(stamp_ns):
    return bags.place(*place(since(stamp_ns)), bags.about_z(yaw(since(stamp_ns))))


def odometry(stamp_ns):
    values = {
        'header': bags.header(stamp_ns, 'odom'),
        'child_frame_id': 'imu',
        'pose': {'pose': drive_world.pose(pose_of(stamp_ns))},
    }
    return bags.Said('/odom', stamp_ns, 'nav_msgs/msg/Odometry', values)


def posed(stamp_ns):
    values = {
        'header': bags.header(stamp_ns, 'odom'),
        'pose': drive_world.pose(pose_of(stamp_ns)),
    }
    return bags.Said('/pose', stamp_ns, 'geometry_msgs/msg/PoseStamped', values)


def link(stamp_ns):
    moved = bags.transform('odom', 'imu', pose_of(stamp_ns), stamp_ns)
    return bags.Said('/tf', stamp_ns, 'tf2_msgs/msg/TFMessage', {'transforms': [moved]})


def every(period_ms, make, *, first_ms=-40, last_ms=SECONDS * 1000 + 40):
    times = range(START_NS + first_ms * MS, START_NS + last_ms * MS, period_ms * MS)
    return [make(stamp_ns) for stamp_ns in times]


def convert(path, *said, layout=Layout.RAW, container='mcap'):
    """The notes, the losses, and the packets by the stamps of their frames."""
    links = [
        ('imu', 'lidar', bags.place(0.3, 0.0, 0.9)),
        ('imu', 'antenna', bags.place(*ANTENNA)),
    ]
    every_one = [drive_world.static(START_NS - 10**9, links)]
    rows = drive_world.rows_of(np.random.default_rng(1).uniform(2, 20, (30, 3)))
    for stamp_ns in SCANS_NS.tolist():
        cloud = drive_world.cloud(stamp_ns, 'lidar', rows)
        every_one.append(bags.Said('/points', stamp_ns, 'sensor_msgs/msg/PointCloud2', cloud))
    for each in said:
        every_one += each
    bag = bags.write(path / 'bag', every_one, container)
    options, survey = ImportOptions(layout=layout, origin='49.0,8.4,110'), survey_bags([bag])
    guessed = guess([bag], survey, options)
    report = convert_by_plan([bag], guessed.plan, survey, path / 'out', options)
    if layout is Layout.TRACKING:
        (text,) = (path / 'out').rglob('oxts/*.txt')
        rows = enumerate(text.read_text().splitlines())
    else:
        files = (path / 'out').rglob('oxts/data/*.txt')
        rows = sorted((int(file.stem), file.read_text()) for file in files)
    packets = {int(SCANS_NS[number]): parse_packet(line, path) for number, line in rows}
    return [*guessed.notes, *report.notes], report.losses, packets


def off_m(packets, origin=ORIGIN):
    """(N,) how far the places of packets are from the truth."""
    lat, lon, alt = origin
    found = []
    for stamp_ns, packet in packets.items():
        east = np.radians((packet.lon - lon + 180) % 360 - 180) * EARTH_M * np.cos(np.radians(lat))
        north = np.radians(packet.lat - lat) * EARTH_M
        found.append(np.linalg.norm([east, north, packet.alt - alt] - place(since(stamp_ns))))
    return np.array(found)


def off_m_s(packets):
    """(N,) how far the velocities of packets are from the truth."""
    found = []
    for stamp_ns, packet in packets.items():
        seconds = since(stamp_ns)
        ahead = speed(seconds) * np.array([np.cos(yaw(seconds)), np.sin(yaw(seconds)), 0])
        found.append(np.linalg.norm([packet.ve, packet.vn, packet.vu] - ahead))
    return np.array(found)


def lost(*spans_ms):
    """A fix whose status says that it is none, in some spans of time."""

    def make(stamp_ns):
        at = since(stamp_ns) * 1000
        return fix(stamp_ns, status=-1 if any(a <= at < b for a, b in spans_ms) else 0)

    return make


GAPS = {
    'single ones': [(start, start + 60) for start in range(2500, 6500, 300)],
    'a second': [(4000, 5000)],
    'two in a row': [(3000, 3250), (3300, 3900)],
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('container', ['mcap', 'sqlite3', 'ros1'])
@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
def test_a_packet_without_fix_lies_between_those_around_it(layout, container, tmp_path):
    said = (
        every(10, imu),
        every(50, lost(*GAPS['two in a row'])),
        every(20, lambda at: twist(at, 1)),
    )
    notes, losses, packets = convert(tmp_path, *said, layout=layout, container=container)
    assert losses == ()
    assert len(packets) == len(SCANS_NS)
    assert off_m(packets).max() < 0.11  # of the parabola's chord in 0.65 s
    (note,) = (line for line in notes if 'no fix beside' in line)
    assert note == (
        'oxts: /fix has no fix beside 9 frames, whose places lie between fixes that are up to'
        ' 0.65 s and 1.44 m apart'
    )


@pytest.mark.parametrize('name', GAPS)
def test_gaps_are_bridged_and_told_in_metres(name, tmp_path):
    notes, _, packets = convert(tmp_path, every(10, imu), every(50, lost(*GAPS[name])))
    assert len(packets) == len(SCANS_NS)
    assert off_m(packets).max() < 0.25
    (note,) = (line for line in notes if 'no fix beside' in line)
    assert note.endswith(' m apart')


def test_attitudes_are_those_of_the_frames(tmp_path):
    _, _, packets = convert(tmp_path, every(70, imu), every(50, lost((3000, 3300))))
    expected = [yaw(since(stamp_ns)) for stamp_ns in packets]
    np.testing.assert_allclose([packet.yaw for packet in packets.values()], expected, atol=3e-3)


def test_an_attitude_that_one_message_does_not_have_is_that_of_the_other(tmp_path):
    def alternating(stamp_ns):
        said = imu(stamp_ns)
        if stamp_ns // (20 * MS) % 2:
            said.values['orientation_covariance'] = np.array([-1.0, *[0.0] * 8])
        return said

    _, _, packets = convert(tmp_path, every(20, alternating), every(50, fix))
    expected = [yaw(since(stamp_ns)) for stamp_ns in packets]
    np.testing.assert_allclose([packet.yaw for packet in packets.values()], expected, atol=7e-3)


def test_in_a_longer_gap_there_is_no_packet(tmp_path):
    notes, _, packets = convert(tmp_path, every(10, imu), every(50, lost((3000, 6000))))
    assert 28 <= len(SCANS_NS) - len(packets) <= 30
    assert any(note.startswith('no fix near frames') for note in notes)
    assert off_m(packets).max() < 0.02


def test_before_the_first_and_after_the_last_fix_places_are_carried_a_little(tmp_path):
    fixes = every(200, fix, first_ms=2900, last_ms=6350)
    notes, _, packets = convert(tmp_path, every(10, imu), fixes)
    first, last = fixes[0].log_ns, fixes[-1].log_ns
    assert min(packets) >= first - 200 * MS
    assert max(packets) <= last + 200 * MS
    assert min(packets) < first - 80 * MS
    assert max(packets) > last + 80 * MS
    assert off_m(packets).max() < 0.06
    (note,) = (line for line in notes if 'take the nearest' in line)
    assert note.startswith('oxts: /fix has no message within the tolerance of ')
    assert ' s away, and are carried on by up to ' in note
    assert note.endswith(' m, by the velocity there')


@pytest.mark.parametrize('lon', [180.0, -179.99999, 179.99995])
def test_places_are_mixed_across_the_date_line(lon, tmp_path):
    origin = (-17.0, lon, 4.0)

    def make(stamp_ns):
        gone = 4000 <= since(stamp_ns) * 1000 < 4500
        return fix(stamp_ns, status=-gone, origin=origin)

    _, _, packets = convert(tmp_path, every(10, imu), every(100, make))
    assert len(packets) == len(SCANS_NS)
    assert off_m(packets, origin).max() < 0.1
    assert all(abs(packet.lon) <= 180 for packet in packets.values())
    assert off_m_s(packets).max() < 0.4


SOURCES = {
    'fixes alone': (every(100, fix),),
    'fixes of which two in five are lost': (
        every(100, lambda at: fix(at, status=-(at // (100 * MS) % 5 > 2))),
    ),
    'fixes at 5 Hz and an Imu': (every(200, fix), every(10, imu)),
    'fixes of an antenna': (every(50, lambda at: fix(at, antenna=True)), every(10, imu)),
    'a twist of zeros beside fixes': (every(50, fix), every(10, imu), every(20, twist)),
    'a still Odometry beside fixes': (
        every(50, fix),
        every(10, imu),
        every(20, odometry),
    ),
    'an Odometry of zeros': (every(20, odometry),),
    'an Odometry of zeros at 5 Hz': (every(200, odometry),),
    'a PoseStamped': (every(20, posed),),
    'transforms': (every(20, link),),
    'poses and a twist of zeros': (every(20, posed), every(20, twist)),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', SOURCES)
def test_velocities_are_derived_from_the_places_and_said(name, tmp_path):
    notes, losses, packets = convert(tmp_path, *SOURCES[name])
    assert losses == ()
    assert len(packets) == len(SCANS_NS) - ('lost' in name)  # the last fix is
    off = off_m_s(packets)
    # Where the vehicle drives off the acceleration jumps, and slow fixes are no motion.
    assert off.max() < 0.45
    times = np.array([since(stamp_ns) for stamp_ns in packets])
    assert off[times > 2.6].max() < (0.25 if 'lost' in name else 0.05)
    standing = [packets[stamp] for stamp in packets if since(stamp) < 1.6]
    assert {(each.vn, each.ve, each.vf, each.vl, each.vu) for each in standing} == {(0.0,) * 5}
    lines = [note for note in notes if 'are derived from the places of' in note]
    assert len(lines) == 1
    assert ('(all are 0)' in lines[0]) == ('zeros' in name)
    assert not any('are its axes others' in note for note in notes)


def test_forward_and_right_are_by_the_attitude(tmp_path):
    _, _, packets = convert(tmp_path, every(50, fix), every(10, imu))
    for stamp_ns, packet in packets.items():
        if since(stamp_ns) > 2.6:
            assert packet.vf == pytest.approx(speed(since(stamp_ns)), abs=0.05)
            assert packet.vl == pytest.approx(0.0, abs=0.05)


def wander(seed, size):
    """Places of a standing receiver: white noise about a slow drift."""
    rng = np.random.default_rng(seed)
    return lambda seconds: rng.normal(0, size, 3) + size * np.sin([seconds, seconds / 2, 1.0])


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('period_ms', 'size'), [(100, 0.0), (100, 0.02), (100, 0.05), (1000, 0.2), (250, 0.1)]
)
@pytest.mark.parametrize('zeros', [False, True])
def test_a_standing_vehicle_stays_at_0(period_ms, size, zeros, tmp_path, monkeypatch):
    monkeypatch.setattr('test_unit_places.STANDING_S', 1e9)
    monkeypatch.setattr('test_unit_places._WAY', np.zeros_like(_WAY))
    noise = wander(3, size)
    said = every(period_ms, lambda at: fix(at, noise=noise)), every(10, imu)
    notes, _, packets = convert(tmp_path, *said, *([every(20, twist)] if zeros else []))
    assert len(packets) == len(SCANS_NS)
    for packet in packets.values():
        assert (packet.vn, packet.ve, packet.vf, packet.vl, packet.vu) == (0.0,) * 5
    assert not any('derived from the places of' in note for note in notes)


def test_a_velocity_that_is_0_until_the_vehicle_drives_off_is_that_of_the_message(tmp_path):
    said = every(50, fix), every(10, imu), every(20, lambda at: twist(at, 0.5))
    notes, _, packets = convert(tmp_path, *said)
    last = packets[max(packets)]
    assert last.vf == pytest.approx(speed(since(max(packets))) / 2, rel=1e-3)
    assert not any('derived from the places' in note for note in notes)


def test_velocities_that_stop_go_on_by_the_places(tmp_path):
    said = every(50, fix), every(10, imu), every(20, lambda at: twist(at, 1), last_ms=4000)
    notes, _, packets = convert(tmp_path, *said)
    assert len(packets) == len(SCANS_NS)
    times = np.array([since(stamp_ns) for stamp_ns in packets])
    assert off_m_s(packets)[times > 2.6].max() < 0.12  # the twist is along a leaning body
    (note,) = (line for line in notes if 'derived from the places of' in line)
    assert note.startswith('oxts: the velocities of 29 packets')


@pytest.mark.parametrize(('known_s', 'where'), [(0.4, ' near frames 0-3, where'), (99, ';')])
def test_an_orientation_that_comes_late_is_said_by_its_frames(known_s, where, tmp_path):
    def late(stamp_ns):
        said = imu(stamp_ns)
        if since(stamp_ns) < known_s:
            said.values['orientation'] = dict.fromkeys('xyzw', 0.0)
        return said

    notes, _, packets = convert(tmp_path, every(50, fix), every(10, late))
    told = f'/imu: no orientation{where} roll, pitch and yaw are 0, and the places those of /fix'
    assert told in notes
    assert sum(packet.yaw == 0 for packet in packets.values()) == (
        4 if known_s < 1 else len(packets)
    )


def test_an_imu_alone_has_no_velocity(tmp_path):
    notes, _, packets = convert(tmp_path, every(10, imu))
    assert all(packet.ve == packet.vn == 0 for packet in packets.values())
    assert any('missing: velocity (TwistStamped); its columns of oxts are 0' in n for n in notes)
