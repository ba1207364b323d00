# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Easy, moderate, hard, by the limits of the object devkit."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.boxes import LIMITS, Box, Difficulty, difficulty_of

EASY, MODERATE, HARD = Difficulty


def box(height_px, occluded=0, truncated=0.0):
    area = (600.0, 100.0, 650.0, 100.0 + height_px)
    return Box('Car', truncated, occluded, 0.0, area, (1.5, 1.6, 3.9), (0.0, 1.7, 20.0), 0.0)


@pytest.mark.parametrize(
    ('height_px', 'occluded', 'truncated', 'level'),
    [
        (40, 0, 0.15, EASY),
        (39.99, 0, 0.15, MODERATE),
        (40, 1, 0.15, MODERATE),
        (40, 0, 0.16, MODERATE),
        (25, 1, 0.30, MODERATE),
        (25, 2, 0.30, HARD),
        (25, 1, 0.31, HARD),
        (25, 2, 0.50, HARD),
        (24.99, 0, 0.0, None),
        (400, 3, 0.0, None),
        (400, 2, 0.51, None),
        (40, -1, -1.0, EASY),  # unknown, as in the results of a detector
    ],
)
def test_the_limits_are_those_of_the_devkit(height_px, occluded, truncated, level):
    assert difficulty_of(box(height_px, occluded, truncated)) is level


@given(st.floats(0, 300), st.integers(-1, 3), st.floats(0, 1), st.floats(0, 50))
def test_a_higher_box_is_not_harder(height_px, occluded, truncated, more):
    levels = [*Difficulty, None]
    one = difficulty_of(box(height_px, occluded, truncated))
    other = difficulty_of(box(height_px + more, occluded, truncated))
    assert levels.index(other) <= levels.index(one)


def test_a_level_includes_the_easier_ones():
    rows = [*LIMITS.values()]
    assert [*LIMITS] == [*Difficulty]
    assert rows == sorted(rows, key=lambda each: (-each.height_px, each.occluded, each.truncated))
    for easier, harder in pairwise(rows):
        assert easier.height_px >= harder.height_px
        assert easier.occluded <= harder.occluded
        assert easier.truncated <= harder.truncated


def test_the_place_of_the_box_does_not_matter():
    moved = replace(box(30), box_2d=(0.0, 0.0, 1.0, 30.0), location=(9.0, 9.0, 9.0))
    assert difficulty_of(moved) is MODERATE
