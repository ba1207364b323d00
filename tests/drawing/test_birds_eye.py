# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The view from above: metres to pixels, headings, rings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import bounds_of, canvas, drawn, flat, solid

from kitti_ros2.drawing.birds_eye import (
    BACKGROUND,
    BirdView,
    birds_eye,
    describe_omitted,
    draw_footprints,
    draw_points_from_above,
)
from kitti_ros2.model.boxes import DONT_CARE
from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.outputs import BirdOptions

OPTIONS = BirdOptions((-5.0, 25.0), (-10.0, 10.0), 10.0)
VIEW = BirdView.of(OPTIONS)


def footprint(box, predicted=False):
    picture = canvas(OPTIONS.size)
    labels, predictions = ([], [box]) if predicted else ([box], [])
    draw_footprints(picture, labels, VIEW, predictions, named=False)
    return drawn(picture)


def test_a_box_lands_where_it_is():
    """At (10, 0), 4 m long and 2 m wide: rows 130 to 170, columns 90 to 110; its arrow beyond."""
    mask = footprint(solid(10))
    left, top, right, bottom = bounds_of(mask)
    assert abs(left - 89.5) <= 2
    assert abs(right - 109.5) <= 2
    assert abs(bottom - 169.5) <= 2
    assert 129.5 - 12 - 3 <= top < 129.5 - 5
    assert mask[160, 89:91].any()
    assert not mask[140:165, 93:97].any()


@pytest.mark.parametrize('predicted', [False, True])
@pytest.mark.parametrize(
    ('yaw', 'toward'),
    [(0.0, (-1, 0)), (np.pi, (1, 0)), (np.pi / 2, (0, -1)), (-np.pi / 2, (0, 1))],
)
def test_the_arrow_points_ahead(yaw, toward, predicted):
    """(row, column) that it points to: x is up and y is left."""
    mask = footprint(solid(10, yaw=yaw, size_lwh=(4.0, 4.0, 1.5)), predicted)
    centre = np.array([149.5, 99.5])
    reach = (np.argwhere(mask) - centre) @ np.array(toward)
    back = (np.argwhere(mask) - centre) @ -np.array(toward)
    assert reach.max() > 20 + 8
    assert back.max() <= 20 + 3


def test_predictions_are_dashed():
    label, prediction = footprint(solid(10)), footprint(solid(10), predicted=True)
    assert prediction.sum() < 0.7 * label.sum()


def test_left_is_left_and_points_are_where_they_are():
    picture = canvas(OPTIONS.size)
    points = np.array([[10.05, 3.05, 0, 0], [99, 0, 0, 0], [np.nan] * 4], np.float32)
    draw_points_from_above(picture, points, VIEW)
    assert np.argwhere(picture.any(axis=2)).tolist() == [[149, 69]]


@pytest.mark.parametrize('order', [[0, 1], [1, 0]])
def test_the_highest_point_is_on_top(order):
    pair = np.array([[10, 0, -1.5, 0], [10, 0, 2.0, 0]], np.float32)
    both, high = canvas(OPTIONS.size), canvas(OPTIONS.size)
    draw_points_from_above(both, pair[order], VIEW)
    draw_points_from_above(high, pair[1:], VIEW)
    np.testing.assert_array_equal(both, high)


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(0.1, 50))
def test_pixels_are_steps_of_the_resolution(x, y, scale):
    view = BirdView(7.0, 30.0, scale)
    column, row = view.pixels(np.array([x, y]))
    assert 7.0 - (column + 0.5) / scale == pytest.approx(y, abs=1e-9)
    assert 30.0 - (row + 0.5) / scale == pytest.approx(x, abs=1e-9)


def test_rings_are_at_equal_distances():
    picture = birds_eye(None, [], [], BirdOptions((-30.0, 30.0), (-30.0, 30.0), 10.0))
    assert picture.shape == (600, 600, 3)
    # Down from the scanner, where neither the car nor labels are.
    crossings = np.flatnonzero((picture[330:, 300] != BACKGROUND).any(axis=1)) + 330
    radii = (crossings - 299.5) / 10
    assert {10.0, 20.0} <= {round(radius) for radius in radii}
    assert all(abs(radius - round(radius, -1)) < 0.3 for radius in radii)


def test_objects_out_of_range_are_named_and_counted():
    objects = [solid(10), solid(26.9), solid(27.1), solid(-40), solid(0, 50, kind='Van')]
    lines = describe_omitted(objects, [solid(99, kind='Cyclist')], VIEW, OPTIONS.size)
    assert lines == ['out of range: 2 Car, 1 Van', 'predictions out of range: 1 Cyclist']
    assert describe_omitted([solid(10)], [], VIEW, OPTIONS.size) == []


def test_objects_without_a_3d_box_are_named_and_counted():
    objects = [flat(0, 0, 9, 9), flat(0, 0, 9, 9, kind=DONT_CARE), solid(10)]
    assert describe_omitted(objects, [], VIEW, OPTIONS.size) == ['without a 3D box: 1 Car']


@pytest.mark.parametrize('x', np.linspace(24.0, 28.0, 9))
def test_an_object_is_either_drawn_or_out_of_range(x):
    """The view ends at x = 25, and the rear of the car is at x - 2."""
    car = solid(x)
    assert bool(describe_omitted([car], [], VIEW, OPTIONS.size)) == (x > 26.9)
    assert footprint(solid(x, size_lwh=(4.0, 8.0, 1.5))).any() == (x <= 26.9)


def test_the_view_shows_its_scale_and_what_is_out_of_range():
    """Lower left the colour bar, lower right the note; neither without a reason."""
    options = BirdOptions((-5.0, 25.0), (-20.0, 20.0), 10.0)
    points = np.array([[5, 0, 0, 0]], np.float32)
    bare, plain, noted = (
        birds_eye(*contents, [], options)
        for contents in ((None, []), (points, []), (points, [solid(99)]))
    )
    bar, note = (slice(250, 300), slice(0, 230)), (slice(250, 300), slice(240, 400))
    assert (bare[bar] != plain[bar]).any()
    assert (bare[note] == plain[note]).all()
    assert (plain[bar] == noted[bar]).all()
    assert (plain[note] != noted[note]).any()


def test_the_size_is_range_times_resolution():
    assert OPTIONS.size == (200, 300)
    assert birds_eye(None, [], [], OPTIONS).shape == (300, 200, 3)


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'x_range': (5.0, 5.0)}, 'empty in x'),
        ({'y_range': (9.0, 1.0)}, 'empty in y'),
        ({'x_range': (np.nan, 5.0)}, 'empty in x'),
        ({'y_range': (0.0, np.inf)}, 'empty in y'),
        ({'pixels_per_metre': 0.0}, 'not positive'),
        ({'pixels_per_metre': np.nan}, 'not positive'),
        ({'pixels_per_metre': 1e4}, 'a side'),
        ({'pixels_per_metre': 1e-4}, 'a side'),
        ({'x_range': (-1e308, 1e308)}, 'a side'),
    ],
)
def test_views_that_cannot_be_are_refused(values, reason):
    with pytest.raises(UsageError, match=reason):
        BirdOptions(**values)
