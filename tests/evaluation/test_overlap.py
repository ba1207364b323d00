# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Areas that turned rectangles have in common, and the pairs of objects of the same frame."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from devkit_rules import clip, shoelace

from kitti_ros2.evaluation.object_benchmark import intersect_rectangles, pairs_by_frame


def outline(rectangle):
    x, z, length, width, angle = rectangle
    cos, sin = math.cos(angle), math.sin(angle)
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    offsets = [(i * length / 2, j * width / 2) for i, j in signs]
    return [(x + cos * a + sin * b, z - sin * a + cos * b) for a, b in offsets]


def clipped(first, second):
    polygon, other = outline(first), outline(second)
    for start, end in zip(other, other[1:] + other[:1], strict=True):
        polygon = clip(polygon, start, end)
    return shoelace(polygon) if len(polygon) > 2 else 0.0


def area(first, second):
    (shared,) = intersect_rectangles(np.array([first], float), np.array([second], float))
    return shared


@pytest.mark.parametrize('apart', [0.0, 1e-9, 0.3, 2.0])
def test_random_rectangles_are_as_if_clipped(apart):
    rng = np.random.default_rng(3)
    first = rng.uniform([-50, 0, 0.1, 0.1, -4], [50, 80, 9, 3, 4], (1000, 5))
    second = first + rng.normal(0, 1, first.shape) * [apart, apart, apart / 4, apart / 8, apart]
    second[:, 2:4] = np.abs(second[:, 2:4])
    expected = [clipped(*pair) for pair in zip(first, second, strict=True)]
    np.testing.assert_allclose(intersect_rectangles(first, second), expected, atol=1e-9)
    assert max(expected) > 1


@pytest.mark.parametrize('turn', [0, 1, 2, 3, 4, -2])
@pytest.mark.parametrize('angle', [0.0, 0.3, -1.57])
def test_a_quarter_turn_of_a_square_changes_nothing(turn, angle):
    assert area((3, 9, 2, 2, angle), (3, 9, 2, 2, angle + turn * math.pi / 2)) == pytest.approx(4)


@pytest.mark.parametrize(
    ('second', 'expected'),
    [
        ((0, 0, 4, 2, math.pi), 8),  # flipped
        ((0, 0, 1.5, 0.8, 0.7), 1.2),  # inside
        ((0, 0, 40, 20, 0.7), 8),  # around
        ((0, 0, 2, 4, 0), 4),  # a cross
        ((4, 0, 4, 2, 0), 0),  # touching
        ((4.001, 0, 4, 2, 0), 0),
        ((2, 1, 4, 2, 0), 2),  # a quarter
        ((0, 0, 0, 2, 0.3), 0),  # a line
        ((0, 0, 1e-12, 2, 0.3), 0),
        ((1e6, 0, 4, 2, 1), 0),
    ],
)
def test_known_areas(second, expected):
    assert area((0, 0, 4, 2, 0), second) == pytest.approx(expected, abs=1e-9)


def test_the_octagon_of_two_squares():
    assert area((5, 5, 2, 2, 0.2), (5, 5, 2, 2, 0.2 + math.pi / 4)) == pytest.approx(
        8 * (math.sqrt(2) - 1)
    )


def test_a_turn_is_from_x_towards_minus_z():
    assert area((0, 0, 10, 1, 0.5), (4 * math.cos(0.5), -4 * math.sin(0.5), 1, 1, 0.5)) == (
        pytest.approx(1)
    )
    assert area((0, 0, 10, 1, 0.5), (4 * math.cos(0.5), 4 * math.sin(0.5), 1, 1, 0.5)) == 0


@pytest.mark.parametrize('most', [1, 7, 1000])
def test_pairs_are_all_of_the_same_frame(most):
    frames = [0, 0, 2, 2, 2, 5], [0, 1, 2, 2, 5, 5, 6]
    tables = [SimpleTable(np.array(frame)) for frame in frames]
    pair_list = [
        pair
        for pairs in pairs_by_frame(*tables, most)
        for pair in zip(pairs.label.tolist(), pairs.detection.tolist(), strict=True)
    ]
    assert pair_list == [
        (i, j)
        for i, one in enumerate(frames[0])
        for j, other in enumerate(frames[1])
        if one == other
    ]


class SimpleTable(SimpleNamespace):
    def __init__(self, frame):
        super().__init__(frame=frame)

    def __len__(self):
        return len(self.frame)
