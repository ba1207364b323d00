# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The points that filters keep."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scans import clouds, filters, whole_scan

from kitti_ros2.datasets.scan_crop import CameraView, first_of_each_voxel, kept_points
from kitti_ros2.drawing.projection import Projection
from kitti_ros2.model.errors import UsageError
from kitti_ros2.options.datasets import View, make_crop_options

FORWARD = np.array([[50.0, -100, 0, 0], [50, 0, -100, 0], [1, 0, 0, 0]])
"""A camera of 100 x 100 pixels at the scanner: u is to the right, v down, depth forward."""


def kept(points, camera=None, **options):
    """The rows that are kept."""
    array = np.array(points, np.float32).reshape(-1, 4)
    return np.flatnonzero(kept_points(array, make_crop_options(options), camera)).tolist()


def at(*places):
    return [(*place, 0.5) for place in places]


@given(clouds)
def test_without_filters_all_points_are_kept(points):
    assert kept_points(points, make_crop_options({}), None).all()


@given(clouds, filters)
def test_points_that_are_kept_are_finite_and_keep_their_bytes_and_order(points, options):
    keep = kept_points(points, options, None)
    assert keep.shape == (len(points),)
    assert keep.dtype == bool
    if options.cuts:
        assert np.isfinite(points[keep, :3]).all()


@given(clouds, filters)
def test_a_second_cut_changes_nothing(points, options):
    once = points[kept_points(points, options, None)]
    assert kept_points(once, options, None).all()


@given(clouds, filters)
def test_filters_but_voxels_are_those_of_each_point(points, options):
    if options.voxel_m is None:
        keep = kept_points(points, options, None)
        alone = [bool(kept_points(points[[row]], options, None)[0]) for row in range(len(points))]
        assert keep.tolist() == alone


def test_a_box_has_its_faces_and_several_are_alternatives():
    points = at((0, 0, 0), (1, 1, 1), (1.001, 1, 1), (5, 0, 0), (6, 0, 0))
    assert kept(points, box=[0, 0, 0, 1, 1, 1]) == [0, 1]
    assert kept(points, box=['0', '0,0', '1 1', '1', '5,0,0,6,1,1']) == [0, 1, 3, 4]
    assert kept(points, box=[[0, 0, 0, 1, 1, 1], [4, -1, -1, 5, 1, 1]]) == [0, 1, 3]


def test_range_is_the_distance_in_space_and_height_is_z():
    points = at((3, 4, 0), (0, 0, 6), (0, 0, -6), (0.1, 0, 0))
    assert kept(points, range='5:6') == [0, 1, 2]
    assert kept(points, range=':5') == [0, 3]
    assert kept(points, range='5.5:') == [1, 2]
    assert kept(points, height='-6:0') == [0, 2, 3]
    assert kept(points, range=(1, None), height=(0, 6)) == [0, 1]


def test_a_voxel_keeps_its_first_point_in_the_file():
    points = at((0.05, 0, 0), (0.0, 0, 0), (0.11, 0, 0), (-0.01, 0, 0), (0.19, 0, 0.09))
    assert kept(points, voxel=0.1) == [0, 2, 3]


@given(clouds, st.floats(0.01, 30))
def test_voxels_have_one_point_each_and_all_are_there(points, size):
    places = points[np.isfinite(points[:, :3]).all(axis=1), :3].astype(np.float64)
    keep = first_of_each_voxel(places, size)
    cells = [tuple(cell) for cell in np.floor(places / size).tolist()]
    first = {cell: row for row, cell in reversed(list(enumerate(cells)))}
    assert np.flatnonzero(keep).tolist() == sorted(first.values())


@pytest.mark.parametrize(('lasers', 'step'), [(32, 2), (16, 4)])
def test_every_nth_laser_from_the_lowest(lasers, step):
    points = whole_scan()
    laser = 63 - np.repeat(np.arange(64), 40)
    rows = kept(points, lasers=lasers)
    assert sorted(set(laser[rows].tolist())) == list(range(0, 64, step))
    assert len(rows) == lasers * 40
    assert kept(points[rows], lasers=lasers) == list(range(len(rows)))


def test_16_lasers_are_not_taken_of_32():
    points = whole_scan()
    half = points[kept(points, lasers=32)]
    with pytest.raises(ValueError, match='32 lasers are found instead of 64'):
        kept(half, lasers=16)


def test_points_without_coordinates_hide_no_laser():
    points = whole_scan()
    points[40 * 7 - 1 : 40 * 7 + 1, :3] = np.nan  # the wrap from the seventh to the eighth laser
    rows = kept(points, lasers=32)
    assert len(rows) == 32 * 40 - 1
    assert np.isfinite(points[rows]).all()


@pytest.mark.parametrize('lasers', [63, 65, 128])
def test_a_scan_of_another_scanner_is_refused(lasers):
    with pytest.raises(ValueError, match=f'{lasers} lasers are found instead'):
        kept(whole_scan(lasers), lasers=32)


def test_a_cropped_scan_is_refused_with_lasers():
    points = whole_scan()
    points = points[(points[:, 0] > 0) & (points[:, 2] < -1)]
    with pytest.raises(ValueError, match='instead of 64'):
        kept(points, lasers=16)


@pytest.mark.parametrize('lasers', [0, 1, 24, 64, -16])
def test_other_numbers_of_lasers_are_refused(lasers):
    with pytest.raises(UsageError, match='expected 32 or 16 of 64'):
        make_crop_options({'lasers': lasers})


def pixel(u, v, depth=10.0, reflectance=0.5):
    """The point in the scanner's frame that is seen at a pixel."""
    return depth, -(u - 50) * depth / 100, -(v - 50) * depth / 100, reflectance


def test_the_reduced_rule():
    view = CameraView(View.REDUCED, Projection(FORWARD), (100, 100))
    points = [
        pixel(50, 50),
        pixel(50, 50, reflectance=0.0),
        pixel(50, 50, depth=99.9),
        pixel(50, 50, depth=100.1),
        pixel(50, 50, depth=0.0011),
        pixel(50, 50, depth=0.0009),
        pixel(0.02, 50),
        pixel(-0.02, 50),
        pixel(99.98, 99.98),
        pixel(50, 100.02),
        (-10, 0, 0, 0.5),
        (np.nan, 0, 0, 0.5),
    ]
    assert kept(points, view, view='reduced') == [0, 1, 2, 4, 6, 8]


def test_the_reference_rule():
    view = CameraView(View.REFERENCE, Projection(FORWARD), (100, 100))
    points = [
        pixel(50, 50),
        pixel(50, 50, reflectance=0.0),
        pixel(50, 50, depth=500.0),
        pixel(0.52, 50),  # becomes 1
        pixel(0.48, 50),  # becomes 0, which is outside
        pixel(99.48, 50),
        pixel(99.52, 50),  # becomes 100
        (-10, 0, 0, 0.5),
        (0, 0, 0, 0.5),
    ]
    assert kept(points, view, view='reference') == [0, 2, 3, 5]


def test_half_pixels_are_rounded_to_even():
    view = CameraView(View.REFERENCE, Projection(FORWARD), (100, 100))
    places = np.array([[1.0, 0.495, 0.0], [1.0, -0.495, 0.0]])  # u is 0.5 and 99.5
    exact = view.projection.pixels(view.projection.homogeneous(places))
    assert exact[:, 0].tolist() == [0.5, 99.5]
    points = np.full((2, 4), 0.5, np.float32)
    assert view.sees(points, places).tolist() == [False, False]


@given(clouds, st.sampled_from(View))
@example(np.array([pixel(50, 50)], np.float32), View.REDUCED)
def test_a_second_view_changes_nothing(points, rule):
    view = CameraView(rule, Projection(FORWARD), (100, 100))
    options = make_crop_options({'view': rule.value})
    once = points[kept_points(points, options, view)]
    assert kept_points(once, options, view).all()


def test_lasers_are_counted_before_the_view_and_voxels_after():
    view = CameraView(View.REDUCED, Projection(FORWARD), (100, 100))
    points = whole_scan()
    both = set(kept(points, view, view='reduced')) & set(kept(points, lasers=32))
    assert set(kept(points, view, view='reduced', lasers=32)) == both
    assert kept(at((-0.01, 0, 0), (0.5, 0, 0), (0.6, 0, 0)), range='0.1:', voxel=1) == [1]
