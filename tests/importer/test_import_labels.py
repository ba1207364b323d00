# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detections and markers become the labels they would have come from."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from types import SimpleNamespace as Some

import numpy as np
import pytest
from counted_calls import calls_of
from hypothesis import assume, given
from hypothesis import strategies as st

from kitti_ros2.importer.box_labels import ImageOf, TrackIds, class_name, lean_angles, make_boxes
from kitti_ros2.kitti.label_file import format_object_labels
from kitti_ros2.messages.cdr import deserialize, join, make_header
from kitti_ros2.messages.detections import (
    ABSURD,
    AS_LINES,
    cuboids_of_detections,
    cuboids_of_markers,
    encode_detections,
    has_scores,
)
from kitti_ros2.messages.markers import encode_markers
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.ros_types import Marker, Point, Pose, Quaternion, Vector3
from kitti_ros2.model.boxes import (
    Box,
    Cuboid,
    alpha_of,
    box_corners,
    clip_bounds,
    cuboid_of,
    project_corners,
    unit_corners,
)
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import CameraCalibration, rect_from_velo
from kitti_ros2.options.messages import MarkerOptions
from kitti_ros2.synthetic.scene import make_calibration

from builders import parse_boxes  # isort: skip

SIZE = (1242, 375)
RECT_T_VELO = Transform.from_quaternion(
    rect_from_velo(make_calibration(SIZE)).quaternion(), (0.0, -0.08, -0.27)
)
RIG = replace(make_calibration(SIZE), r0_rect=np.eye(3), cam0_T_velo=RECT_T_VELO)
HERE = {'velo_link': Transform.identity()}
CUBE, LINES, CUBES, TEXT = 1, 5, 6, 9
ADD, DELETE, DELETE_ALL = 0, 2, 3

SIDES = st.floats(0.3, 12)
BOXES = st.builds(
    lambda kind, size, at, heading, track, score: Box(
        kind, 0, 0, 0, (0, 0, 0, 0), size, at, heading, score, None, track
    ),
    st.sampled_from(['Car', 'Pedestrian', 'Person_sitting', 'my-robot', 'Straßenbahn']),
    st.tuples(SIDES, SIDES, SIDES),
    st.tuples(st.floats(-30, 30), st.floats(-3, 4), st.floats(-10, 80)),
    st.floats(-pi, pi),
    st.integers(0, 10**6),
    st.none() | st.floats(0.01, 0.99),
)


def decoded(parts, msgtype):
    return deserialize(join(parts), msgtype)


def as_detections(boxes, frame='velo_link'):
    cuboids = [cuboid_of(box, str(box.track_id), RECT_T_VELO) for box in boxes]
    return decoded(encode_detections(cuboids, 5, frame), 'vision_msgs/msg/Detection3DArray')


def as_markers(boxes):
    cuboids = [cuboid_of(box, str(box.track_id), RECT_T_VELO) for box in boxes]
    options = MarkerOptions(ego=True, trails=True)
    trails = {1: np.arange(6.0).reshape(2, 3)}
    parts = encode_markers(cuboids, trails, 5, FrameNames(), options)
    return decoded(parts, 'visualization_msgs/msg/MarkerArray')


def labels(cuboids, camera=2, rig=RIG, **options):
    return make_boxes(cuboids, rig, ImageOf(camera, SIZE), TrackIds(), **options)


def truth(box: Box, camera=2):
    """(4,) bounds and truncation of a box, computed one by one."""
    corners = box_corners(box.location, box.size_hwl, box.rotation_y)
    return [found[0] for found in clip_bounds(project_corners(corners, p_rect(camera)), SIZE)]


def p_rect(camera):
    return RIG.cameras[camera].p_rect


def assert_same(made: Box, box: Box, camera=2):
    assert (made.class_name, made.track_id, made.occluded) == (box.class_name, box.track_id, 0)
    np.testing.assert_allclose(made.location, box.location, atol=1e-6)
    np.testing.assert_allclose(made.size_hwl, box.size_hwl, rtol=1e-9)
    assert abs(np.angle(np.exp(1j * (made.rotation_y - box.rotation_y)))) < 1e-6
    alpha = alpha_of(box.location, box.rotation_y)[0]
    assert abs(np.angle(np.exp(1j * (made.alpha - alpha)))) < 1e-6
    bounds, truncated = truth(box, camera)
    np.testing.assert_allclose(made.box_2d, bounds, atol=0.05)
    assert made.truncated == pytest.approx(truncated, abs=1e-3)
    assert -pi <= made.rotation_y <= pi
    assert -pi <= made.alpha <= pi


def in_sight(boxes):
    """Those that camera 2 sees, with room to tell."""
    assume(len({box.track_id for box in boxes}) == len(boxes))
    corners = [box_corners(box.location, box.size_hwl, box.rotation_y)[0] for box in boxes]
    assume(all(abs(corner[:, 2]).min() > 0.3 for corner in corners))
    assume(all(np.hypot(box.location[0], box.location[2]) > 0.5 for box in boxes))
    return [box for box in boxes if np.isfinite(truth(box)[0]).all()]


@given(st.lists(BOXES, max_size=4))
def test_labels_come_back_from_our_own_detections(boxes):
    seen = in_sight(boxes)
    cuboids, left_out = cuboids_of_detections(as_detections(boxes), HERE)
    assert left_out == []
    made, unseen = labels(cuboids)
    assert unseen == len(boxes) - len(seen)
    predicted = any(box.score is not None for box in boxes)
    for one, box in zip(made, seen, strict=True):
        assert_same(one, box)
        assert one.score == ((box.score or 1.0) if predicted else None)


@given(st.lists(BOXES, max_size=4))
def test_labels_come_back_from_our_own_markers(boxes):
    seen = in_sight(boxes)
    cuboids, left_out = cuboids_of_markers(as_markers(boxes), HERE)
    assert left_out == []
    made, unseen = labels([replace(cuboid, track_id=None) for cuboid in cuboids])
    assert unseen == len(boxes) - len(seen)
    for one, box in zip(made, seen, strict=True):
        assert one.score is None
        assert_same(one, replace(box, track_id=one.track_id))


def test_tracks_of_our_own_markers_are_their_ids():
    boxes = [replace(car(), track_id=track) for track in (7, 3, 900)]
    cuboids, _ = cuboids_of_markers(as_markers(boxes), HERE)
    assert [box.track_id for box in labels(cuboids)[0]] == [7, 3, 900]


def test_other_cameras_have_other_bounds():
    cuboids, _ = cuboids_of_detections(as_detections([car()]), HERE)
    (left,), (right,) = labels(cuboids, 2)[0], labels(cuboids, 3)[0]
    assert_same(left, car(), 2)
    assert_same(right, car(), 3)
    assert left.box_2d[0] > right.box_2d[0]


def car(**values) -> Box:
    kept = Box('Car', 0, 0, 0, (0, 0, 0, 0), (1.5, 1.7, 4.2), (1.0, 1.6, 12.0), 0.3, None, None, 5)
    return replace(kept, **values)


def cuboid(**values) -> Cuboid:
    return replace(cuboid_of(car(), '5', RECT_T_VELO), **values)


def test_boxes_of_another_frame_are_brought_to_the_scanner():
    pose = Transform(rotation_from_rpy(0.1, 0.2, 2.0), np.array([1.0, 2.0, 3.0]))
    cuboids, _ = cuboids_of_detections(as_detections([car()], 'base'), {'base': pose})
    expected = pose @ cuboid().velo_T_box
    np.testing.assert_allclose(cuboids[0].velo_T_box.matrix(), expected.matrix(), atol=1e-12)


def test_a_box_that_leans_with_its_sensor_keeps_its_place_and_heading():
    """A level box seen by a camera that nods: location and heading to the lean, no more."""
    leaning = replace(RIG, r0_rect=rotation_from_rpy(np.radians(12), 0, 0) @ RIG.r0_rect)
    (box,), _ = labels([cuboid()], rig=leaning)
    middle = rect_from_velo(leaning).apply(cuboid().velo_T_box.translation[None])[0]
    np.testing.assert_allclose(np.array(box.location) - [0, 0.75, 0], middle, atol=1e-9)
    assert np.degrees(lean_angles([cuboid()], leaning)) == pytest.approx([12], abs=0.01)
    assert lean_angles([cuboid()], RIG).max() < 1e-6
    assert len(lean_angles([], RIG)) == 0


@pytest.mark.parametrize(
    'turn',
    [(0, 2, 0), (2, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 1)],
    ids='quarters of {0[0]} {0[1]} {0[2]}'.format,
)
def test_a_box_of_other_axes_fills_the_same_space(turn):
    """Such as of a detector that works in the optical frame, where z is ahead."""
    rotation = np.round(rotation_from_rpy(*np.multiply(turn, pi / 2)))
    sides = np.abs(rotation.T @ np.array(cuboid().size_lwh))
    turned = Transform(rotation, np.zeros(3))
    other = cuboid(velo_T_box=cuboid().velo_T_box @ turned, size_lwh=tuple(sides))
    (box,), _ = labels([other])
    (plain,), _ = labels([cuboid()])
    np.testing.assert_allclose(box.box_2d, plain.box_2d, atol=1e-6)
    np.testing.assert_allclose(box.location, plain.location, atol=1e-9)
    corners = [
        box_corners(each.location, each.size_hwl, each.rotation_y)[0] for each in (box, plain)
    ]
    gaps = np.linalg.norm(corners[0][:, None] - corners[1], axis=2)
    assert gaps.min(axis=1).max() < 1e-6
    assert lean_angles([other], RIG).max() < 1e-6


def test_the_heading_of_an_upside_down_box_is_kept():
    over = Transform(rotation_from_rpy(pi, 0, 0), np.zeros(3))
    (box,), _ = labels([cuboid(velo_T_box=cuboid().velo_T_box @ over)])
    assert box.rotation_y == pytest.approx(0.3, abs=1e-9)


def test_boxes_out_of_view_are_counted_or_kept_as_asked():
    behind, aside = car(location=(0, 1.6, -9.0)), car(location=(60.0, 1.6, 12.0))
    cuboids, _ = cuboids_of_detections(as_detections([behind, car(), aside]), HERE)
    boxes, unseen = labels(cuboids)
    assert (len(boxes), unseen) == (1, 2)
    boxes, unseen = labels(cuboids, out_of_view=True)
    assert (len(boxes), unseen) == (3, 0)
    assert boxes[0].box_2d == (-1, -1, -1, -1)
    assert [box.truncated for box in (boxes[0], boxes[2])] == [1, 1]
    text = format_object_labels(boxes)
    assert [box.location for box in parse_boxes(text, 'x')] == [
        tuple(round(value, 2) for value in box.location) for box in boxes
    ]


def test_a_box_half_out_of_the_image_is_half_truncated():
    depth = 12.0
    x = float(-depth * p_rect(2)[0, 2] / p_rect(2)[0, 0] - p_rect(2)[0, 3] / p_rect(2)[0, 0])
    (box,), _ = labels([cuboid_of(car(location=(x, 1.6, depth), rotation_y=0), '', RECT_T_VELO)])
    assert box.box_2d[0] == 0
    assert 0.4 < box.truncated < 0.6


def test_no_boxes_are_no_labels():
    assert labels([]) == ([], 0)
    assert cuboids_of_detections(as_detections([]), HERE) == ([], [])
    assert cuboids_of_markers(Some(markers=[]), HERE) == ([], [])


def test_cameras_with_extrinsics_of_their_own_see_with_them():
    cam_t_velo = Transform(rotation_from_rpy(0, 0.4, 0), np.array([0.2, 0, 0])) @ RECT_T_VELO
    pinhole = np.column_stack([p_rect(0)[:, :3], np.zeros(3)])
    camera = CameraCalibration(pinhole, SIZE, cam_T_velo=cam_t_velo)
    rig = replace(RIG, cameras={**RIG.cameras, 1: camera})
    (box,), _ = labels([cuboid()], 1, rig)
    corners = cuboid().velo_T_box.apply(unit_corners() * cuboid().size_lwh)
    bounds = project_corners(cam_t_velo.apply(corners)[None], pinhole)
    np.testing.assert_allclose(box.box_2d, clip_bounds(bounds, SIZE)[0][0], atol=0.01)
    np.testing.assert_allclose(box.location, car().location, atol=1e-6)


# Of detections.


def detection(result=None, frame='velo_link', **values):
    (made,) = as_detections([car()], frame).detections
    results = [] if result is None else [result]
    kept = {'header': made.header, 'results': results, 'bbox': made.bbox, 'id': '5'}
    return Some(**kept | values)


def result(kind, score):
    return Some(hypothesis=Some(class_id=kind, score=score))


def array(*detections, frame='velo_link'):
    return Some(header=make_header(5, frame), detections=list(detections))


def test_the_best_result_counts():
    results = [result('Van', 0.2), result('Car', 0.7), result('Bus', 0.1)]
    (box,), _ = cuboids_of_detections(array(detection(results=results)), HERE)
    assert (box.class_name, box.score) == ('Car', 0.7)


def test_a_detection_without_result_is_of_no_class():
    (box,), _ = cuboids_of_detections(array(detection()), HERE, scores=True)
    assert (box.class_name, box.score) == ('', None)
    assert labels([box])[0][0].class_name == 'Misc'


@pytest.mark.parametrize(
    ('scores', 'predicted'),
    [((1.0, 1.0), False), ((0.0,), False), ((1.0, 0.0), False), ((1.0, 0.4), True), ((), False)],
)
def test_scores_that_are_all_0_or_1_are_none(scores, predicted):
    message = array(*(detection(result('Car', score)) for score in scores))
    assert has_scores(message) == predicted
    cuboids, _ = cuboids_of_detections(message, HERE)
    assert [each.score for each in cuboids] == [score if predicted else None for score in scores]


def test_a_recording_with_scores_has_them_in_every_frame():
    cuboids, _ = cuboids_of_detections(array(detection(result('Car', 1.0))), HERE, scores=True)
    assert cuboids[0].score == 1.0
    assert not has_scores(Some(markers=[]))


def test_the_definitions_of_older_distributions_are_understood():
    old = detection(Some(id=3, score=0.5))
    del old.id
    (box,), _ = cuboids_of_detections(array(old), HERE)
    assert (box.class_name, box.score, box.identity) == ('3', 0.5, '')
    old = detection(Some(id='Car', score=0.5), tracking_id='9', id='')
    (box,), _ = cuboids_of_detections(array(old), HERE)
    assert (box.class_name, box.identity) == ('Car', '9')


def test_the_array_s_frame_stands_in_for_an_empty_one():
    nameless = detection(header=make_header(5, ''))
    cuboids, _ = cuboids_of_detections(array(nameless, frame='/velo_link'), HERE)
    assert len(cuboids) == 1


@pytest.mark.parametrize('read', [cuboids_of_detections, cuboids_of_markers])
def test_a_frame_that_is_not_joined_is_refused(read):
    message = Some(**vars(array(detection(frame='map'))), markers=[marker(frame='map')])
    with pytest.raises(ValueError, match="a box in frame 'map'"):
        read(message, HERE)


# Of markers.


def marker(kind=CUBE, ns='car', number=5, text='', action=ADD, frame='velo_link', **values):
    (cube,) = [each for each in as_markers([car()]).markers if each.ns == 'box']
    kept = {'header': make_header(5, frame), 'ns': ns, 'id': number, 'type': kind, 'text': text,
            'action': action, 'pose': cube.pose, 'scale': cube.scale}  # fmt: skip
    return Some(**kept | values)


def kinds(*markers):
    return [
        class_name(each.class_name) for each in cuboids_of_markers(Some(markers=markers), HERE)[0]
    ]


def test_the_numbers_are_those_of_the_definition():
    assert (Marker.CUBE, Marker.LINE_LIST, Marker.CUBE_LIST) == (CUBE, LINES, CUBES)
    assert (Marker.TEXT_VIEW_FACING, Marker.ADD) == (TEXT, ADD)
    assert (Marker.DELETE, Marker.DELETEALL) == (DELETE, DELETE_ALL)


@pytest.mark.parametrize(
    ('ns', 'text', 'caption', 'expected'),
    [
        ('box', '', 'Car 5\n12.3 m', 'Car'),
        ('box', '', 'Person (sitting) 5 0.87\n12.3 m', 'Person_(sitting)'),
        ('box', '', 'car: 0.87', 'car'),
        ('box', '', 'Car 5 far away', 'Car'),
        ('bounding_boxes', '', 'ID 7', 'Misc'),
        ('detected_objects_3d', '', '0.87', 'Misc'),
        ('/perception/car', '', '', 'car'),
        ('car', '', '5.2 m/s', 'car'),
        ('car', 'Truck', 'Bus', 'Truck'),
        ('Car', '', 'label: Van', 'Van'),
        ('', '', '', 'Misc'),
        ('track_boxes', '', '#12', 'Misc'),
    ],
)
def test_the_class_of_a_cube_is_its_text_or_caption_or_namespace(ns, text, caption, expected):
    classes = kinds(marker(ns=ns, text=text), marker(TEXT, 'labels', text=caption))
    assert classes == [expected]


@pytest.mark.parametrize(
    ('caption', 'score'),
    [
        ('car: 0.87', 0.87),
        ('Car 5 .5\n12.3 m', 0.5),
        ('car 87%', 0.87),
        ('car (1.00)', 1.0),
        ('Car 0.5 m', None),
        ('Car 1.73', None),
        ('Car 7', None),
        ('', None),
    ],
)
def test_a_caption_may_have_a_score(caption, score):
    message = Some(markers=[marker(), marker(TEXT, 'labels', text=caption)])
    (with_score,), _ = cuboids_of_markers(message, HERE, scores=True)
    (without,), _ = cuboids_of_markers(message, HERE)
    assert (with_score.score, without.score) == (score, None)


def test_captions_go_with_the_cube_of_their_namespace():
    classes = kinds(
        marker(ns='a', number=0), marker(ns='b', number=0),
        marker(TEXT, 'a_text', 0, 'Bus'), marker(TEXT, 'b_text', 0, 'Tram'),
    )  # fmt: skip
    assert classes == ['Bus', 'Tram']


@given(
    st.dictionaries(
        st.tuples(
            st.sampled_from(['', 'box', 'box_id', 'boxes', 'label', '\U0010ffff']),
            st.integers(0, 2),
        ),
        st.sampled_from([CUBE, TEXT, LINES]),
        max_size=12,
    )
)
def test_captions_are_found_as_by_looking_at_all_markers_for_each_cube(kind_of):
    shown = [
        marker(kind, ns, number, 'k' * (place + 2) if kind == TEXT else '')
        for place, ((ns, number), kind) in enumerate(kind_of.items())
    ]
    expected = []
    for cube in (each for each in shown if each.type == CUBE):
        of_id = [each for each in shown if each.id == cube.id]
        texts = [each.text for each in of_id if each.type == TEXT]
        near = [
            each.text
            for each in of_id
            if each.type == TEXT and cube.ns and each.ns.startswith(cube.ns)
        ]
        alone = sum(each.type == CUBE for each in of_id) == 1
        expected.append(next(iter(near or (texts if alone else [])), 'Misc'))
    assert kinds(*shown) == expected


def test_twice_the_cubes_cost_twice():
    def decoded(size):
        shown = [
            each
            for number in range(size)
            for each in (marker(number=number), marker(TEXT, 'labels', number, 'Van 0.87'))
        ]
        return calls_of(lambda: cuboids_of_markers(Some(markers=shown), HERE, scores=True))

    assert decoded(400) < 2.3 * decoded(200)


def test_what_is_deleted_is_not_there_and_what_is_changed_is_there_once():
    cubes = [marker(number=n) for n in range(3)]
    cuboids, _ = cuboids_of_markers(
        Some(markers=[*cubes, marker(action=DELETE, number=1), marker(number=2)]), HERE
    )
    assert [each.identity for each in cuboids] == ['car/0', 'car/2']
    wiped = [*cubes, marker(action=DELETE_ALL), marker(number=9)]
    cuboids, _ = cuboids_of_markers(Some(markers=wiped), HERE)
    assert [each.identity for each in cuboids] == ['car/9']


def test_lines_and_lists_are_counted_unless_they_frame_a_cube():
    shown = [marker(number=1), marker(LINES, 'edges', 1), marker(LINES, 'edges', 2)]
    cuboids, left_out = cuboids_of_markers(Some(markers=[*shown, marker(CUBES, 'all', 3)]), HERE)
    assert len(cuboids) == 1
    assert left_out == [AS_LINES, AS_LINES]


def test_the_recording_car_is_no_object():
    assert cuboids_of_markers(Some(markers=[marker(ns='ego', frame='base_link')]), HERE)[0] == []


# Of both.


def test_an_orientation_that_was_never_set_turns_nothing():
    pose = Pose(Point(12.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 0.0))
    (box,), _ = cuboids_of_markers(Some(markers=[marker(pose=pose)]), HERE)
    np.testing.assert_array_equal(box.velo_T_box.rotation, np.eye(3))


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('side', [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize('place', [0.0, np.nan, np.inf])
def test_a_box_of_no_possible_size_or_place_costs_itself(side, place):
    pose = Pose(Point(place, 0.0, 0.0), Quaternion(0.0, place, 0.0, 1.0))
    size = Vector3(1.0, side, 1.0)
    cuboids, left_out = cuboids_of_markers(Some(markers=[marker(pose=pose, scale=size)]), HERE)
    assert (cuboids, left_out) == ([], [ABSURD])
    odd = detection(bbox=Some(center=pose, size=size))
    cuboids, left_out = cuboids_of_detections(array(odd, detection()), HERE)
    assert (len(cuboids), left_out) == (1, [ABSURD])


def test_tracks_keep_their_numbers():
    tracks = TrackIds()
    names = ['7', 'red', '8', 'red', 'blue', '7', 'box/3', 'car/3', 'box/3', '9', '']
    assert [tracks.number(name) for name in names] == [7, 8, 9, 8, 10, 7, 3, 11, 3, 12, 13]
    assert tracks.number('') == 14


def test_boxes_of_a_frame_with_one_name_are_tracks_of_their_own():
    tracks = TrackIds()
    assert tracks.of_frame(['0', '0', 'car', 'car', '']) == [0, 1, 2, 3, 4]
    assert tracks.of_frame(['car', '0', '0', '3']) == [2, 0, 5, 6]
    assert (tracks.repeated, tracks.unnamed) == (3, 1)


@given(st.lists(st.text(st.sampled_from('0127a-/²'), max_size=12)))
def test_no_two_tracks_have_one_number(names):
    tracks = TrackIds()
    numbers = {}
    for name in names:
        number = tracks.number(name)
        assert 0 <= number < 2**31
        if name:
            assert numbers.setdefault(name, number) == number
    assert len(set(numbers.values())) == len(numbers)


@pytest.mark.parametrize(
    ('kind', 'word'),
    [('Car', 'Car'), (' traffic  cone\t', 'traffic_cone'), ('', 'Misc'), (' \n', 'Misc')],
)
def test_classes_are_words(kind, word):
    assert class_name(kind) == word
