# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels, scans and images of any numbers and sizes are drawn or left out, without a crash."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import camera, canvas, flat, solid

from kitti_ros2.drawing.annotate import annotate, draw_boxes_2d, draw_wireframes
from kitti_ros2.drawing.birds_eye import BirdView, birds_eye, draw_footprints
from kitti_ros2.drawing.labelled_objects import LabelledObject
from kitti_ros2.drawing.points import PointColors, draw_points, range_maps
from kitti_ros2.drawing.projection import Projection
from kitti_ros2.model.boxes import DONT_CARE
from kitti_ros2.model.lenses import PlumbBob
from kitti_ros2.options.outputs import BirdOptions, ColorBy

ANY = st.floats() | st.sampled_from([0.0, -1.0, 1e9, -1e9, 1e300])
SCANS = arrays(np.float32, st.tuples(st.integers(0, 9), st.just(4)), elements=st.floats(width=32))
SIZES = st.sampled_from([(1, 1), (2, 1), (1, 40), (40, 30)])
LENS = Projection(camera().matrix, np.eye(3), PlumbBob(np.array([-0.37, 0.2, 0.002, 0.001, -0.07])))


@st.composite
def objects(draw):
    kind = draw(st.sampled_from(['Car', DONT_CARE, '', 'x' * 999, 'Füßgänger\n\x00']))
    rest = {
        'truncated': draw(st.none() | ANY),
        'occluded': draw(st.none() | st.integers(-5, 9)),
        'score': draw(st.none() | ANY),
        'track_id': draw(st.none() | st.integers(-(2**40), 2**40)),
        'box_2d': draw(st.none() | st.tuples(ANY, ANY, ANY, ANY)),
    }
    if draw(st.booleans()):
        return LabelledObject(kind, None, **rest)
    x, y, z, yaw = draw(st.tuples(ANY, ANY, ANY, st.floats(-4, 4)))
    return solid(x, y, z, draw(st.tuples(ANY, ANY, ANY)), yaw, kind, **rest)


@settings(deadline=None, max_examples=200)
@given(st.lists(objects(), max_size=4), st.lists(objects(), max_size=2), SIZES, st.booleans())
def test_any_objects_on_any_image(labels, predictions, size, lens):
    projection = LENS if lens else camera(size)
    for solid_too in (True, False):
        annotate(canvas(size), labels, projection, 2, predictions=predictions, solid=solid_too)
    draw_boxes_2d(canvas(size), labels, projection, labelled=False, predictions=predictions)
    draw_footprints(canvas(size), labels, BirdView(1.0, 1.0, 3.0), predictions)


@settings(deadline=None)
@given(SCANS, SIZES)
def test_any_points_on_any_image(points, size):
    for color_by in ColorBy:
        draw_points(canvas(size), points, camera(size), PointColors(color_by), point_size=5)
        draw_points(canvas(size), points, LENS, PointColors(color_by))
    maps = range_maps(points, 50)
    assert maps.distance.shape == (64, 50)
    birds_eye(points, [], [], BirdOptions((0.0, 5.0), (0.0, 5.0), 4.0))


@pytest.mark.parametrize('shape', [(0, 0, 3), (0, 9, 3), (9, 0, 3)])
def test_an_image_without_pixels(shape):
    picture = np.zeros(shape, np.uint8)
    annotate(picture, [solid(9), flat(0, 0, 9, 9)], camera(), 2)
    draw_points(picture, np.ones((5, 4), np.float32), camera())
    draw_footprints(picture, [solid(9)], BirdView(1.0, 1.0, 3.0))


def test_nothing_to_draw():
    picture = canvas()
    annotate(picture, [], camera(), 2)
    draw_wireframes(picture, [], camera())
    assert not picture.any()
    assert not range_maps(np.empty((0, 4), np.float32), 9).distance.any()


@pytest.mark.parametrize(
    'options',
    [
        BirdOptions((1e9, 1e9 + 64), (0.0, 10.0), 1.0),
        BirdOptions((-1e6, 1e6), (-1e6, 1e6), 1e-4),
        BirdOptions((0.0, 0.01), (0.0, 0.01), 5000.0),
        BirdOptions((0.0, 1.0), (0.0, 1.0), 1.0),
    ],
)
def test_views_from_anywhere(options):
    points = np.ones((5, 4), np.float32)
    picture = birds_eye(points, [solid(9), solid(1e9)], [solid(3)], options)
    assert picture.shape[1::-1] == options.size


def test_a_thousand_boxes_at_one_place():
    picture = canvas()
    annotate(picture, [solid(9, track_id=number) for number in range(1000)], camera(), 2)
    assert picture.any()
