# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Colours that are told apart, also with deuteranopia, on dark and on light backgrounds."""

from __future__ import annotations

from itertools import combinations, pairwise

import cv2
import numpy as np
import pytest
from color_difference import ciede2000, contrast, deuteranope, lab, linear

from kitti_ros2.drawing.birds_eye import BACKGROUND
from kitti_ros2.drawing.labelled_objects import (
    CLASS_COLORS,
    NEUTRAL_COLOR,
    PREDICTION_COLOR,
    VERDICT_COLORS,
)
from kitti_ros2.drawing.points import color_table
from kitti_ros2.options.outputs import ColorMap, PictureOptions

COLORS = {**CLASS_COLORS, 'prediction': PREDICTION_COLOR}
PAIRS = [pair for pair in combinations(COLORS, 2) if COLORS[pair[0]] != COLORS[pair[1]]]

# G. Sharma, W. Wu, E. N. Dalal, "The CIEDE2000 Color-Difference Formula", Color Research and
# Application 30(1), 2005, table 1: pairs 1, 4, 7, 9, 13, 16, 17, 20, 24, 25, 28 and 34.
SHARMA = [
    ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
    ((50, -1.3802, -84.2814), (50, 0, -82.7485), 1.0),
    ((50, 0, 0), (50, -1, 2), 2.3669),
    ((50, 2.49, -0.001), (50, -2.49, 0.0009), 7.1792),
    ((50, -0.001, 2.49), (50, 0.0009, -2.49), 4.8045),
    ((50, 2.5, 0), (50, 0, -2.5), 4.3065),
    ((50, 2.5, 0), (73, 25, -18), 27.1492),
    ((50, 2.5, 0), (58, 24, 15), 19.4535),
    ((50, 2.5, 0), (50, 3.2592, 0.335), 1.0),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.694), (23.0331, 14.973, -42.5619), 2.0373),
    ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
]


@pytest.mark.parametrize(('one', 'other', 'expected'), SHARMA)
def test_the_formula_gives_the_published_differences(one, other, expected):
    assert ciede2000(one, other) == pytest.approx(expected, abs=5e-5)
    assert ciede2000(other, one) == pytest.approx(expected, abs=5e-5)


def test_lab_of_known_colours():
    np.testing.assert_allclose(lab(linear((255, 255, 255))), [100, 0, 0], atol=0.02)
    # OpenCV's own conversion, which is of the same white.
    for rgb in COLORS.values():
        theirs = cv2.cvtColor(np.float32([[rgb]]) / 255, cv2.COLOR_RGB2LAB)[0, 0]
        np.testing.assert_allclose(lab(linear(rgb)), theirs, atol=0.5)


def test_deuteranopes_see_grey_as_it_is_and_mistake_red_for_green():
    np.testing.assert_allclose(deuteranope(linear((99, 99, 99))), linear((99, 99, 99)), atol=1e-6)
    red, green = linear((178, 60, 50)), linear((110, 98, 50))
    assert ciede2000(lab(red), lab(green)) > 30
    assert ciede2000(lab(deuteranope(red)), lab(deuteranope(green))) < 12


@pytest.mark.parametrize(('one', 'other'), PAIRS)
@pytest.mark.parametrize('seen', [lambda rgb: rgb, deuteranope], ids=['normal', 'deuteranopia'])
def test_classes_and_predictions_are_told_apart(one, other, seen):
    a, b = (lab(seen(linear(COLORS[kind]))) for kind in (one, other))
    assert ciede2000(a, b) >= 12


RESULTS = {**{verdict.value: rgb for verdict, rgb in VERDICT_COLORS.items()}, '-': NEUTRAL_COLOR}


@pytest.mark.parametrize('result', RESULTS)
@pytest.mark.parametrize('seen', [lambda rgb: rgb, deuteranope], ids=['normal', 'deuteranopia'])
def test_results_of_a_comparison_are_told_apart_and_from_predictions(result, seen):
    others = {**RESULTS, 'prediction': PREDICTION_COLOR}
    del others[result]
    mine = lab(seen(linear(RESULTS[result])))
    for name, rgb in others.items():
        assert ciede2000(mine, lab(seen(linear(rgb)))) >= 15, name


@pytest.mark.parametrize('result', RESULTS)
def test_results_are_seen_on_dark(result):
    assert contrast(RESULTS[result], BACKGROUND[::-1]) >= 3


@pytest.mark.parametrize('kind', COLORS)
def test_each_class_is_seen_on_dark_and_on_light(kind):
    assert contrast(COLORS[kind], (255, 255, 255)) >= 3
    assert contrast(COLORS[kind], BACKGROUND[::-1]) >= 3


def test_steps_of_the_default_map_are_even():
    """Of a perceptually uniform map equal steps look equal, and the lightness only rises."""

    def steps(color_map):
        colors = [lab(linear(bgr[::-1])) for bgr in color_table(color_map)[1::8, 0]]
        lightness = np.array([color[0] for color in colors])
        return np.array([ciede2000(a, b) for a, b in pairwise(colors)]), lightness

    differences, lightness = steps(PictureOptions().color_map)
    assert differences.std() / differences.mean() < 0.3
    assert (np.diff(lightness) > 0).all()
    uneven, rainbow = steps(ColorMap.JET)
    assert uneven.std() / uneven.mean() > 0.3
    assert not (np.diff(rainbow) > 0).all()
