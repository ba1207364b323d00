# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points inside 3D boxes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.boxes import Cuboid, count_points
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

ANGLES = st.floats(-3.1, 3.1)


def cuboid(place=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), size=(4.0, 2.0, 1.5)):
    return Cuboid('Car', '0', Transform(rotation_from_rpy(*rpy), np.array(place)), size)


@given(
    st.tuples(*[st.floats(-70, 70)] * 3),
    st.tuples(ANGLES, ANGLES, ANGLES),
    st.tuples(*[st.floats(0.2, 20)] * 3),
    st.integers(0, 2**31),
)
def test_points_made_inside_are_counted_and_those_outside_are_not(place, rpy, size, seed):
    rng = np.random.default_rng(seed)
    half = np.array(size) / 2
    inside = rng.uniform(-0.99, 0.99, (50, 3)) * half
    outside = rng.uniform(-0.99, 0.99, (50, 3)) * half
    axes = rng.integers(0, 3, 50)
    outside[range(50), axes] = rng.choice([-1, 1], 50) * (half[axes] * 1.01 + 0.01)
    box = cuboid(place, rpy, size)
    points = box.velo_T_box.apply(np.vstack([inside, outside]))
    scan = np.hstack([points, np.zeros((100, 1))]).astype(np.float32)
    assert count_points([box, cuboid((500.0, 0.0, 0.0)), box], scan) == [50, 0, 50]


def test_faces_are_included():
    corners = np.array([[2, 1, 0.75], [-2, -1, -0.75], [2.001, 0, 0], [0, 0, 0.751]], np.float32)
    assert count_points([cuboid()], corners) == [2]


def test_any_numbers_are_counted_without_a_warning():
    scan = np.array([[np.nan, 0, 0, 0], [np.inf, np.inf, 0, 0], [0, 0, 0, 0]], np.float32)
    assert count_points([cuboid(), cuboid((np.nan, 0.0, 0.0))], scan) == [1, 0]
    assert count_points([], scan) == []
    assert count_points([cuboid()], np.zeros((0, 4), np.float32)) == [0]
