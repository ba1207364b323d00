# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The geometry of boxes: inverse pairs, and projections against a dense sampling of the surface."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from kitti_ros2.model.boxes import (
    EDGES,
    NEAR_M,
    Box,
    Cuboid,
    alpha_of,
    box_corners,
    box_of,
    box_rotations,
    clip_bounds,
    cuboid_of,
    has_cuboid,
    is_absurd,
    project_corners,
    unit_corners,
    wrap_angle,
)
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

ANGLES = st.floats(-pi, pi)
METRES = st.floats(-60, 60)
SIDES = st.floats(0.2, 15)
SIZES = st.tuples(SIDES, SIDES, SIDES)
LOCATIONS = st.tuples(METRES, st.floats(-3, 3), METRES)
PLACED = st.tuples(LOCATIONS, SIZES, ANGLES)
TILTS = st.floats(-0.1, 0.1)

VELO_AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""The camera's right, down and forward in an upright velo_link."""

RIGS = st.builds(
    lambda rpy, t: Transform(VELO_AXES @ rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(TILTS, TILTS, TILTS),
    st.tuples(*[st.floats(-2, 2)] * 3),
)
"""rect_T_velo of sensors that are nearly, not quite, upright to each other."""

P2 = np.array(
    [
        [721.5377, 0, 609.5593, 44.85728],
        [0, 721.5377, 172.854, 0.2163791],
        [0, 0, 1, 0.002745884],
    ]
)
IMAGE = (1242, 375)


def columns(placed):
    """(N, 3) locations, (N, 3) sizes and (N,) headings."""
    return tuple(np.array([one[i] for one in placed]) for i in range(3))


def label(location, size_hwl, rotation_y, kind='Car') -> Box:
    return Box(kind, 0.0, 0, 0.0, (0.0, 0.0, 1.0, 1.0), size_hwl, location, rotation_y)


def assert_same_angle(one, other, tolerance=1e-9):
    np.testing.assert_allclose(np.cos(one), np.cos(other), atol=tolerance)
    np.testing.assert_allclose(np.sin(one), np.sin(other), atol=tolerance)


def test_corners_come_in_the_order_told():
    """Heading along the camera's +x, so left is ahead of the camera and up is -y."""
    (corners,) = box_corners((0, 1, 10), (2, 3, 4), 0)
    bottom = [(2, 1, 11.5), (2, 1, 8.5), (-2, 1, 8.5), (-2, 1, 11.5)]
    np.testing.assert_allclose(corners, bottom + [(x, -1, z) for x, _, z in bottom], atol=1e-12)


def test_the_heading_turns_from_x_to_the_camera():
    """rotation_y = pi/2 looks along -z, which is to the viewer."""
    (corners,) = box_corners((0, 1, 10), (2, 3, 4), pi / 2)
    np.testing.assert_allclose(corners[:4].mean(axis=0), (0, 1, 10), atol=1e-12)
    np.testing.assert_allclose(corners[:2, 2], 8, atol=1e-12)
    np.testing.assert_allclose(corners[2:4, 2], 12, atol=1e-12)


@given(st.lists(PLACED, min_size=1, max_size=5))
def test_corners_and_back(placed):
    location, size, rotation_y = columns(placed)
    corners = box_corners(location, size, rotation_y)
    assert corners.shape == (len(placed), 8, 3)
    for one, (place, sides, heading) in zip(corners, placed, strict=True):
        # numpy multiplies one box and several by different routines.
        alone = box_corners(place, sides, heading)[0]
        np.testing.assert_allclose(one, alone, rtol=1e-12, atol=1e-12)
    forward, left = corners[:, 0] - corners[:, 3], corners[:, 0] - corners[:, 1]
    sides = (corners[:, 4] - corners[:, 0], left, forward)
    again = np.column_stack([np.linalg.norm(side, axis=1) for side in sides])
    np.testing.assert_allclose(corners[:, :4].mean(axis=1), location, atol=1e-9)
    np.testing.assert_allclose(again, size, atol=1e-9)
    assert_same_angle(np.arctan2(-forward[:, 2], forward[:, 0]), rotation_y)


@given(PLACED)
def test_the_location_is_the_bottom_s_centre_and_y_points_down(placed):
    location, size, rotation_y = placed
    (corners,) = box_corners(*placed)
    np.testing.assert_allclose(corners[:4, 1], location[1], atol=1e-9)
    np.testing.assert_allclose(corners[4:, 1], location[1] - size[0], atol=1e-9)
    np.testing.assert_allclose(corners[:4].mean(axis=0), location, atol=1e-9)
    ahead = corners[:2].mean(axis=0) - location
    expected = np.array([cos(rotation_y), 0, -sin(rotation_y)]) * size[2] / 2
    np.testing.assert_allclose(ahead, expected, atol=1e-9)


@given(st.lists(ANGLES, min_size=1, max_size=5))
def test_box_rotations_are_rotations(angles):
    rotations = box_rotations(angles)
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, 1, 2), [np.eye(3)] * len(angles), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1)
    np.testing.assert_array_equal(rotations[:, :, 2], [[0, -1, 0]] * len(angles))


@given(SIZES)
def test_edges_are_the_twelve_of_a_cuboid(size):
    (corners,) = box_corners((0, 0, 0), size, 0.3)
    assert len({frozenset(edge) for edge in EDGES.tolist()}) == 12
    lengths = np.linalg.norm(corners[EDGES[:, 0]] - corners[EDGES[:, 1]], axis=1)
    np.testing.assert_allclose(np.sort(lengths), np.sort(np.repeat(size, 4)), atol=1e-9)


def test_unit_corners_are_of_the_cube_of_side_one():
    corners = unit_corners()
    assert {tuple(corner) for corner in corners.tolist()} == {
        (x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)
    }
    np.testing.assert_array_equal(corners[4:] - corners[:4], [[0, 0, 1]] * 4)


@given(st.floats(-1e3, 1e3))
@example(pi)
@example(-pi)
@example(float(np.nextafter(-pi, -4)))
def test_wrapped_angles_are_the_same_angles(angle):
    wrapped = wrap_angle(angle)
    assert -pi <= wrapped <= pi
    assert_same_angle(wrapped, angle)


@given(st.lists(PLACED, min_size=1, max_size=5))
def test_alpha_and_back(placed):
    location, _, rotation_y = columns(placed)
    alpha = alpha_of(location, rotation_y)
    assert (np.abs(alpha) <= pi).all()
    expected = rotation_y - np.arctan2(location[:, 0], location[:, 2])
    assert_same_angle(alpha, expected)


def test_alpha_straight_ahead_is_the_heading_and_real_ones_agree():
    assert alpha_of((0, 1.5, 20), -1.57) == pytest.approx([-1.57])
    # object 000002, Car: -1.67 in the file, at (3.18, 2.27, 34.38) with rotation_y -1.58
    assert alpha_of((3.18, 2.27, 34.38), -1.58) == pytest.approx([-1.67], abs=0.005)


@given(PLACED, RIGS)
def test_cuboid_and_back(placed, rect_t_velo):
    cuboid = cuboid_of(label(*placed), '7', rect_t_velo)
    assert (cuboid.class_name, cuboid.identity, cuboid.size_lwh) == ('Car', '7', placed[1][::-1])
    location, size, rotation_y = box_of(cuboid, rect_t_velo)
    np.testing.assert_allclose(location, placed[0], atol=1e-9)
    assert size == placed[1]
    assert_same_angle(rotation_y, placed[2])


@given(PLACED, RIGS)
def test_a_cuboid_has_the_label_s_corners(placed, rect_t_velo):
    """No point changes sides, whatever the tilt between the sensors."""
    cuboid = cuboid_of(label(*placed), '0', rect_t_velo)
    corners = cuboid.velo_T_box.apply(unit_corners() * cuboid.size_lwh)
    (expected,) = box_corners(*placed)
    np.testing.assert_allclose(rect_t_velo.apply(corners), expected, atol=1e-9)


@given(PLACED)
def test_an_upright_rig_has_the_yaw_of_the_books(placed):
    cuboid = cuboid_of(label(*placed), '0', Transform(VELO_AXES, np.zeros(3)))
    forward, up = cuboid.velo_T_box.rotation[:, 0], cuboid.velo_T_box.rotation[:, 2]
    assert_same_angle(np.arctan2(forward[1], forward[0]), -(pi / 2 + placed[2]))
    np.testing.assert_allclose(up, (0, 0, 1), atol=1e-12)


def test_a_cuboid_keeps_track_and_score():
    box = Box('Car', 0, 0, 0, (0, 0, 1, 1), (1, 1, 1), (0, 0, 9), 0, 0.25, 3, 12)
    cuboid = cuboid_of(box, '12', Transform(VELO_AXES, np.zeros(3)))
    assert isinstance(cuboid, Cuboid)
    assert (cuboid.track_id, cuboid.score) == (12, 0.25)


# Projection, against points on the box's surface.

FRACTIONS = np.linspace(-0.5, 0.5, 2001)


def surface(location, size_hwl, rotation_y):
    """Points of a box's edges and faces in the camera's frame, made without box_corners."""
    height, width, length = size_hwl
    grid = np.linspace(-0.5, 0.5, 21)
    parts = []
    for axis in range(3):
        for one in (-0.5, 0.5):
            parts += [
                np.insert([[one, other]] * len(FRACTIONS), axis, FRACTIONS, axis=1)
                for other in (-0.5, 0.5)
            ]
            flat = np.array(np.meshgrid(grid, grid)).reshape(2, -1).T
            parts.append(np.insert(flat, axis, one, axis=1))
    along, left, up = (np.concatenate(parts) * (length, width, height)).T
    c, s = cos(rotation_y), sin(rotation_y)
    x = location[0] + c * along + s * left
    y = location[1] - height / 2 - up
    z = location[2] - s * along + c * left
    return np.column_stack([x, y, z])


def sampled_bounds(placed, p_rect):
    """Left, top, right, bottom of the samples in front of the camera."""
    seen = surface(*placed) @ p_rect[:, :3].T + p_rect[:, 3]
    seen = seen[seen[:, 2] >= NEAR_M]
    pixels = seen[:, :2] / seen[:, 2:]
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def project(placed):
    return project_corners(box_corners(*placed), P2)[0]


@settings(max_examples=40)
@given(st.tuples(st.tuples(METRES, st.floats(-3, 3), st.floats(25, 80)), SIZES, ANGLES))
def test_a_box_in_front_is_bounded_by_its_surface(placed):
    expected = sampled_bounds(placed, P2)
    np.testing.assert_allclose(project(placed), expected, atol=1e-6)


@settings(max_examples=60)
@given(
    st.tuples(st.tuples(st.floats(-8, 8), st.floats(-3, 3), st.floats(-8, 8)), SIZES, ANGLES),
)
def test_a_box_partly_behind_the_camera_is_cut_in_front_of_it(placed):
    depths = box_corners(*placed)[0, :, 2] + P2[2, 3]
    assume(depths.min() < NEAR_M < depths.max())
    assume(depths.max() > NEAR_M + 0.05)
    bounds = project(placed)
    expected = sampled_bounds(placed, P2)
    outward = np.array([-1, -1, 1, 1])
    assert ((bounds - expected) * outward >= -1e-6).all()
    # The sample nearest to where an edge is cut is up to a step away, sideways and in depth.
    step = max(placed[1]) / (len(FRACTIONS) - 1)
    reach = np.abs(bounds - np.array([P2[0, 2], P2[1, 2]] * 2))
    assert (np.abs(bounds - expected) <= 1 + (reach + P2[0, 0]) * 2 * step / NEAR_M).all()


@given(
    st.tuples(st.tuples(METRES, st.floats(-3, 3), st.floats(-60, -12)), SIZES, ANGLES),
)
def test_a_box_wholly_behind_the_camera_has_no_bounds(placed):
    bounds = project_corners(box_corners(*placed), P2)
    assert np.isnan(bounds).all()
    cut, truncation = clip_bounds(bounds, IMAGE)
    assert np.isnan(cut).all()
    assert truncation.tolist() == [1.0]


@given(st.lists(PLACED, min_size=2, max_size=5))
def test_projection_is_the_same_for_one_and_for_many(placed):
    together = project_corners(box_corners(*columns(placed)), P2)
    apart = np.array([project(one) for one in placed])
    np.testing.assert_allclose(together, apart, rtol=1e-12)


EDGE = st.floats(-3000, 3000)
RECTANGLES = st.tuples(EDGE, EDGE, st.floats(1, 2000), st.floats(1, 2000)).map(
    lambda r: np.array([r[0], r[1], r[0] + r[2], r[1] + r[3]])
)


@given(st.lists(RECTANGLES, min_size=1, max_size=5))
def test_clipping_and_truncation(rectangles):
    bounds = np.array(rectangles)
    cut, truncation = clip_bounds(bounds, IMAGE)
    share = (np.arange(400) + 0.5) / 400
    for whole, part, gone in zip(bounds, cut, truncation, strict=True):
        u = whole[0] + share * (whole[2] - whole[0])
        v = whole[1] + share * (whole[3] - whole[1])
        inside = ((u > 0) & (u < IMAGE[0] - 1)).mean() * ((v > 0) & (v < IMAGE[1] - 1)).mean()
        assert gone == pytest.approx(1 - inside, abs=0.01)
        if np.isnan(part).any():
            assert np.isnan(part).all()
            assert gone == 1
            assert inside < 0.01
            continue
        assert (part[:2] >= [0, 0]).all()
        assert (part[2:] <= [IMAGE[0] - 1, IMAGE[1] - 1]).all()
        assert (part[:2] >= whole[:2]).all()
        assert (part[2:] <= whole[2:]).all()
        assert (part[:2] < part[2:]).all()
        if gone == 0:
            np.testing.assert_allclose(part, whole, atol=1e-9)


@pytest.mark.parametrize(
    ('bounds', 'cut', 'truncation'),
    [
        ((10, 20, 30, 40), (10, 20, 30, 40), 0),
        ((-10, 20, 10, 40), (0, 20, 10, 40), 0.5),
        ((1231, 364, 1251, 384), (1231, 364, 1241, 374), 0.75),
        ((-30, 20, -10, 40), None, 1),
        ((1300, 20, 1400, 40), None, 1),
        ((10, 400, 30, 500), None, 1),
        ((-10, -10, 2000, 2000), (0, 0, 1241, 374), 1 - 1241 * 374 / 2010**2),
    ],
)
def test_clipping_examples(bounds, cut, truncation):
    found, part = clip_bounds(np.array([bounds], float), IMAGE)
    np.testing.assert_allclose(found[0], cut or [np.nan] * 4)
    assert part == pytest.approx([truncation])


def test_a_box_beside_the_camera_is_out_of_view():
    cut, truncation = clip_bounds(project(((50, 1.6, 5), (1.5, 1.6, 4), 0.2))[None], IMAGE)
    assert np.isnan(cut).all()
    assert truncation.tolist() == [1.0]


@pytest.mark.parametrize(
    ('kind', 'size', 'solid', 'absurd'),
    [
        ('Car', (1.5, 1.6, 4.0), True, False),
        ('my-robot', (0.1, 0.1, 0.1), True, False),
        ('Car', (-1.0, -1.0, -1.0), False, False),
        ('DontCare', (-1.0, -1.0, -1.0), False, False),
        ('DontCare', (-1000.0, -1000.0, -1000.0), False, False),
        ('Car', (0.0, 1.6, 4.0), True, True),
        ('Car', (1.5, -1.6, 4.0), True, True),
        ('Car', (1.5, 1.6, -1.0), True, True),
        ('Car', (0.0, 0.0, 0.0), True, True),
    ],
)
def test_which_labels_are_3d_boxes(kind, size, solid, absurd):
    box = label((0, 0, 9), size, 0, kind)
    assert (has_cuboid(box), is_absurd(box)) == (solid, absurd)
