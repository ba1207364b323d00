# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""2D boxes and wireframes: where their pixels are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import SIZE, bounds_of, camera, canvas, drawn, flat, project, solid

from kitti_ros2.drawing.annotate import (
    annotate,
    draw_boxes_2d,
    draw_wireframes,
    projected_bounds,
)
from kitti_ros2.drawing.labelled_objects import CLASS_COLORS, NEUTRAL_COLOR, VERDICT_COLORS, resized
from kitti_ros2.drawing.primitives import box_color, caption_2d, caption_3d, class_color
from kitti_ros2.drawing.projection import Projection
from kitti_ros2.model.boxes import DONT_CARE, Match, Verdict, clip_bounds, cuboid_corners
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import open_frames

EXPECTED_IOU = {
    0: {'Pedestrian': 0.889},
    1: {'Truck': 0.938, 'Car': 0.981, 'Cyclist': 0.960},
    2: {'Misc': 0.969, 'Car': 0.973},
}
"""Of real objects: the projected box with the 2D label."""


def iou(one, other):
    def area(box):
        return max(box[2] - box[0], 0) * max(box[3] - box[1], 0)

    common = area([*np.maximum(one[:2], other[:2]), *np.minimum(one[2:], other[2:])])
    return common / (area(one) + area(other) - common)


@pytest.mark.parametrize('predicted', [False, True])
def test_the_lines_of_a_2d_box_are_at_its_coordinates(predicted):
    picture, box = canvas(), flat(100.2, 50.4, 199.8, 119.7)
    if predicted:
        draw_boxes_2d(picture, [], predictions=[box], named=False)
    else:
        draw_boxes_2d(picture, [box], named=False)
    color = np.array(box_color(box, predicted=predicted))
    for row, column in ((50, 100), (120, 200)):
        assert (picture[row, column] >= 0.7 * color).all()
    left, top, right, bottom = bounds_of(drawn(picture))
    assert abs(np.array([left, top, right, bottom]) - [100, 50, 200, 120]).max() <= 2
    assert not picture[60:110, 110:190].any()


def test_predictions_are_dashed_and_labels_are_not():
    label, prediction = canvas(), canvas()
    box = flat(50, 50, 350, 150)
    draw_boxes_2d(label, [box], named=False)
    draw_boxes_2d(prediction, [], predictions=[box], named=False)
    assert drawn(label)[50, 50:350].all()
    assert 0.4 < drawn(prediction)[50, 50:350].mean() < 0.8
    car = solid(15)
    label, prediction = canvas(), canvas()
    draw_wireframes(label, [car], camera(), named=False)
    draw_wireframes(prediction, [], camera(), [car], named=False)
    assert drawn(prediction).sum() < 0.8 * drawn(label).sum()


def test_predictions_have_one_colour_that_no_class_has():
    colors = {box_color(solid(9, kind=kind), predicted=True) for kind in ('Car', 'Van', 'x')}
    assert len(colors) == 1
    assert not colors & {class_color(kind) for kind in CLASS_COLORS}


def test_compared_boxes_have_the_colour_of_the_result():
    def color(verdict, *, predicted):
        return box_color(replace(solid(9), match=Match(verdict)), predicted=predicted)[::-1]

    right, wrong, missed = Verdict
    assert color(right, predicted=True) == VERDICT_COLORS[right]
    assert color(wrong, predicted=True) == VERDICT_COLORS[wrong]
    assert color(None, predicted=True) == NEUTRAL_COLOR
    assert color(missed, predicted=False) == VERDICT_COLORS[missed]
    for verdict in (right, None):
        assert color(verdict, predicted=False) == NEUTRAL_COLOR


@pytest.mark.parametrize(
    ('score', 'match', 'caption'),
    [
        (0.9, Match(Verdict.TRUE_POSITIVE, 0, 0.876), 'Car 0.90 TP IoU 0.88'),
        (0.9, Match(Verdict.FALSE_POSITIVE, None, 0.31), 'Car 0.90 FP IoU 0.31'),
        (0.9, Match(Verdict.FALSE_POSITIVE), 'Car 0.90 FP'),
        (0.9, Match(None, 0, 0.8), 'Car 0.90'),
        (None, Match(Verdict.TRUE_POSITIVE, 0, 0.8), 'Car'),
        (None, Match(Verdict.FALSE_NEGATIVE), 'Car FN'),
        (None, Match(None), 'Car'),
        (None, None, 'Car'),
    ],
)
def test_the_result_of_the_comparison_is_told(score, match, caption):
    assert caption_2d(flat(0, 0, 9, 9, score=score, match=match)) == caption


def test_the_score_is_told():
    assert caption_2d(flat(0, 0, 9, 9, score=0.875, track_id=12)) == 'Car 12 0.88'


def test_the_distance_is_no_part_of_the_track_s_number():
    assert caption_3d(solid(80.3, kind='Van', track_id=27)) == 'Van 27, 80.3 m'
    assert caption_3d(solid(80.3, kind='Van')) == 'Van, 80.3 m'


def test_occlusion_and_truncation_are_told():
    box = flat(0, 0, 9, 9, occluded=2, truncated=0.34, track_id=0)
    assert caption_2d(box) == 'Car 0 occ 2 trunc 34%'
    assert caption_2d(flat(0, 0, 9, 9, occluded=3, truncated=1.0)) == 'Car occ ? trunc'
    assert caption_2d(flat(0, 0, 9, 9, occluded=0, truncated=0.0)) == 'Car'
    visible, hidden = canvas(), canvas()
    draw_boxes_2d(visible, [flat(50, 50, 350, 150, occluded=0)], named=False)
    draw_boxes_2d(hidden, [flat(50, 50, 350, 150, occluded=2)], named=False)
    assert hidden.sum(dtype=int) < 0.8 * visible.sum(dtype=int)


def test_regions_without_labels_are_shaded():
    picture = np.full((SIZE[1], SIZE[0], 3), 200, np.uint8)
    draw_boxes_2d(picture, [flat(100, 50, 199, 149, kind=DONT_CARE)])
    inside = picture[50:150, 100:200]
    assert inside.mean() < 150
    assert bounds_of((picture != 200).any(axis=2)) == (100, 50, 199, 149)


@pytest.mark.parametrize('labelled', [True, False])
def test_an_image_without_2d_labels_has_the_bounds_of_the_3d_boxes(labelled):
    """Another camera's, or a tracklet's."""
    box = solid(15, 2, box_2d=None if labelled else (0, 0, 9, 9))
    picture = canvas()
    draw_boxes_2d(picture, [box], camera(), labelled=labelled, named=False)
    expected, _ = clip_bounds(projected_bounds(cuboid_corners([box.cuboid]), camera()), SIZE)
    assert np.abs(np.array(bounds_of(drawn(picture))) - expected[0]).max() <= 2
    nothing = canvas()
    draw_boxes_2d(nothing, [box], None, labelled=False)
    assert not nothing.any()


def test_a_wireframe_shows_its_front():
    """Its cross joins corners that no edge does."""
    away, toward = canvas(), canvas()
    draw_wireframes(away, [solid(10, yaw=0.0)], camera(), named=False)
    draw_wireframes(toward, [solid(10, yaw=np.pi)], camera(), named=False)
    front, _ = project(camera(), np.array([[8.0, 0.0, 0.0]]))
    u, v = np.rint(front[0]).astype(int)
    assert drawn(toward)[v, u]
    assert bounds_of(drawn(away)) == bounds_of(drawn(toward))
    assert toward[v - 3, u].any()  # the tint
    nearer = np.abs(away[v - 20 : v + 20].astype(int) - toward[v - 20 : v + 20])
    assert nearer.max() > 40


@settings(deadline=None)
@given(
    st.floats(-3, 3), st.floats(-4, 4), st.floats(-2, 2), st.floats(-3.2, 3.2),
    st.tuples(*[st.floats(0.5, 6)] * 3),
)  # fmt: skip
def test_a_box_around_or_behind_the_camera_draws_nothing_from_behind(x, y, z, yaw, size_lwh):
    """Each drawn pixel is where a surface of the part of the box before the camera may be."""
    box = solid(x, y, z, size_lwh, yaw)
    picture = canvas()
    draw_wireframes(picture, [box], camera(), named=False)
    left, top, right, bottom = projected_bounds(cuboid_corners([box.cuboid]), camera())[0]
    rows, columns = np.nonzero(picture.any(axis=2))
    assert ((left - 5 <= columns) & (columns <= right + 5)).all()
    assert ((top - 5 <= rows) & (rows <= bottom + 5)).all()


def test_a_box_behind_the_camera_is_not_drawn():
    picture = canvas()
    draw_wireframes(picture, [solid(-10)], camera())
    assert not picture.any()


def test_half_a_cube_behind_the_camera():
    """Of a cube from 1 to 3 m at the left, the half ahead: u runs from -f y / x at its corners."""
    picture = canvas()
    draw_wireframes(picture, [solid(0.0, 2.0, 0.0, (8.0, 2.0, 2.0))], camera(), named=False)
    nearest_right = SIZE[0] / 2 - 200 * 1.0 / 4.0
    left, top, right, bottom = bounds_of(drawn(picture))
    assert (left, top, bottom) == (0, 0, SIZE[1] - 1)
    assert abs(right - nearest_right) <= 2


def test_annotate_draws_the_3d_boxes_and_the_2d_ones_of_the_rest():
    both, wire = canvas(), canvas()
    car, sign = solid(15, box_2d=(10, 10, 20, 20)), flat(300, 20, 380, 60, 'Sign')
    annotate(both, [car, sign], camera(), 2, named=False)
    draw_wireframes(wire, [car], camera(), named=False)
    draw_boxes_2d(wire, [sign], named=False)
    np.testing.assert_array_equal(both, wire)
    flat_only, boxes = canvas(), canvas()
    annotate(flat_only, [car, sign], None, 2)
    draw_boxes_2d(boxes, [car, sign])
    np.testing.assert_array_equal(flat_only, boxes)
    other = canvas()
    annotate(other, [sign], camera(), 3)
    assert not other.any(), 'the 2D boxes of camera 2 say nothing about camera 3'


def test_pictures_may_be_parts_of_others():
    page, alone = np.zeros((300, 600, 3), np.uint8), canvas()
    window = page[40 : 40 + SIZE[1], 90 : 90 + SIZE[0]]
    everything = [solid(12), flat(10, 10, 60, 60, kind=DONT_CARE), flat(300, 20, 380, 60)]
    annotate(window, everything, camera(), 2)
    annotate(alone, everything, camera(), 2)
    np.testing.assert_array_equal(window, alone)
    window[:] = 0
    assert not page.any()


@given(st.floats(0.2, 4), st.floats(0.2, 4))
def test_resized_objects_keep_their_edges(scale_x, scale_y):
    (scaled,) = resized([flat(10, 20, 30, 40)], scale_x, scale_y)
    expected = (np.array([10, 20, 30, 40]) + 0.5) * ([scale_x, scale_y] * 2) - 0.5
    np.testing.assert_allclose(scaled.box_2d, expected)


def test_real_wireframes_are_around_the_2d_labels(real_kitti):
    source = open_frames(real_kitti / 'object', ReadOptions())
    for number, expected in EXPECTED_IOU.items():
        frame = source.frame(number, frozenset({'image_2', 'labels'}))
        projection = Projection.of(frame.calibration, 2)
        ious = {}
        for obj in frame.objects:
            if obj.cuboid is None:
                continue
            # Enlarged, and in the thinner style, so that the width of a line counts for little.
            picture = np.zeros((*(4 * np.array(frame.images[2].shape[:2])), 3), np.uint8)
            draw_wireframes(picture, [], projection.resized(4, 4), [obj], named=False)
            left, top, right, bottom = bounds_of(drawn(picture))
            label = resized([obj], 4, 4)[0].box_2d
            ious[obj.class_name] = iou((left, top, right, bottom), label)
        assert ious == {kind: pytest.approx(value, abs=0.02) for kind, value in expected.items()}
