# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the markers show, read back from their CDR."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.drawing.labelled_objects import color_of
from kitti_ros2.messages.cdr import stamp_ns_of, transform_of
from kitti_ros2.messages.markers import encode_markers
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.ros_types import Marker
from kitti_ros2.model.boxes import EDGES, Cuboid, unit_corners
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.messages import MarkerColors, MarkerOptions

from decoded_message import decoded  # isort: skip

STAMP = 1317042145951199337
KINDS = {'box': Marker.CUBE, 'edges': Marker.LINE_LIST, 'heading': Marker.ARROW,
         'text': Marker.TEXT_VIEW_FACING}  # fmt: skip
OPTIONS = MarkerOptions()
TRAIL = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.1], [2.0, 1.0, 0.2]])

METRES = st.floats(-100, 100)
SIDES = st.floats(0.1, 15)
CUBOIDS = st.builds(
    Cuboid,
    class_name=st.sampled_from(['Car', 'Pedestrian', 'my-robot', 'Straßenbahn']),
    identity=st.just('9'),
    velo_T_box=st.builds(
        lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
        st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-pi, pi)),
        st.tuples(METRES, METRES, METRES),
    ),
    size_lwh=st.tuples(SIDES, SIDES, SIDES),
    score=st.none() | st.floats(0, 1),
    track_id=st.none() | st.integers(0, 10**6),
)


def cuboid(kind='Car', track_id=None, **values) -> Cuboid:
    place = Transform(rotation_from_rpy(0, 0, 0.3), np.array([3.0, -4.0, 0.0]))
    identity = '0' if track_id is None else str(track_id)
    return Cuboid(**{'class_name': kind, 'identity': identity, 'velo_T_box': place,
                     'size_lwh': (4.0, 1.8, 1.5), 'track_id': track_id} | values)  # fmt: skip


def markers(*cuboids, trails=None, options=OPTIONS, frames=None, stamp_ns=STAMP):
    parts = encode_markers(cuboids, trails or {}, stamp_ns, frames or FrameNames(), options)
    message = decoded(parts, 'visualization_msgs/msg/MarkerArray')
    return message.markers


def by_namespace(found):
    return {marker.ns: marker for marker in found}


def rgb(marker):
    return (marker.color.r, marker.color.g, marker.color.b)


def xyz(vector):
    return (vector.x, vector.y, vector.z)


def points_of(marker):
    return np.array([xyz(point) for point in marker.points])


@pytest.fixture(scope='module', autouse=True)
def _definitions():
    """Generated once, before hypothesis looks at the clock."""
    markers()


@given(st.lists(CUBOIDS, max_size=3), st.booleans())
def test_a_delete_all_comes_first_and_only_there(cuboids, ego):
    found = markers(*cuboids, options=replace(OPTIONS, ego=ego))
    assert [marker.action for marker in found] == [
        Marker.DELETEALL,
        *[Marker.ADD] * (ego + 4 * len(cuboids)),
    ]


def test_frames_without_objects_still_delete():
    [clear] = markers(options=replace(OPTIONS, ego=False))
    assert clear.action == Marker.DELETEALL
    assert stamp_ns_of(clear.header) == STAMP


@given(st.lists(CUBOIDS, max_size=3, unique_by=lambda one: one.track_id))
def test_a_namespace_per_kind_and_one_marker_of_each_per_object(cuboids):
    added = [marker for marker in markers(*cuboids) if marker.action == Marker.ADD]
    names = Counter(marker.ns for marker in added)
    assert names == Counter(dict.fromkeys(KINDS, len(cuboids)) | {'ego': 1}) - Counter()
    assert all(marker.type == KINDS.get(marker.ns, Marker.CUBE) for marker in added)


def test_no_two_markers_share_namespace_and_id():
    tracks = [cuboid(track_id=n) for n in (7, 0, 3)]
    for cuboids in (tracks, [cuboid()] * 3):
        names = Counter((m.ns, m.id) for m in markers(*cuboids, trails={7: TRAIL, 3: TRAIL}))
        assert set(names.values()) == {1}


def test_ids_are_the_tracks_over_frames_whatever_the_order():
    one, two = cuboid('Car', 5), cuboid('Van', 2)
    for present in ([one, two], [two, one], [one], [two]):
        found = {(m.id, m.ns): rgb(m) for m in markers(*present) if m.ns in KINDS}
        assert {number for number, _ in found} == {c.track_id for c in present}
        for other in present:
            expected = color_of(other.class_name, other.track_id, MarkerColors.CLASS)
            assert found[other.track_id, 'box'] == pytest.approx(expected)


def test_stamp_and_frames():
    for marker in markers(cuboid(track_id=1), trails={1: TRAIL}):
        frame = {'ego': 'base_link', 'trail': 'map'}.get(marker.ns, 'velo_link')
        assert (marker.header.frame_id, stamp_ns_of(marker.header)) == (frame, STAMP)
    frames = FrameNames(map='world', base='car', velo='lidar')
    found = by_namespace(markers(cuboid(track_id=1), trails={1: TRAIL}, frames=frames))
    assert [found[name].header.frame_id for name in ('ego', 'trail', 'box')] == [
        'car',
        'world',
        'lidar',
    ]


@given(CUBOIDS)
def test_the_cube_is_the_cuboid(one):
    box = by_namespace(markers(one))['box']
    np.testing.assert_allclose(
        transform_of(box.pose).matrix(), one.velo_T_box.matrix(), rtol=0, atol=1e-9
    )
    assert xyz(box.scale) == one.size_lwh
    assert box.color.a == pytest.approx(OPTIONS.alpha)


@given(CUBOIDS)
def test_edges_are_the_twelve_segments_of_the_cuboid(one):
    edges = by_namespace(markers(one))['edges']
    corners = one.velo_T_box.apply(unit_corners() * one.size_lwh)
    ends = transform_of(edges.pose).apply(points_of(edges)).reshape(12, 2, 3)
    np.testing.assert_allclose(ends, corners[EDGES], atol=1e-9)
    assert edges.color.a == 1
    assert edges.scale.x == pytest.approx(OPTIONS.line_width)


@given(CUBOIDS, st.floats(0.1, 5))
def test_the_arrow_runs_along_the_heading_and_out_of_the_box(one, reach):
    options = replace(OPTIONS, arrow_length=reach)
    arrow = by_namespace(markers(one, options=options))['heading']
    start, end = transform_of(arrow.pose).apply(points_of(arrow))
    forward = one.velo_T_box.rotation[:, 0]
    np.testing.assert_allclose(start, one.velo_T_box.translation, atol=1e-9)
    np.testing.assert_allclose(end - start, forward * (one.size_lwh[0] / 2 + reach), atol=1e-9)


@given(CUBOIDS)
def test_the_text_stands_above_the_box(one):
    text = by_namespace(markers(one))['text']
    corners = one.velo_T_box.apply(unit_corners() * one.size_lwh)
    middle = one.velo_T_box.translation
    assert text.pose.position.z >= middle[2] + one.size_lwh[2] / 2
    assert np.hypot(*(np.array(xyz(text.pose.position)) - middle)[:2]) <= np.ptp(corners)
    assert text.scale.z == pytest.approx(OPTIONS.text_height)


@pytest.mark.parametrize(
    ('one', 'text'),
    [
        (cuboid('Car'), 'Car 0\n5.0 m'),
        (cuboid('Cyclist', 17), 'Cyclist 17\n5.0 m'),
        (cuboid('my-robot', 2, score=0.256), 'my-robot 2 0.26\n5.0 m'),
    ],
)
def test_text_has_class_id_and_distance(one, text):
    assert by_namespace(markers(one))['text'].text == text


@given(CUBOIDS)
def test_what_rviz_asks_of_markers(one):
    found = markers(one, trails={1: TRAIL})
    for marker in found[1:]:
        q = marker.pose.orientation
        assert np.linalg.norm((q.x, q.y, q.z, q.w)) == pytest.approx(1, abs=1e-9)
        assert marker.color.a > 0
        needed = {Marker.CUBE: 'xyz', Marker.LINE_LIST: 'x', Marker.LINE_STRIP: 'x',
                  Marker.ARROW: 'xy', Marker.TEXT_VIEW_FACING: 'z'}  # fmt: skip
        assert all(getattr(marker.scale, axis) > 0 for axis in needed[marker.type])
        assert bool(marker.text) == (marker.type == Marker.TEXT_VIEW_FACING)
        lines = {Marker.LINE_LIST: 24, Marker.ARROW: 2, Marker.LINE_STRIP: len(TRAIL)}
        assert len(marker.points) == lines.get(marker.type, 0)


@pytest.mark.parametrize('lifetime_ns', [0, 300_000_000, 2_500_000_001])
def test_lifetime(lifetime_ns):
    for marker in markers(cuboid(), options=replace(OPTIONS, lifetime_ns=lifetime_ns))[1:]:
        assert marker.lifetime.sec * 10**9 + marker.lifetime.nanosec == lifetime_ns


def test_sizes_follow_the_options():
    options = MarkerOptions(alpha=0.5, line_width=0.1, text_height=1.0)
    found = by_namespace(markers(cuboid(track_id=1), trails={1: TRAIL}, options=options))
    assert found['box'].color.a == found['ego'].color.a == 0.5
    assert found['edges'].scale.x == found['trail'].scale.x == 0.1
    assert found['text'].scale.z == 1.0


def test_the_ego_car_stands_on_the_ground_of_base_link_and_can_be_left_out():
    ego = by_namespace(markers())['ego']
    assert (ego.header.frame_id, ego.type) == ('base_link', Marker.CUBE)
    assert ego.pose.position.z == pytest.approx(ego.scale.z / 2)
    assert ego.pose.position.y == 0
    # base_link is below the middle of the rear axle: most of the car is ahead of it.
    assert 0 < ego.pose.position.x < ego.scale.x / 2
    assert 'ego' not in by_namespace(markers(options=replace(OPTIONS, ego=False)))


def test_trails_are_lines_in_map():
    found = {m.id: m for m in markers(trails={4: TRAIL, 2: TRAIL[:2]}) if m.ns == 'trail'}
    assert list(found) == [2, 4]
    assert found[4].type == Marker.LINE_STRIP
    np.testing.assert_array_equal(points_of(found[4]), TRAIL)
    assert transform_of(found[4].pose).matrix().tolist() == np.eye(4).tolist()


# Colours.


def test_a_colour_per_class():
    known = ['Car', 'Van', 'Truck', 'Tram', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Misc']
    colors = {color_of(kind, 0, MarkerColors.CLASS) for kind in known}
    assert len(colors) == len(known)
    for kind in (*known, 'my-robot'):
        assert len({color_of(kind, n, MarkerColors.CLASS) for n in range(9)}) == 1


def test_a_colour_per_track():
    colors = {color_of('Car', n, MarkerColors.TRACK) for n in range(50)}
    assert len(colors) == 50
    for n in range(9):
        assert len({color_of(k, n, MarkerColors.TRACK) for k in ('Car', 'Van', 'x')}) == 1
    options = replace(OPTIONS, colors=MarkerColors.TRACK)
    found = by_namespace(markers(cuboid('Van', 3), trails={3: TRAIL}, options=options))
    expected = color_of('Van', 3, MarkerColors.TRACK)
    for name in ('box', 'edges', 'heading', 'trail'):
        assert rgb(found[name]) == pytest.approx(expected)


@given(
    st.sampled_from(['Car', '', 'my-robot', 'Straßenbahn']),
    st.integers(-1, 2**31 - 1),
    st.sampled_from(list(MarkerColors)),
)
def test_colours_are_within_range(kind, number, colors):
    assert all(0 <= value <= 1 for value in color_of(kind, number, colors))


def test_unknown_classes_have_the_same_colours_in_every_run():
    kinds = ['my-robot', 'Bus', 'Straßenbahn']
    program = (
        'from kitti_ros2.drawing.labelled_objects import color_of; '
        'from kitti_ros2.options.messages import MarkerColors; '
        f'print([color_of(kind, 0, MarkerColors.CLASS) for kind in {kinds}])'
    )
    said = subprocess.run(
        [sys.executable, '-c', program],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, 'PYTHONHASHSEED': '12345', 'PYTHONPATH': os.pathsep.join(sys.path)},
    ).stdout.strip()
    here = [color_of(kind, 0, MarkerColors.CLASS) for kind in kinds]
    assert said == str(here)
    assert len(set(here)) == len(kinds)


@pytest.mark.parametrize(
    'wrong',
    [
        {'alpha': 1.1},
        {'alpha': -0.1},
        {'alpha': float('nan')},
        {'line_width': 0.0},
        {'arrow_length': -1.0},
        {'text_height': float('inf')},
        {'lifetime_ns': -1},
    ],
)
def test_wrong_options_are_refused(wrong):
    [name] = wrong
    with pytest.raises(UsageError, match=name.removesuffix('_ns')):
        MarkerOptions(**wrong)
