# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The path of the car from above."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import canvas

from kitti_ros2.drawing.birds_eye import draw_route

SIZE = (500, 400)


def route(*positions):
    picture = canvas(SIZE)
    draw_route(picture, np.array(positions, np.float64).reshape(-1, 3))
    return picture


def bright(picture):
    """Where the path is, which is brighter than the scale and the marks."""
    return np.argwhere((picture > 190).all(axis=2))


def test_y_is_up_and_x_is_right_at_equal_scales():
    """An L: 100 m up, then 50 m to the right."""
    places = bright(route((0, 0, 0), (0, 100, 0), (50, 100, 0)))
    (top, left), (bottom, right) = places.min(axis=0), places.max(axis=0)
    assert (bottom - top) / (right - left) == pytest.approx(2, abs=0.2)
    assert (places[places[:, 0] > top + 20][:, 1] < left + 5).all()


def test_the_end_is_marked():
    picture = route((0, 0, 0), (0, 100, 0))
    green = np.argwhere((picture[..., 1] > 150) & (picture[..., 2] < 100))
    top = green[green[:, 0] < 100]
    assert len(top) > 80


def test_a_parked_car_does_not_look_like_a_moving_one():
    places = bright(route((0, 0, 0), (0, 0.01, 0)))
    assert not len(places) or np.ptp(places, axis=0).max() < 20


@pytest.mark.parametrize('count', [0, 1])
def test_few_positions(count):
    assert route(*[(1, 2, 3)] * count).any() == bool(count)


@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.tuples(*[st.floats(allow_nan=True)] * 3), max_size=5),
    st.sampled_from([(0, 9), (1, 1), (30, 30), SIZE]),
)
def test_any_positions_on_any_window(positions, size):
    draw_route(canvas(size), np.array(positions, np.float64).reshape(-1, 3))


def test_long_paths_are_thinned_and_keep_their_end():
    turns = np.linspace(0, 20, 200_001)
    spiral = np.column_stack([turns * np.cos(turns), turns * np.sin(turns), turns * 0])
    whole, few = canvas(SIZE), canvas(SIZE)
    draw_route(whole, spiral)
    draw_route(few, spiral[::25])
    assert (np.abs(whole.astype(int) - few).max(axis=2) > 60).mean() < 0.02
