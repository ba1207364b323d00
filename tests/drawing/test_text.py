# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Words in images: they fit, they stay in the image, and tags keep apart."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import SIZE, bounds_of, canvas

from kitti_ros2.drawing.primitives import Tag, draw_tags, extent_of, fitted, printable, put_text

COLORS = [(250, 0, 0), (0, 250, 0), (0, 0, 250), (250, 250, 0), (0, 250, 250)]
SCALE = 0.4


def tag_pixels(picture, color):
    return (picture == color).all(axis=2)


@pytest.mark.parametrize('bounds', [(150, 90, 250, 140), (-40, -30, 30, 20), (390, 190, 420, 230)])
def test_tags_of_one_place_keep_apart_within_the_image(bounds):
    picture = canvas()
    clipped = tuple(np.clip(bounds, 0, [SIZE[0] - 1, SIZE[1] - 1] * 2).tolist())
    draw_tags(picture, [Tag('Car 12', clipped, color) for color in COLORS], SCALE)
    extent = extent_of('Car 12', SCALE)
    for color in COLORS:
        left, top, right, bottom = bounds_of(tag_pixels(picture, color))
        assert right - left + 1 >= extent.width, 'cut off'
        assert bottom - top + 1 >= extent.above + extent.below, 'hidden'


MEMORY = """
import tracemalloc
import numpy as np
from kitti_ros2.drawing.primitives import Tag, draw_tags

for count in (20, 2000):
    picture = np.zeros((240, 400, 3), np.uint8)
    tags = [Tag('Car', (100.0, 100.0, 200.0, 150.0), (250, 0, 0))] * count
    tracemalloc.start()
    draw_tags(picture, tags, 0.4)
    print(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
"""


def test_the_place_of_a_tag_costs_the_same_after_thousands():
    done = subprocess.run(  # other threads of this process allocate as well
        [sys.executable, '-c', MEMORY], capture_output=True, text=True, check=True
    )
    few, many = map(int, done.stdout.split())
    assert many < 2 * few


def test_a_tag_that_is_outlined_is_another():
    filled, outlined = canvas(), canvas()
    box = (100.0, 100.0, 200.0, 150.0)
    draw_tags(filled, [Tag('Car', box, COLORS[0])], SCALE)
    draw_tags(outlined, [Tag('Car', box, COLORS[0], outlined=True)], SCALE)
    assert tag_pixels(filled, COLORS[0]).sum() > 2 * tag_pixels(outlined, COLORS[0]).sum() > 0


@given(st.text(max_size=400))
def test_any_text_can_be_drawn(text):
    picture = canvas()
    put_text(picture, text, (5, 100), SCALE)
    assert extent_of(text, SCALE).width >= 0
    assert len(printable(text)) <= len(text)
    assert printable(text).isprintable()


@given(st.text('abcdefgW.', max_size=80), st.integers(60, 300))
def test_fitted_text_fits(text, width):
    shown = fitted(text, width, SCALE)
    assert extent_of(shown, SCALE).width <= width
    assert shown == text or (shown.endswith('...') and text.startswith(shown[:-3]))


def gaps(text, scale, bold):
    """The widths of the empty columns within a text, pixels."""
    picture = canvas()
    put_text(picture, text, (20, 100), scale, bold=bold)
    drawn = np.flatnonzero((picture > 64).any(axis=(0, 2)))
    return (np.diff(drawn) - 1).tolist()


@pytest.mark.parametrize('bold', [False, True])
@pytest.mark.parametrize('scale', [0.36, 0.37, 0.38, 0.4, 0.42, 0.45, 0.6, 0.7, 1.1])
@pytest.mark.parametrize(('words', 'joined'), [('27 80', '2780'), ('27 11.1 m', '2711.1m')])
def test_numbers_keep_apart_in_any_opencv(words, joined, scale, bold):
    """OpenCV 5 has blanks of two pixels."""
    closest = sorted(gaps(words, scale, bold))[-words.count(' ')]
    assert closest >= 0.4 * extent_of('0', scale, bold=bold).width
    assert closest > max(gaps(joined, scale, bold))


def test_letters_have_the_room_that_was_measured():
    for text in ('Pedestrian 12 0.87', 'gjpqy|'):
        picture = canvas()
        extent = extent_of(text, SCALE)
        put_text(picture, text, (20, 100), SCALE)
        left, top, right, bottom = bounds_of(picture.any(axis=2))
        assert left >= 17
        assert right <= 20 + extent.width + 3
        assert 100 - extent.above - 2 <= top
        assert bottom <= 100 + extent.below + 2
