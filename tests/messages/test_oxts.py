# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Packets made of messages, against packets that messages were made of, and KITTI's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from kitti_ros2.kitti.kitti_recording import MercatorWorld, geographic_positions
from kitti_ros2.kitti.text_file import COLUMNS, format_packet, parse_packet
from kitti_ros2.messages.cdr import make_quaternion
from kitti_ros2.messages.oxts import (
    Mounting,
    encode_fix,
    encode_imu,
    encode_velocity,
    encode_velocity_with_covariance,
    has_fix,
    has_orientation,
    make_packet,
)
from kitti_ros2.messages.ros_types import NavSatFix, Quaternion, Vector3
from kitti_ros2.model.geometry import Transform, quaternion_to_rotation, rotation_from_rpy
from kitti_ros2.model.streams import GeoOrigin

STAMP = 1317042145951199337
FLOATS = COLUMNS[: COLUMNS.index('navstat')]
TOLD_BY = {
    'imu': ('roll', 'pitch', 'yaw', 'wx', 'wy', 'wz', 'ax', 'ay', 'az'),
    'fix': ('lat', 'lon', 'alt', 'pos_accuracy'),
    'velocity': ('vn', 've', 'vu'),
}
LEVELLED = ('af', 'al', 'au', 'wf', 'wl', 'wu', 'vf', 'vl')

SMALL = st.floats(-20, 20)
ANGLES = st.floats(-3.1, 3.1)
MOUNTINGS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES),
    st.tuples(SMALL, SMALL, SMALL),
)


def packet(**values):
    zeros = dict.fromkeys(COLUMNS, 0) | {'posmode': 3, 'velmode': -1, 'orimode': -1}
    made = zeros | values
    cr, sr = np.cos(made['roll']), np.sin(made['roll'])
    cp, sp = np.cos(made['pitch']), np.sin(made['pitch'])
    cy, sy = np.cos(made['yaw']), np.sin(made['yaw'])
    level = np.array([[cp, sp * sr, sp * cr], [0, cr, -sr], [-sp, cp * sr, cp * cr]])
    made['af'], made['al'], made['au'] = level @ [made['ax'], made['ay'], made['az']]
    made['wf'], made['wl'], made['wu'] = level @ [made['wx'], made['wy'], made['wz']]
    made['vf'] = made['ve'] * cy + made['vn'] * sy
    made['vl'] = -(-made['ve'] * sy + made['vn'] * cy)
    return parse_packet(' '.join(repr(float(made[name])) for name in COLUMNS), 'made')


PACKETS = st.builds(
    packet,
    lat=st.floats(-85, 85), lon=st.floats(-180, 180), alt=st.floats(-400, 9000),
    roll=ANGLES, pitch=st.floats(-1.5, 1.5), yaw=ANGLES,
    ve=SMALL, vn=SMALL, vu=SMALL, ax=SMALL, ay=SMALL, az=SMALL, wx=SMALL, wy=SMALL, wz=SMALL,
    pos_accuracy=st.floats(0, 100), posmode=st.sampled_from((3, 4, 7)),
).filter(lambda each: abs(each.lat) + abs(each.lon) > 1e-3)  # fmt: skip

PACKET = packet(
    lat=49.0, lon=8.4, alt=116.0, roll=0.03, pitch=-0.02, yaw=2.6, vn=-7.0, ve=-11.0, vu=0.1,
    ax=-0.4, ay=0.2, az=9.8, wx=0.01, wy=-0.02, wz=0.3, pos_accuracy=0.5,
)  # fmt: skip


def messages(source):
    return (
        encode_imu(source, STAMP, 'imu_link'),
        encode_fix(source, STAMP, 'imu_link'),
        encode_velocity(source, STAMP, 'imu_link'),
    )


def assert_same(made, expected, names=COLUMNS, tolerance=1e-9):
    for name in names:
        assert getattr(made, name) == pytest.approx(getattr(expected, name), abs=tolerance), name


@given(PACKETS)
def test_a_packet_comes_back_from_its_messages(source):
    made = make_packet(*messages(source))
    assert_same(made, source)
    modes = [0, 0, source.posmode, -1, -1]
    assert [getattr(made, name) for name in COLUMNS[-5:]] == modes


@given(PACKETS)
def test_what_is_made_can_be_written_and_read(source):
    made = make_packet(*messages(source))
    line = format_packet(made)
    assert len(line.split()) == len(COLUMNS)
    assert_same(parse_packet(line, 'written'), made)


def test_levelling_is_that_of_the_real_packets(real_kitti):
    """The bounds are those of the docstring: what is left is the unit's own delay and rounding."""
    bounds = {'0001': (0.025, 7e-5, 0.0005, 0.03), '0005': (0.06, 8e-4, 0.003, 0.08)}
    for drive, (acceleration, rate, forward, right) in bounds.items():
        folder = real_kitti / f'raw/2011_09_26/2011_09_26_drive_{drive}_sync/oxts/data'
        limits = dict.fromkeys(('af', 'al', 'au'), acceleration)
        limits |= dict.fromkeys(('wf', 'wl', 'wu'), rate) | {'vf': forward, 'vl': right}
        paths = sorted(folder.glob('*.txt'))
        assert len(paths) > 100
        for path in paths:
            real = parse_packet(path.read_text(), path)
            made = make_packet(*messages(replace(real, posmode=max(real.posmode, 3))))
            assert_same(made, real, [n for n in FLOATS if n not in (*LEVELLED, 'vel_accuracy')])
            for name, limit in limits.items():
                assert abs(getattr(made, name) - getattr(real, name)) < limit, (path, name)


@given(PACKETS, MOUNTINGS, MOUNTINGS)
def test_sensors_mounted_otherwise_tell_the_same(source, imu_t_frame, imu_t_velocity):
    imu, fix, velocity = messages(source)
    turned = imu_t_frame.rotation.T
    enu_r_imu = rotation_from_rpy(source.roll, source.pitch, source.yaw)
    imu.orientation = make_quaternion(
        Transform(enu_r_imu @ imu_t_frame.rotation, np.zeros(3)).quaternion()
    )
    rates = np.array([source.wx, source.wy, source.wz])
    imu.angular_velocity = Vector3(*(turned @ rates))
    imu.linear_acceleration = Vector3(*(turned @ [source.ax, source.ay, source.az]))
    there = source.body_velocity() + np.cross(rates, imu_t_velocity.translation)
    velocity.twist.linear = Vector3(*(imu_t_velocity.rotation.T @ there))
    velocity.twist.angular = Vector3(*(imu_t_velocity.rotation.T @ rates))
    mounting = Mounting(imu_t_frame, imu_t_velocity)
    made = make_packet(imu, fix, velocity, mounting=mounting)
    # A frame that looks straight up in the world is no trouble: only the imu's own pitch counts.
    assert_same(made, source, set(FLOATS) - {'roll', 'pitch', 'yaw'}, 1e-6)
    attitude = rotation_from_rpy(made.roll, made.pitch, made.yaw)
    np.testing.assert_allclose(attitude, enu_r_imu, atol=1e-9)
    alone = make_packet(None, None, velocity, mounting=mounting)
    assert_same(alone, source, ('wx', 'wy', 'wz'), 1e-9)


@given(PACKETS, MOUNTINGS)
def test_an_antenna_away_from_the_unit_tells_the_same(source, imu_t_antenna):
    assume(abs(source.lat) < 70)
    imu, fix, velocity = messages(source)
    world = MercatorWorld.at(source)
    antenna = (world.pose(source) @ imu_t_antenna).translation
    here = GeoOrigin(source.lat, source.lon, source.alt)
    there = GeoOrigin(*geographic_positions(np.array([np.zeros(3), antenna]), here)[1])
    fix = replace(fix, latitude=there.lat, longitude=there.lon, altitude=there.alt)
    made = make_packet(imu, fix, velocity, mounting=Mounting(imu_t_antenna=imu_t_antenna))
    np.testing.assert_allclose(world.pose(made).translation, np.zeros(3), atol=1e-3)
    for lacking in (None, replace(imu, orientation_covariance=np.array([-1.0, *[0.0] * 8]))):
        made = make_packet(lacking, fix, velocity, mounting=Mounting(imu_t_antenna=imu_t_antenna))
        assert (made.lat, made.lon, made.alt) == (there.lat, there.lon, there.alt)


@given(PACKETS, MOUNTINGS)
def test_a_velocity_along_east_and_north_tells_the_same(source, imu_t_velocity):
    imu, fix, velocity = messages(source)
    rates = np.array([source.wx, source.wy, source.wz])
    attitude = rotation_from_rpy(source.roll, source.pitch, source.yaw)
    lever = attitude @ np.cross(rates, imu_t_velocity.translation)
    velocity.twist.linear = Vector3(*(np.array([source.ve, source.vn, source.vu]) + lever))
    velocity.twist.angular = Vector3(9.0, 9.0, 9.0)
    mounting = Mounting(imu_t_velocity=imu_t_velocity, velocity_is_enu=True)
    assert_same(make_packet(imu, fix, velocity, mounting=mounting), source, FLOATS, 1e-6)


def test_a_fix_in_two_dimensions_is_moved_in_two():
    imu, fix, velocity = messages(PACKET)
    roof = Transform.from_translation((-1.0, 0.0, 1.5))
    made = make_packet(
        imu, replace(fix, altitude=np.nan), velocity, mounting=Mounting(imu_t_antenna=roof)
    )
    assert made.alt == 0
    assert made.lat != PACKET.lat


def test_an_imu_that_looks_up_is_as_good_as_any():
    """Pitch 90 degrees has no roll and yaw of its own; the quaternion is taken, not the angles."""
    frame = Transform(rotation_from_rpy(0.0, -np.pi / 2, 0.0), np.zeros(3))
    imu, fix, velocity = messages(PACKET)
    q = imu.orientation
    there = quaternion_to_rotation(np.array([q.x, q.y, q.z, q.w])) @ frame.rotation
    imu.orientation = make_quaternion(Transform(there, np.zeros(3)).quaternion())
    made = make_packet(imu, fix, velocity, mounting=Mounting(frame))
    assert_same(made, PACKET, ('roll', 'pitch', 'yaw'))


@pytest.mark.parametrize('absent', ['imu', 'fix', 'velocity'])
def test_a_stream_that_is_not_there_leaves_zeros(absent):
    parts = dict(zip(('imu', 'fix', 'velocity'), messages(PACKET), strict=True))
    made = make_packet(**(parts | {absent: None}))
    unknown = set(TOLD_BY[absent])
    if absent == 'imu':
        unknown -= {'wx', 'wy', 'wz'}  # the twist tells them too
    for name in unknown:
        assert getattr(made, name) == 0, name
    told = {name for part, names in TOLD_BY.items() if part != absent for name in names}
    if absent == 'imu':
        told -= {'vn', 've', 'vu'}  # without an attitude, those of a level body heading east
        assert made.vf == pytest.approx(PACKET.body_velocity()[0])
        assert made.vl == pytest.approx(-PACKET.body_velocity()[1])
    assert_same(made, PACKET, told)


def test_of_nothing_a_packet_of_zeros_is_made():
    made = make_packet(None, None, None)
    assert format_packet(made).split() == ['0'] * 27 + ['-1'] * 3


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('how', ['declared', 'zeros', 'nan'])
def test_without_orientation_the_attitude_is_0_and_the_rest_is_kept(how):
    imu, fix, velocity = messages(PACKET)
    assert has_orientation(imu)
    if how == 'declared':
        imu.orientation_covariance = np.array([-1.0] + [0.0] * 8)
    else:
        value = 0.0 if how == 'zeros' else np.nan
        imu.orientation = Quaternion(value, value, value, value)
    assert not has_orientation(imu)
    made = make_packet(imu, fix, velocity)
    assert (made.roll, made.pitch, made.yaw) == (0, 0, 0)
    assert_same(made, PACKET, (*TOLD_BY['fix'], 'wx', 'wy', 'wz', 'ax', 'ay', 'az'))
    assert (made.af, made.wl) == (made.ax, made.wy)


@pytest.mark.parametrize('how', ['declared', 'nan'])
def test_what_an_imu_does_not_know_is_0_or_from_the_twist(how):
    imu, fix, velocity = messages(PACKET)
    if how == 'declared':
        unknown = np.array([-1.0] + [0.0] * 8)
        imu.angular_velocity_covariance = imu.linear_acceleration_covariance = unknown
    else:
        imu.angular_velocity = imu.linear_acceleration = Vector3(0.0, np.nan, 0.0)
    made = make_packet(imu, fix, velocity)
    assert (made.ax, made.ay, made.az, made.af, made.al, made.au) == (0,) * 6
    assert_same(made, PACKET, ('wx', 'wy', 'wz', 'wl', 'vf'))
    assert make_packet(imu, fix, None).wz == 0


def test_a_velocity_that_is_no_number_is_0():
    imu, fix, velocity = messages(PACKET)
    velocity.twist.linear = Vector3(np.nan, 0.0, 0.0)
    made = make_packet(imu, fix, velocity)
    assert (made.vn, made.ve, made.vf, made.vl, made.vu) == (0,) * 5


@pytest.mark.parametrize(
    'changes',
    [
        {'latitude': np.nan},
        {'longitude': np.nan},
        {'latitude': 90.0},
        {'longitude': -361.0},
        {'altitude': np.inf},
        {'altitude': -1e6},
        {'latitude': 0.0, 'longitude': 0.0},
    ],
)
def test_a_position_that_is_none_makes_no_packet(changes):
    imu, fix, velocity = messages(PACKET)
    assert has_fix(fix)
    assert not has_fix(replace(fix, **changes))
    assert make_packet(imu, replace(fix, **changes), velocity) is None


@pytest.mark.parametrize('status', [-1, -2])
def test_a_receiver_without_a_fix_makes_no_packet(status):
    imu, fix, velocity = messages(PACKET)
    fix.status.status = status
    assert make_packet(imu, fix, velocity) is None


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(
    'changes',
    [
        {'position_covariance_type': NavSatFix.COVARIANCE_TYPE_UNKNOWN},
        {'position_covariance': np.full(9, -1.0)},
        {'position_covariance': np.full(9, np.nan)},
    ],
)
def test_an_accuracy_that_is_not_known_is_0(changes):
    _, fix, _ = messages(PACKET)
    made = make_packet(None, replace(fix, **changes), None)
    assert made.pos_accuracy == 0
    assert made.lat == PACKET.lat


def test_a_fix_without_altitude_has_altitude_0():
    _, fix, _ = messages(PACKET)
    made = make_packet(None, replace(fix, altitude=np.nan), None)
    assert (made.lat, made.alt) == (PACKET.lat, 0)


@given(PACKETS, st.floats(0, 5))
def test_the_velocity_with_covariance_is_the_velocity(made, accuracy):
    accurate = replace(made, vel_accuracy=accuracy)
    twist = encode_velocity_with_covariance(accurate, STAMP, 'imu_link')
    plain = encode_velocity(accurate, STAMP, 'imu_link')
    assert (twist.header, twist.twist.twist) == (plain.header, plain.twist)
    covariance = twist.twist.covariance.reshape(6, 6)
    assert covariance[0, 0] == pytest.approx((accuracy or 0.1) ** 2)
    assert (covariance == np.diag(np.diag(covariance))).all()


@given(PACKETS)
def test_covariances_of_an_imu_are_on_request(made):
    plain, sure = (encode_imu(made, STAMP, 'imu', covariances=on) for on in (False, True))
    for name in ('orientation', 'angular_velocity', 'linear_acceleration'):
        assert getattr(plain, name) == getattr(sure, name)
        assert not getattr(plain, f'{name}_covariance').any()
        assert (np.diag(getattr(sure, f'{name}_covariance').reshape(3, 3)) > 1e-9).all()
    assert make_packet(sure, None, None) == make_packet(plain, None, None)
