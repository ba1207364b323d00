# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Annotations of images through CDR, and their looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.drawing.annotate import StyledBox, image_boxes
from kitti_ros2.drawing.labelled_objects import (
    CLASS_COLORS,
    NEUTRAL_COLOR,
    PREDICTION_COLOR,
    LabelledObject,
)
from kitti_ros2.messages.cdr import join, restamp_message
from kitti_ros2.messages.markers import encode_annotations
from kitti_ros2.model.bag_formats import ANNOTATIONS
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform
from kitti_ros2.synthetic.scene import make_calibration

from decoded_message import decoded  # isort: skip

STAMP = 1317042145951199337
SIZE = (1242, 375)
RIG = make_calibration(SIZE)
LABEL = LabelledObject('Car', None, (10.0, 20.0, 110.0, 80.0), track_id=7)

COLORS = st.tuples(*[st.integers(0, 255)] * 3)
BOXES = st.builds(
    StyledBox,
    bounds=st.tuples(*[st.floats(-1e4, 1e4)] * 4),
    color=COLORS,
    text=st.text(st.characters(blacklist_categories=['Cs'], blacklist_characters='\0')),
    ink=COLORS,
    fill=COLORS,
    line_px=st.floats(0.5, 8),
    font_px=st.floats(1, 100),
)


def annotations(boxes, stamp_ns=STAMP):
    return decoded(encode_annotations(boxes, stamp_ns), ANNOTATIONS)


def stamps_of(message):
    return {
        each.timestamp.sec * 10**9 + each.timestamp.nanosec
        for each in (*message.points, *message.texts)
    }


def rgba(color):
    return color.r * 255, color.g * 255, color.b * 255, color.a


@pytest.fixture(scope='module', autouse=True)
def _definitions():
    """Generated once, before hypothesis looks at the clock."""
    annotations([])


@given(st.lists(BOXES, max_size=4), st.integers(0, 2**31 * 10**9 - 1))
def test_boxes_come_back(boxes, stamp_ns):
    message = annotations(boxes, stamp_ns)
    assert stamps_of(message) == {stamp_ns}
    if not boxes:
        (loop,) = message.points
        assert not loop.points
        assert not message.texts
        return
    for box, loop, text in zip(boxes, message.points, message.texts, strict=True):
        assert loop.type == loop.LINE_LOOP
        xs, ys = zip(*((each.x - 0.5, each.y - 0.5) for each in loop.points), strict=True)
        left, top, right, bottom = box.bounds
        np.testing.assert_allclose(xs, (left, right, right, left), atol=1e-9)
        np.testing.assert_allclose(ys, (top, top, bottom, bottom), atol=1e-9)
        np.testing.assert_allclose(rgba(loop.outline_color), (*box.color, 1.0))
        assert rgba(loop.fill_color)[3] == 0
        assert loop.thickness == box.line_px
        assert text.text == box.text
        assert (text.position.x, text.position.y) == (loop.points[0].x, loop.points[0].y)
        np.testing.assert_allclose(rgba(text.text_color), (*box.ink, 1.0))
        np.testing.assert_allclose(rgba(text.background_color), (*box.fill, 1.0))
        assert text.font_size == box.font_px


@given(st.lists(BOXES, max_size=3), st.integers(0, 2**31 * 10**9 - 1))
def test_every_timestamp_gets_a_new_stamp(boxes, stamp_ns):
    """As headers do, for a player with the current time."""
    data = join(encode_annotations(boxes, STAMP))
    again = restamp_message(data, ANNOTATIONS, stamp_ns)
    assert again == join(encode_annotations(boxes, stamp_ns))


def test_labels_have_the_colour_of_their_class():
    (box,) = image_boxes([LABEL], [], RIG, 2, SIZE)
    assert (box.bounds, box.text) == (LABEL.box_2d, 'Car 7')
    assert box.color == box.fill == CLASS_COLORS['Car']
    (region,) = image_boxes(
        [replace(LABEL, class_name='DontCare', track_id=None)], [], RIG, 2, SIZE
    )
    assert (region.color, region.text) == (NEUTRAL_COLOR, 'DontCare')


def test_predictions_have_a_colour_of_their_own():
    (box,) = image_boxes([], [replace(LABEL, score=0.5)], RIG, 2, SIZE)
    assert (box.color, box.text, box.fill) == (PREDICTION_COLOR, 'Car 7 0.50', (0, 0, 0))


def test_2d_boxes_are_of_the_labelled_camera_only():
    assert not image_boxes([LABEL], [], RIG, 0, SIZE)
    assert len(image_boxes([LABEL], [], None, 2, SIZE)) == 1


def test_an_object_behind_the_camera_has_no_box():
    ahead, behind = (
        LabelledObject('Car', Cuboid('Car', '', place, (4.0, 2.0, 1.5)))
        for place in map(Transform.from_translation, ((20.0, 0.0, -1.0), (-20.0, 0.0, -1.0)))
    )
    for camera in range(4):
        (box,) = image_boxes([ahead, behind], [], RIG, camera, SIZE)
        left, top, right, bottom = box.bounds
        assert 0 <= left < right <= SIZE[0] - 1
        assert 0 <= top < bottom <= SIZE[1] - 1
