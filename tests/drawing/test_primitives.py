# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lines and areas are cut to the image before OpenCV counts in fixed point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import SIZE, bounds_of, canvas, drawn

from kitti_ros2.drawing.primitives import (
    cut_polygon,
    cut_segments,
    dashes,
    draw_segments,
    has_pixels,
    tint_polygon,
)

WHITE = (255, 255, 255)
MARGIN = 8.0
ENDS = st.tuples(*[st.floats(-2000, 2000)] * 4).map(lambda ends: np.reshape(ends, (1, 2, 2)))


@given(ENDS)
def test_a_cut_line_is_the_part_of_it_inside(line):
    parts, origins = cut_segments(line, SIZE)
    steps = np.linspace(0, 1, 200)[:, None]
    along = line[0, 0] + steps * (line[0, 1] - line[0, 0])
    high = np.array(SIZE) - 1 + MARGIN
    inside = along[((along >= -MARGIN) & (along <= high)).all(axis=1)]
    assert len(parts) == len(origins)
    if not len(parts):
        assert not len(inside)
        return
    (start, end) = parts[0]
    assert (parts >= -MARGIN - 1e-6).all()
    assert (parts <= high + 1e-6).all()
    for point in (start, end):  # still on the line
        cross = np.cross([*(line[0, 1] - line[0, 0]), 0], [*(point - line[0, 0]), 0])[2]
        assert abs(cross) <= 1e-6 * max(np.ptp(line[0], axis=0).max(), 1) ** 2
    for point in inside:  # and nothing of it is lost
        assert (point >= np.minimum(start, end) - 1e-6).all()
        assert (point <= np.maximum(start, end) + 1e-6).all()


@pytest.mark.parametrize('far', [1e4, 1e6, 1e9, 1e11])
def test_far_ends_do_not_wrap_around(far):
    """Fixed point has room for some 1e8 pixels; what is beyond would come back elsewhere."""
    picture = canvas()
    lines = np.array([[[-far, 50.0], [far, 50.0]], [[far, far], [2 * far, far]]])
    parts, _ = cut_segments(lines, SIZE)
    draw_segments(picture, parts, WHITE)
    assert drawn(picture)[50].all()
    assert not drawn(picture)[[*range(49), *range(52, SIZE[1])]].any()


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_no_place_is_not_drawn(bad):
    parts, origins = cut_segments(np.array([[[bad, 0], [5, 5]], [[1, 2], [3, 4]]]), SIZE)
    assert origins.tolist() == [1]
    assert parts.tolist() == [[[1, 2], [3, 4]]]
    assert not len(cut_polygon(np.array([[bad, 0], [5, 5], [5, 0]]), SIZE))


@given(ENDS, st.floats(0.5, 3))
def test_dashes_begin_and_end_with_the_line(line, scale):
    pieces = dashes(line, scale)
    np.testing.assert_allclose(pieces[0, 0], line[0, 0])
    np.testing.assert_allclose(pieces[-1, 1], line[0, 1], atol=1e-6)
    length = np.linalg.norm(line[0, 1] - line[0, 0])
    inked = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum()
    assert length < 30 * scale or 0.5 * length < inked < 0.7 * length


@given(st.lists(st.tuples(st.floats(-900, 900), st.floats(-900, 900)), min_size=3, max_size=3))
@example([(-8.0, 0.0), (-9.0, 0.0), (-9.0, 1.0)])
def test_a_cut_polygon_covers_what_the_whole_one_covers(corners):
    whole = np.array(corners)
    cut = cut_polygon(whole, SIZE)
    rng = np.random.default_rng(0)
    for point in rng.uniform((0, 0), SIZE, (20, 2)):
        if abs(area_signs(whole, point)).min() > 1:  # not on an edge
            assert covers(cut, point) == covers(whole, point)


def area_signs(corners, point):
    following = np.roll(corners, -1, axis=0)
    ahead, aside = following - corners, point - corners
    return ahead[:, 0] * aside[:, 1] - ahead[:, 1] * aside[:, 0]


def covers(corners, point):
    signs = area_signs(corners, point)
    has_area = bool((np.abs(signs) > 1e-6).any())  # what is cut off may be left as a single place
    return has_area and bool((signs > -1e-6).all() or (signs < 1e-6).all())


def test_a_tint_is_translucent_and_stays_in_its_shape():
    picture = np.full((SIZE[1], SIZE[0], 3), 100, np.uint8)
    tint_polygon(picture, np.array([[50, 50], [90, 50], [90, 90], [50, 90]]), WHITE, 0.5)
    assert picture[70, 70].tolist() == [178, 178, 178]
    assert bounds_of(picture[..., 0] > 150) == (50, 50, 90, 90)
    before = picture.copy()
    tint_polygon(picture, np.array([[-90, -90], [-50, -90], [-50, -50]]), WHITE, 0.5)
    np.testing.assert_array_equal(picture, before)


def test_what_cannot_be_drawn_on_is_refused():
    frozen = canvas()
    frozen.flags.writeable = False
    for picture, reason in (
        (np.zeros((3, 4), np.uint8), r'\(H, W, 3\)'),
        (np.zeros((3, 4, 3), np.float32), 'float32'),
        (frozen, 'read-only'),
    ):
        with pytest.raises(ValueError, match=reason):
            has_pixels(picture)
    assert not has_pixels(np.zeros((0, 5, 3), np.uint8))
