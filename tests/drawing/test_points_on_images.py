# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points over an image, the scales of their colours, and the scan by direction."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import SIZE, camera, canvas

from kitti_ros2.drawing.points import (
    EMPTY,
    SCALES,
    PointColors,
    color_table,
    draw_points,
    range_maps,
    scatter,
)
from kitti_ros2.options.outputs import ColorBy, ColorMap

MIDDLE = (SIZE[1] // 2, SIZE[0] // 2)


def points_of(*rows) -> np.ndarray:
    return np.array(rows, np.float32).reshape(-1, 4)


def color_at(value, color_by=ColorBy.DEPTH, color_map=ColorMap.VIRIDIS):
    shade = SCALES[color_by].shades(np.array([value]))[0]
    return color_table(color_map)[shade, 0].tolist()


@pytest.mark.parametrize('order', [[0, 1, 2], [2, 1, 0], [1, 2, 0]])
@pytest.mark.parametrize('point_size', [1, 2, 3, 5])
def test_the_nearest_point_is_on_top(order, point_size):
    ahead = points_of((10, 0, 0, 0.1), (40, 0, 0, 0.5), (20, 0, 0, 0.9))[order]
    picture = canvas()
    draw_points(picture, ahead, camera(), point_size=point_size)
    assert picture[MIDDLE].tolist() == color_at(10.0)


@pytest.mark.parametrize('point_size', [2, 3, 5])
def test_a_near_point_lies_on_its_far_neighbour(point_size):
    """One pixel to the side: where their discs overlap the near one is seen, whole."""
    beside = points_of((10, 0, 0, 0), (50, -0.25, 0, 0))
    both, alone = canvas(), canvas()
    draw_points(both, beside, camera(), point_size=point_size)
    draw_points(alone, beside[:1], camera(), point_size=point_size)
    near = (alone == color_at(10.0)).all(axis=2)
    assert near.sum() > 2
    assert (both[near] == color_at(10.0)).all()
    assert (both != alone).any()


@pytest.mark.parametrize(
    ('color_by', 'value'),
    [(ColorBy.DEPTH, 12.0), (ColorBy.HEIGHT, 0.6), (ColorBy.INTENSITY, 0.3)],
)
@pytest.mark.parametrize('color_map', list(ColorMap))
def test_colours_tell_what_was_asked_for(color_by, value, color_map):
    picture = canvas()
    draw_points(picture, points_of((12, 0, 0.6, 0.3)), camera(), PointColors(color_by, color_map))
    row = MIDDLE[0] - round(200 * 0.6 / 12)
    assert picture[row, MIDDLE[1]].tolist() == color_at(value, color_by, color_map)


def test_points_behind_or_aside_are_not_drawn():
    picture, bare = canvas(), canvas()
    unseen = points_of((-10, 0, 0, 0), (1, 5, 0, 0), (np.nan, 0, 0, 0), (np.inf, 0, 0, 0))
    draw_points(picture, unseen, camera())
    draw_points(bare, points_of(), camera())
    np.testing.assert_array_equal(picture, bare)


@given(
    st.lists(st.tuples(st.integers(0, 19), st.integers(0, 9), st.integers(1, 255)), max_size=30),
    st.integers(1, 6),
)
def test_scattering_is_painting_one_after_the_other(dots, point_size):
    disc = scatter(np.array([[50, 50]], np.int32), np.array([9], np.uint8), (100, 100), point_size)
    offsets = np.argwhere(disc) - 50
    expected = np.zeros((10, 20), np.uint8)
    for column, row, shade in dots:
        for down, right in offsets:
            if 0 <= row + down < 10 and 0 <= column + right < 20:
                expected[row + down, column + right] = shade
    places = np.array([dot[:2] for dot in dots], np.int32).reshape(-1, 2)
    shades = np.array([dot[2] for dot in dots], np.uint8)
    np.testing.assert_array_equal(scatter(places, shades, (20, 10), point_size), expected)
    assert len(offsets) <= point_size**2


@given(st.sampled_from(list(SCALES)), st.lists(st.floats(allow_nan=True), max_size=20))
def test_shades_are_ordered_and_never_empty(color_by, values):
    scale = SCALES[color_by]
    shades = scale.shades(np.array(values))
    assert (shades != EMPTY).all()
    ramp = scale.shades(np.linspace(scale.low, scale.high, 200)).astype(int)
    assert (np.diff(ramp) * (-1 if scale.reverse else 1) >= 0).all()
    assert {ramp[0], ramp[-1]} == {1, 255}


def test_a_scan_by_direction():
    """Ahead is in the middle, left is left, high is above; of one direction the nearest."""
    ring = np.radians(np.arange(-180, 180, 0.5) + 0.1)
    rows = [
        np.column_stack([10 * np.cos(ring), 10 * np.sin(ring), np.full_like(ring, z), ring * 0])
        for z in np.linspace(-3, 1, 60)
    ]
    left = points_of((0, 5, -0.5, 0.8), (0, 20, -2.0, 0.2))
    ahead = points_of((4, 0, -0.4, 0.4))
    points = np.concatenate([*rows, left, ahead]).astype(np.float32)
    maps = range_maps(points, 360)
    assert maps.distance.shape == maps.intensity.shape == (64, 360)
    near = np.argwhere(maps.intensity == SCALES[ColorBy.INTENSITY].shades(np.array([0.8]))[0])
    assert set(near[:, 1].tolist()) <= {89, 90}
    middle = np.argwhere(maps.intensity == SCALES[ColorBy.INTENSITY].shades(np.array([0.4]))[0])
    assert set(middle[:, 1].tolist()) <= {179, 180}
    assert maps.distance[near[0, 0], near[0, 1]] == SCALES[ColorBy.DEPTH].shades(
        np.linalg.norm(left[:1, :3], axis=1)
    )
    assert maps.distance.any(axis=1).all(), 'a row is empty'
