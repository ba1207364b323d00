# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Markers stay until something takes them away, as in RViz."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rerun', reason='rerun-sdk is not installed')

from kitti_ros2.messages.cdr import deserialize, join
from kitti_ros2.messages.markers import encode_clear, encode_markers
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.ros_types import TYPESTORE, Marker, Point, Pose, Quaternion
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.options.messages import MarkerOptions

ARRAY = 'visualization_msgs/msg/MarkerArray'
T0 = 1_700_000_000_000_000_000
S = 1_000_000_000
POSE = Transform(rotation_from_rpy(0, 0, np.pi / 2), np.array([10.0, 2.0, 1.0]))
CAR = Cuboid('Car', '7', POSE, (4.0, 2.0, 1.5), None, 7)
FOREVER = TYPESTORE.types['builtin_interfaces/msg/Duration'](0, 0)
POSE_WITHOUT_TURN = Pose(Point(1.0, 2.0, 3.0), Quaternion(0.0, 0.0, 0.0, 0.0))
BOXES = '/marks/boxes/velo_link'


def ours(stamp_ns, *cuboids, **options):
    trails = {7: np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0]])}
    return encode_markers(cuboids, trails, stamp_ns, FrameNames(), MarkerOptions(**options))


def first(stamp_ns, **changes):
    """A box of ours by itself, changed."""
    array = deserialize(join(ours(stamp_ns, CAR, ego=False)), ARRAY)
    marker = next(each for each in array.markers if each.ns == 'box')
    for name, value in changes.items():
        setattr(marker, name, value)
    return marker


def as_array(*markers):
    message = TYPESTORE.types[ARRAY](list(markers))
    return ARRAY, bytes(TYPESTORE.serialize_cdr(message, ARRAY))


def as_one(marker):
    return Marker.__msgtype__, bytes(TYPESTORE.serialize_cdr(marker, Marker.__msgtype__))


def counts(rrd, entity=BOXES, component='Boxes3D:centers'):
    """How many are shown, by second."""
    return {(stamp - T0) // S: len(value) for stamp, value in rrd.having(entity, component)}


def test_our_markers_become_boxes_lines_arrows_and_texts(show_messages):
    rrd, report = show_messages(('/marks', T0, (ARRAY, join(ours(T0, CAR)))))
    np.testing.assert_allclose(rrd.one(BOXES, 'Boxes3D:centers'), [POSE.translation])
    np.testing.assert_allclose(rrd.one(BOXES, 'Boxes3D:half_sizes'), [(2.0, 1.0, 0.75)])
    assert len(rrd.one('/marks/boxes/base_link', 'Boxes3D:centers')) == 1
    edges = np.array(rrd.one('/marks/lines/velo_link', 'LineStrips3D:strips'))
    assert edges.shape == (12, 2, 3)
    # Turned by a quarter: the length lies along y.
    np.testing.assert_allclose(np.ptp(edges.reshape(-1, 3), axis=0), (2, 4, 1.5), atol=1e-5)
    (trail,) = rrd.one('/marks/lines/map', 'LineStrips3D:strips')
    assert np.array(trail).tolist() == [[0, 0, 0], [1, 0, 0], [2, 1, 0]]
    np.testing.assert_allclose(rrd.one('/marks/arrows/velo_link', 'Arrows3D:origins'), [(10, 2, 1)])
    (vector,) = rrd.one('/marks/arrows/velo_link', 'Arrows3D:vectors')
    np.testing.assert_allclose(vector, (0, 3, 0), atol=1e-5)
    (text,) = rrd.one('/marks/texts/velo_link', 'Points3D:labels')
    assert text.startswith('Car 7\n')
    assert report.notes == (BY_POSITION,)


def test_what_is_not_replaced_stays_and_what_is_deleted_goes(show_messages):
    both = [first(T0, id=number, lifetime=FOREVER) for number in (7, 8)]
    rrd, _ = show_messages(
        ('/marks', T0, as_array(*both)),
        ('/marks', T0 + S, as_array(first(T0 + S, id=7, lifetime=FOREVER))),
        ('/marks', T0 + 2 * S, as_array(first(T0, id=8, action=Marker.DELETE))),
        ('/marks', T0 + 3 * S, (ARRAY, join(encode_clear(T0, 'map')))),
    )
    assert counts(rrd) == {0: 2, 1: 2, 2: 1, 3: 0}


def test_what_has_outlived_its_lifetime_goes(show_messages):
    rrd, _ = show_messages(
        ('/marks', T0, as_array(first(T0, id=7), first(T0, id=8, lifetime=FOREVER))),
        ('/marks', T0 + S, as_array(first(T0 + S, id=9))),
    )
    assert counts(rrd) == {0: 2, 1: 2}


def test_a_marker_by_itself_and_a_turn_of_zeros(show_messages):
    rrd, _ = show_messages(('/one', T0, as_one(first(T0, pose=POSE_WITHOUT_TURN))))
    assert rrd.one('/one/boxes/velo_link', 'Boxes3D:quaternions') == [[0, 0, 0, 1]]


def test_an_arrow_without_points_lies_along_its_pose(show_messages):
    marker = first(T0, type=Marker.ARROW, points=[])
    rrd, _ = show_messages(('/one', T0, as_one(marker)))
    (vector,) = rrd.one('/one/arrows/velo_link', 'Arrows3D:vectors')
    np.testing.assert_allclose(vector, (0, 4, 0), atol=1e-5)


def test_other_types_are_noted_once(show_messages):
    ball = as_array(first(T0, type=Marker.SPHERE))
    _, report = show_messages(('/marks', T0, ball), ('/marks', T0 + S, ball))
    assert {*report.notes} == {BY_POSITION, '/marks: markers of type SPHERE are not shown'}
    assert not report.losses
