# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The GPS/IMU unit between two of its messages, and what a frame takes where one is missing."""

from __future__ import annotations

from dataclasses import replace

import foreign
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.oxts_packets import fix_between, imu_between, velocity_between
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.text_file import parse_packet
from kitti_ros2.messages.cdr import make_header, make_quaternion, make_vector3, vector_of
from kitti_ros2.messages.ros_types import Imu, NavSatFix, NavSatStatus, Twist, TwistStamped
from kitti_ros2.model.geometry import Transform, quaternion_to_rotation, rotation_from_rpy
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

SHARES = st.floats(0, 1)
YAWS = st.floats(-3, 3)
TRUTH = foreign.make_truth()
UNKNOWN = np.array([-1.0, *[0.0] * 8])


def imu(yaw, rate=(0.0, 0.0, 0.1), sensed=(0.1, 0.0, 9.8)):
    turn = Transform(rotation_from_rpy(0.01, -0.02, yaw), np.zeros(3))
    nothing = np.zeros(9)
    return Imu(
        make_header(0, 'imu'), make_quaternion(turn.quaternion()), nothing,
        make_vector3(rate), nothing, make_vector3(sensed), nothing,
    )  # fmt: skip


def fix(latitude, longitude, altitude=100.0, status=0):
    place = latitude, longitude, altitude
    return NavSatFix(make_header(0, 'gps'), NavSatStatus(status, 1), *place, np.zeros(9), 0)


def rotation(message):
    q = message.orientation
    return quaternion_to_rotation(np.array([q.x, q.y, q.z, q.w]))


@given(YAWS, st.floats(-3, 3), SHARES)
def test_a_steady_turn_is_met(yaw, turn, share):
    first, last = imu(yaw, (0, 0, 1), (1, 2, 9)), imu(yaw + turn, (0, 0, 3), (2, 0, 10))
    mixed = imu_between(first, last, share)
    expected = rotation_from_rpy(0, 0, share * turn) @ rotation(first)
    np.testing.assert_allclose(rotation(mixed), expected, atol=1e-9)
    np.testing.assert_allclose(vector_of(mixed.angular_velocity), [0, 0, 1 + 2 * share], atol=1e-12)
    sensed = [1 + share, 2 - 2 * share, 9 + share]
    np.testing.assert_allclose(vector_of(mixed.linear_acceleration), sensed, atol=1e-12)


@given(SHARES)
def test_what_one_does_not_tell_is_that_of_the_nearer(share):
    first = replace(imu(0.0), orientation_covariance=UNKNOWN)
    last = replace(imu(1.0, (np.nan, 0, 0)), linear_acceleration_covariance=UNKNOWN)
    mixed, near = imu_between(first, last, share), last if share > 0.5 else first
    assert mixed.orientation == last.orientation
    assert mixed.orientation_covariance is last.orientation_covariance
    assert mixed.angular_velocity is near.angular_velocity
    assert mixed.linear_acceleration == near.linear_acceleration


@given(SHARES, st.floats(-80, 80), st.floats(-170, 170))
def test_places_lie_on_the_line(share, latitude, longitude):
    assume(latitude or longitude)
    first, last = fix(latitude, longitude), fix(latitude + 0.01, longitude - 0.02, 110.0)
    mixed = fix_between(first, last, share)
    assert mixed.latitude == pytest.approx(latitude + 0.01 * share)
    assert mixed.longitude == pytest.approx(longitude - 0.02 * share)
    assert mixed.altitude == pytest.approx(100 + 10 * share)


@pytest.mark.parametrize(
    ('first', 'last', 'share', 'taken'),
    [
        (fix(1, 2), fix(1, 3, status=-1), 0.9, 0),
        (fix(1, 2, status=-1), fix(1, 3), 0.1, 1),
    ],
)
def test_a_place_without_a_line_is_that_of_one(first, last, share, taken):
    assert fix_between(first, last, share) is (first, last)[taken]


@pytest.mark.parametrize(
    ('first', 'last', 'share', 'longitude'),
    [
        (179.99, -179.99, 0.25, 179.995),
        (179.99, -179.99, 0.75, -179.995),
        (-179.99, 179.99, 0.25, -179.995),
        (359.9, 360.0, 0.5, 359.95),
        (359.99, 0.01, 0.25, 359.995),
    ],
)
def test_longitudes_are_mixed_the_short_way_round(first, last, share, longitude):
    assert fix_between(fix(1, first), fix(1, last), share).longitude == pytest.approx(longitude)


@pytest.mark.parametrize('share', [0.2, 0.8])
def test_an_altitude_that_one_has_alone_is_taken(share):
    for ends in ((np.nan, 110.0), (110.0, np.nan)):
        mixed = fix_between(*(fix(1, 2, altitude) for altitude in ends), share)
        assert mixed.altitude == 110


@given(SHARES)
def test_velocities_are_mixed(share):
    slow, fast = (
        TwistStamped(make_header(0, 'imu'), Twist(make_vector3((x, 0, 1)), make_vector3((0, x, 0))))
        for x in (1.0, 3.0)
    )
    mixed = velocity_between(slow, fast, share)
    np.testing.assert_allclose(vector_of(mixed.twist.linear), [1 + 2 * share, 0, 1])
    np.testing.assert_allclose(vector_of(mixed.twist.angular), [0, 1 + 2 * share, 0])


def converted(tmp_path, change):
    """Report, and the packets by frame."""
    bag = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, change=change)
    options, survey = ImportOptions(layout=Layout.RAW), survey_bags([bag])
    plan = guess([bag], survey, options).plan
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    texts = sorted((tmp_path / 'out').rglob('oxts/data/*.txt'))
    return report, {int(text.stem): parse_packet(text.read_text(), text) for text in texts}


def test_a_message_that_cannot_be_decoded_is_bridged(tmp_path):
    """Every fourth Imu is cut short: no frame has two such beside it."""

    def change(topic, place, message):
        return (b'\0\1\0\0',) if topic == '/imu/data' and place % 4 == 0 else message

    report, packets = converted(tmp_path, change)
    assert len(packets) == foreign.FRAMES
    assert {loss.stream for loss in report.losses} == {'/imu/data'}
    assert all(packet.wz == pytest.approx(0.2) for packet in packets.values())


def test_places_that_are_not_around_a_frame_are_told(tmp_path):
    """No fix at first, which the nearest bridges, and two lost later, which lie between others."""

    def change(topic, place, message):
        lost = topic == '/gps/fix' and (place < 2 or 3 < place < 6)
        return replace(message, status=replace(message.status, status=-1)) if lost else message

    report, packets = converted(tmp_path, change)
    assert len(packets) < foreign.FRAMES
    (note,) = (line for line in report.notes if line.startswith('oxts: /gps/fix has no message'))
    assert 'take the nearest: up to 0.' in note
    (note,) = (line for line in report.notes if line.startswith('oxts: /gps/fix has no fix'))
    assert note.endswith(' m apart')
