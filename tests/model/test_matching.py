# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overlap of boxes, and which predictions find which labels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.drawing.labelled_objects import LabelledObject
from kitti_ros2.model.boxes import DONT_CARE, BoxTable, Cuboid, Matches, Verdict, ious_2d, match
from kitti_ros2.model.classes import KITTI_OVERLAPS, LeastOverlaps
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

TP, FP, FN = Verdict.TRUE_POSITIVE, Verdict.FALSE_POSITIVE, Verdict.FALSE_NEGATIVE
PLACE = st.floats(-3, 3)
LENGTH = st.floats(0.3, 6)
BOX = st.tuples(PLACE, PLACE, PLACE, st.floats(-4, 4), LENGTH, LENGTH, LENGTH)


def box(x=0.0, y=0.0, z=0.0, yaw=0.0, length=4.0, width=2.0, height=1.5, kind='Car'):
    pose = Transform(rotation_from_rpy(0.0, 0.0, yaw), np.array([x, y, z], np.float64))
    return Cuboid(kind, '0', pose, (length, width, height))


def car(x=0.0, score=None, kind='Car', **rest):
    """An object with a 3D box of 4 m whose middle is at x; IoU with one d farther: (4-d)/(4+d)."""
    return LabelledObject(kind, box(x, kind=kind, **rest), score=score)


def flat(left, right, score=None, kind='Car'):
    """An object with a 2D box only, of 10 rows."""
    return LabelledObject(kind, None, (left, 0.0, right, 10.0), score=score)


def overlap(one, *others):
    """IoU of the first object with the others."""
    with np.errstate(all='ignore'):
        pairs = BoxTable([one]).overlaps(
            BoxTable(others), np.array([0]), np.ones((1, len(others)), bool)
        )
    found = np.zeros(len(others))
    found[pairs.second] = pairs.overlaps
    return found


def iou_3d(one, other):
    (found,) = overlap(LabelledObject('Car', one), LabelledObject('Car', other))
    return found


def shared_area(one, other):
    """The area that the footprints of two boxes share, if both are 1 m high and on one plane."""
    found = iou_3d(one, other)
    areas = sum(each.size_lwh[0] * each.size_lwh[1] for each in (one, other))
    return found * areas / (1 + found)


def verdicts(matches: Matches):
    return [[each.verdict for each in side] for side in matches]


@pytest.mark.parametrize(
    ('other', 'expected'),
    [
        (box(), 1.0),
        (box(2.0), 1 / 3),
        (box(0.0, 1.0), 1 / 3),
        (box(0.0, 0.0, 0.75), 1 / 3),
        (box(2.0, 1.0, 0.75), (2 * 1 * 0.75) / (2 * 12 - 2 * 1 * 0.75)),
        (box(yaw=np.pi), 1.0),
        (box(yaw=np.pi / 2), 4 / 12),  # a square of 2 m in both
        (box(4.0), 0.0),
        (box(99.0), 0.0),
        (box(length=2.0, width=1.0, height=0.75), 1 / 8),
        (box(np.nan), 0.0),
        (box(length=np.inf), 0.0),
        (box(length=0.0), 0.0),
    ],
)
def test_overlap_of_known_boxes(other, expected):
    assert iou_3d(box(), other) == pytest.approx(expected, abs=1e-9)
    assert iou_3d(other, box()) == pytest.approx(expected, abs=1e-9)


def test_a_square_turned_by_an_eighth():
    """The octagon that two unit squares share has an area of 2 (sqrt(2) - 1)."""
    one, other = (box(length=1.0, width=1.0, yaw=yaw) for yaw in (0.3, 0.3 + np.pi / 4))
    shared = 2 * (np.sqrt(2) - 1)
    assert iou_3d(one, other) == pytest.approx(shared / (2 - shared))


@given(BOX, BOX)
def test_footprints_share_the_sum_of_thin_slices(one, other):
    """Each rectangle is two strips: y is bounded by four lines, at each of many x."""
    x = np.linspace(-9, 9, 6001)
    low, high = np.full_like(x, -np.inf), np.full_like(x, np.inf)
    for left, ahead, _, yaw, length, width, _ in (one, other):
        for angle, half in ((yaw, length / 2), (yaw + np.pi / 2, width / 2)):
            c, s = np.cos(angle), np.sin(angle)
            s = s if abs(s) > 1e-9 else 1e-9
            ends = ahead + (np.array([[-half], [half]]) - c * (x - left)) / s
            low, high = np.maximum(low, ends.min(axis=0)), np.minimum(high, ends.max(axis=0))
    expected = np.maximum(high - low, 0).sum() * (x[1] - x[0])
    flat = (
        box(x, y, 0.0, yaw, length, width, 1.0) for x, y, _, yaw, length, width, _ in (one, other)
    )
    assert shared_area(*flat) == pytest.approx(expected, abs=0.05)


@given(BOX, BOX, BOX)
def test_overlap_is_symmetric_and_the_same_from_anywhere(one, other, place):
    a, b = box(*one), box(*other)
    found = iou_3d(a, b)
    assert 0 <= found <= 1 + 1e-9
    assert iou_3d(b, a) == pytest.approx(found, abs=1e-6)
    pose = Transform(rotation_from_rpy(place[0], place[1], place[3]), np.array(place[:3]))
    moved = (Cuboid('Car', '0', pose @ each.velo_T_box, each.size_lwh) for each in (a, b))
    assert iou_3d(*moved) == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(
    ('one', 'other', 'expected'),
    [
        ((0, 0, 10, 10), (5, 0, 15, 10), 1 / 3),
        ((0, 0, 10, 10), (10, 0, 20, 10), 0),
        ((0, 0, 0, 0), (0, 0, 0, 0), 0),
        ((0, 0, np.nan, 9), (0, 0, 9, 9), 0),
        ((0, 0, np.inf, 9), (0, 0, 9, 9), 0),
        ((9, 9, 0, 0), (0, 0, 9, 9), 0),
    ],
)
def test_overlap_of_rectangles(one, other, expected):
    with np.errstate(all='ignore'):
        found = ious_2d(np.array(one, float), np.array(other, float))
    assert found == pytest.approx(expected)


@pytest.mark.parametrize('size', [(4.0, 2.0, 0.0), (-4.0, -2.0, 1.5), (4.0, np.nan, 1.5)])
def test_empty_and_absurd_boxes_overlap_nothing(size):
    odd = Cuboid('Car', '0', box().velo_T_box, size)
    assert iou_3d(odd, box()) == iou_3d(box(), odd) == iou_3d(odd, odd) == 0


def test_a_box_upside_down_overlaps_as_one_that_stands():
    turned = Transform(rotation_from_rpy(np.pi, 0.0, 0.0), np.zeros(3))
    assert iou_3d(box(), Cuboid('Car', '0', turned, (4.0, 2.0, 1.5))) == pytest.approx(1)


def test_each_pair_is_compared_by_the_boxes_that_both_have():
    """Solid boxes beside flat ones, objects with both, and with none, in any order."""
    both = LabelledObject('Car', box(), (0.0, 0.0, 10.0, 10.0))
    others = [flat(0.0, 5.0), car(2.0), LabelledObject('Car', None), car(99.0), both]
    assert overlap(both, *others) == pytest.approx([0.5, 1 / 3, 0, 0, 1])
    assert overlap(car(), *others) == pytest.approx([0, 1 / 3, 0, 0, 1])
    assert overlap(flat(0.0, 5.0), *others) == pytest.approx([1, 0, 0, 0, 0.5])
    assert overlap(LabelledObject('Car', None), *others) == pytest.approx([0] * 5)


@pytest.mark.parametrize(
    ('kind', 'least'), [('Car', 0.7), ('Van', 0.7), ('Pedestrian', 0.5), ('Cyclist', 0.5)]
)
def test_the_least_overlap_is_that_of_the_class(kind, least):
    """Two boxes d apart have (4 - d) / (4 + d): just more is a find, just less is none."""
    limit = 4 * (1 - least) / (1 + least)
    assert KITTI_OVERLAPS.of(kind) == least
    label = car(kind=kind)
    near, far = (match([label], [car(limit + d, 0.5, kind)]) for d in (-0.01, 0.01))
    assert verdicts(near) == [[TP], [TP]]
    assert near.predictions[0].overlap > least
    assert verdicts(far) == [[FN], [FP]]
    assert far.predictions[0].overlap == pytest.approx(least, abs=0.01)
    assert far.labels[0].partner is None


def test_a_chosen_overlap_decides():
    """IoU 0.6 is above 0.5, and not above 0.6 itself."""
    label, prediction = car(), car(1.0, 0.5)
    assert verdicts(match([label], [prediction])) == [[FN], [FP]]
    assert verdicts(match([label], [prediction], LeastOverlaps((), 0.5))) == [[TP], [TP]]
    exact = match([label], [prediction]).predictions[0].overlap
    assert exact == pytest.approx(0.6)
    assert verdicts(match([label], [prediction], LeastOverlaps((), exact))) == [[FN], [FP]]
    by_class = LeastOverlaps((('car', 0.5),), 0.9)
    assert verdicts(match([label], [prediction], by_class)) == [[TP], [TP]]


@given(st.floats(0, 1.2), st.floats(-4, 4), st.floats(-4, 4))
def test_boxes_that_do_not_touch_share_nothing(gap, place, yaw):
    """Boxes side by side, near enough for their corners to touch if they were turned."""
    aside = np.array([-np.sin(yaw), np.cos(yaw)]) * (2.001 + gap)
    label = car(place, y=place, yaw=yaw)
    prediction = car(place + aside[0], 0.5, y=place + aside[1], yaw=yaw)
    matches = match([label], [prediction], LeastOverlaps((), 0.0))
    assert verdicts(matches) == [[FN], [FP]]
    assert matches.predictions[0].overlap == 0


def test_a_label_is_found_once_by_the_surest():
    matches = match([car()], [car(0.1, 0.4), car(0.2, 0.9), car(0.0, 0.3)])
    assert verdicts(matches) == [[TP], [FP, TP, FP]]
    assert matches.labels[0].partner == 1
    assert matches.predictions[1].partner == 0
    assert matches.predictions[2].overlap == 1.0


def test_the_nearest_label_is_found():
    matches = match([car(0.5), car(0.1)], [car(0.0, 0.9), car(0.4, 0.8)])
    assert [each.partner for each in matches.predictions] == [1, 0]


def test_other_classes_are_not_found():
    assert verdicts(match([car(kind='Cyclist')], [car(score=1.0)])) == [[FN], [FP]]


def test_the_case_of_classes_does_not_matter():
    labels = [car(), car(10, kind='VAN'), flat(100, 200, kind='dontcare')]
    predictions = [car(score=0.9, kind='car'), car(10, score=0.8, kind='CAR'), flat(110, 190, 0.7)]
    assert verdicts(match(labels, predictions)) == [[TP, None, None], [TP, None, None]]


@pytest.mark.parametrize(('kind', 'neighbour'), [('Car', 'Van'), ('Pedestrian', 'Person_sitting')])
def test_a_neighbouring_class_is_neither_right_nor_wrong(kind, neighbour):
    label = car(kind=neighbour)
    assert verdicts(match([label], [car(0.0, 0.9, kind)])) == [[None], [None]]
    assert verdicts(match([label], [car(9.0, 0.9, kind)])) == [[None], [FP]]
    both = match([label, car(kind=kind)], [car(0.0, 0.9, kind)])
    assert verdicts(both) == [[None, TP], [TP]]


def test_predictions_in_regions_without_labels_do_not_count():
    region = flat(0.0, 100.0, kind=DONT_CARE)
    predictions = [flat(90.0, 110.0, 0.5), flat(20.0, 40.0, 0.5)]
    assert verdicts(match([region], predictions)) == [[None], [FP, None]]


@pytest.mark.parametrize('kind', ['Truck', 'Tram', 'Misc', 'Van', 'Person_sitting', DONT_CARE])
def test_classes_that_kitti_does_not_evaluate_are_not_missed(kind):
    assert verdicts(match([car(kind=kind)], [])) == [[None], []]


def test_but_they_count_where_they_are_predicted():
    matches = match([car(kind='Truck'), car(20.0, kind='Truck')], [car(0.0, 0.9, 'Truck')])
    assert verdicts(matches) == [[TP, FN], [TP]]


def test_classes_of_others_count():
    assert verdicts(match([car(kind='my-robot')], [])) == [[FN], []]


def test_flat_boxes_are_compared_where_one_has_no_other():
    matches = match([flat(0.0, 10.0)], [flat(1.0, 10.0, 0.5)])
    assert verdicts(matches) == [[TP], [TP]]
    assert matches.predictions[0].overlap == pytest.approx(0.9)
    assert verdicts(match([car()], [flat(0.0, 10.0, 0.5)])) == [[FN], [FP]]


def test_nothing_compared_with_nothing():
    assert match([], []) == ([], [])


def test_many_predictions_are_compared_as_if_at_once(monkeypatch):
    """Those of a step see what earlier steps found, in the order of their scores."""
    rng = np.random.default_rng(5)
    kinds = ['Car', 'Van', 'Pedestrian', DONT_CARE]
    labels = [car(x, kind=kinds[i % 3], y=i % 5) for i, x in enumerate(rng.uniform(-9, 9, 40))]
    labels += [flat(x, x + 9, kind=kinds[i % 4]) for i, x in enumerate(rng.uniform(0, 90, 20))]
    predictions = [
        car(x, score, kinds[i % 3], y=i % 5)
        for i, (x, score) in enumerate(rng.uniform([-9, 0], [9, 1], (60, 2)))
    ]
    predictions += [flat(x, x + 9, x / 90) for x in rng.uniform(0, 90, 20)]
    expected = match(labels, predictions, LeastOverlaps((), 0.3))
    monkeypatch.setattr('kitti_ros2.model.boxes._MOST_PAIRS', 3 * len(labels))
    assert match(labels, predictions, LeastOverlaps((), 0.3)) == expected
    assert {each.verdict for each in expected.predictions} == {TP, FP, None}


@given(
    st.lists(st.tuples(st.floats(-5, 5), st.sampled_from(['Car', 'Van', 'Tram'])), max_size=6),
    st.lists(st.tuples(st.floats(-5, 5), st.floats(allow_nan=True)), max_size=6),
)
def test_partners_are_mutual(labels, predictions):
    matches = match(
        [car(x, kind=kind) for x, kind in labels], [car(x, score) for x, score in predictions]
    )
    found = {(m.partner, place) for place, m in enumerate(matches.predictions)}
    assert {pair for pair in found if pair[0] is not None} == {
        (place, m.partner) for place, m in enumerate(matches.labels) if m.partner is not None
    }
    assert all(m.partner is not None for m in matches.predictions if m.verdict is TP)
