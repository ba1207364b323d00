# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import cv2
import numpy as np
import pytest

from kitti_ros2.errors import BadFileError
from kitti_ros2.kitti.png_file import parse_image


def png(*shape: int, dtype: type = np.uint8) -> bytes:
    done, data = cv2.imencode('.png', np.zeros(shape, dtype))
    assert done
    return data.tobytes()


@pytest.mark.parametrize(('shape', 'channels'), [((5, 7), 1), ((5, 7, 3), 3), ((5, 7, 4), 3)])
def test_size_and_channels_without_decoding(shape, channels):
    data = png(*shape)
    image = parse_image(data, 'x.png')
    assert (image.width, image.height, image.channels) == (7, 5, channels)
    assert image.png is data


def test_grey_may_have_16_bits():
    image = parse_image(png(5, 7, dtype=np.uint16), 'x.png')
    assert (image.width, image.height, image.channels) == (7, 5, 1)


def test_a_byte_behind_the_end_is_no_cut():
    assert parse_image(png(5, 7) + b'\n', 'x.png').width == 7


@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (b'', 'empty'),
        (b'JFIF' * 20, 'no PNG'),
        (png(5, 7)[:20], 'no PNG'),
        (png(5, 7)[:-5], 'cut after'),
        (png(5, 7)[:40], 'cut after'),
        (png(5, 7, 3, dtype=np.uint16), '16 bits'),
    ],
)
def test_bad_images(data, said):
    with pytest.raises(BadFileError, match=said):
        parse_image(data, 'x.png')
