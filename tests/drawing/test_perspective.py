# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The view from behind: where things are, what covers what, and its colours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import project, solid

from kitti_ros2.drawing.birds_eye import BACKGROUND, SIZE, draw_perspective, view_from_behind
from kitti_ros2.drawing.points import SCALES, PointColors, color_table
from kitti_ros2.options.outputs import ColorBy, ColorMap

VIEW = view_from_behind()
EMPTY = draw_perspective(None, [], [])


def pixel_of(*place):
    """(row, column) of a place in velo_link."""
    pixels, _ = project(VIEW, np.array([place], np.float64))
    return tuple(np.rint(pixels[0, ::-1]).astype(int))


def color_of(value, color_by, color_map=ColorMap.VIRIDIS):
    return color_table(color_map)[SCALES[color_by].shades(np.array([value]))[0], 0].tolist()


def test_far_is_up_left_is_left_and_high_is_up():
    row, column = pixel_of(20, 0, 0)
    assert pixel_of(40, 0, 0)[0] < row
    assert pixel_of(20, 5, 0)[1] < column < pixel_of(20, -5, 0)[1]
    assert pixel_of(20, 0, 3)[0] < row


def test_the_view_is_not_mirrored_or_sheared():
    matrix = np.linalg.inv(
        np.array([[1, 0, (SIZE[0] - 1) / 2], [0, 1, (SIZE[1] - 1) / 2], [0, 0, 1]])
    )
    focal_rotation = matrix @ VIEW.matrix[:, :3]
    focal = np.linalg.norm(focal_rotation[0])
    rotation = focal_rotation / np.array([[focal], [focal], [1]])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize('order', [[0, 1], [1, 0]])
def test_the_nearest_point_is_on_top(order):
    """Two points on one ray from the eye."""
    near = np.array([20.0, 3.0, 0.0])
    eye = -np.linalg.solve(VIEW.matrix[:, :3], VIEW.matrix[:, 3])
    far = eye + 1.5 * (near - eye)
    points = np.array([[*near, 0.1], [*far, 0.7]], np.float32)[order]
    picture = draw_perspective(points, [], [], PointColors(ColorBy.INTENSITY))
    assert picture[pixel_of(*near)].tolist() == color_of(0.1, ColorBy.INTENSITY)


@pytest.mark.parametrize(
    ('color_by', 'value'),
    [(ColorBy.DEPTH, 25.0), (ColorBy.HEIGHT, 0.0), (ColorBy.INTENSITY, 0.5)],
)
def test_colours_are_those_asked_for(color_by, value):
    """Depth is the distance from the scanner: 25 m for (20, 15, 0)."""
    points = np.array([[20, 15, 0, 0.5]], np.float32)
    for color_map in (ColorMap.VIRIDIS, ColorMap.PLASMA):
        picture = draw_perspective(points, [], [], PointColors(color_by, color_map))
        assert picture[pixel_of(20, 15, 0)].tolist() == color_of(value, color_by, color_map)


def test_boxes_are_where_they_are():
    changed = (draw_perspective(None, [solid(20, 4, -1)], [], named=False) != EMPTY).any(axis=2)
    corners = [
        pixel_of(20 + x, 4 + y, -1 + z) for x in (-2, 2) for y in (-1, 1) for z in (-0.75, 0.75)
    ]
    rows, columns = np.nonzero(changed)
    for drawn, expected in ((rows, [c[0] for c in corners]), (columns, [c[1] for c in corners])):
        assert abs(drawn.min() - min(expected)) <= 4
        assert abs(drawn.max() - max(expected)) <= 4


def test_the_grid_is_on_the_ground():
    """A line every 10 m: at 30 m ahead there is one, at 35 m there is none."""
    lines = np.array(EMPTY != BACKGROUND).any(axis=2)
    row, column = pixel_of(30, 3, -1.73)
    assert lines[row - 1 : row + 2, column].any()
    row, column = pixel_of(35, 3, -1.73)
    assert not lines[row - 1 : row + 2, column].any()


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(*[st.floats(allow_nan=True, width=32)] * 4), max_size=5))
def test_any_points(rows):
    points = np.array(rows, np.float32).reshape(-1, 4)
    for color_by in ColorBy:
        assert draw_perspective(points, [], [], PointColors(color_by)).shape == (720, 1280, 3)
