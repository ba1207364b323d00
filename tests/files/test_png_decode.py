# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import struct
import sys
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.files.png.decode import decode_png, inflated
from kitti_ros2.files.png.header import parse_image


def noisy(shape, seed: int) -> np.ndarray:
    """Smooth with some noise, so that encoders choose among filters."""
    rng = np.random.default_rng(seed)
    ramp = np.linspace(0, 255, shape[1])[None, :] + np.linspace(0, 90, shape[0])[:, None]
    ramp = ramp if len(shape) == 2 else ramp[..., None]
    return (ramp + rng.integers(0, 20, shape)).astype(np.uint8)


FILTERS = [
    cv2.IMWRITE_PNG_FILTER_NONE, cv2.IMWRITE_PNG_FILTER_SUB, cv2.IMWRITE_PNG_FILTER_UP,
    cv2.IMWRITE_PNG_FILTER_AVG, cv2.IMWRITE_PNG_FILTER_PAETH, cv2.IMWRITE_PNG_ALL_FILTERS,
] if hasattr(cv2, 'IMWRITE_PNG_FILTER') else [None]  # fmt: skip


@given(
    st.integers(1, 90),
    st.integers(1, 300),
    st.sampled_from([1, 3]),
    st.sampled_from(FILTERS),
    st.integers(0, 9),
)
@settings(max_examples=60, deadline=None)
def test_pixels_are_the_encoded_ones(height, width, channels, chosen, level):
    shape = (height, width, 3) if channels == 3 else (height, width)
    pixels = noisy(shape, height * width)
    flags = [cv2.IMWRITE_PNG_COMPRESSION, level]
    if chosen is not None:
        flags += [cv2.IMWRITE_PNG_FILTER, chosen]
    data = cv2.imencode('.png', pixels, flags)[1].tobytes()
    np.testing.assert_array_equal(decode_png(parse_image(data, 'x')), pixels)


def test_the_data_is_stored_and_the_rest_kept():
    pytest.importorskip('isal')
    pixels = noisy((200, 400, 3), 1)
    data = cv2.imencode('.png', pixels)[1].tobytes()
    text = b'tEXtkey\0value'
    chunk = struct.pack('>I', len(text) - 4) + text + struct.pack('>I', zlib.crc32(text))
    data = data[:33] + chunk + data[33:]
    stored = inflated(data)
    assert len(stored) > 200 * 1200
    assert chunk in stored
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(stored, np.uint8), -1), pixels)


@pytest.mark.parametrize('damage', [slice(50, 60), slice(-16, -12), slice(41, 43)])
def test_damaged_data_is_refused_or_left_to_opencv(damage):
    sound = cv2.imencode('.png', noisy((40, 60), 2))[1].tobytes()
    data = bytearray(sound)
    data[damage] = bytes(len(data[damage]))
    assert inflated(bytes(data)) is not None
    try:
        pixels = decode_png(replace(parse_image(sound, 'x'), png=bytes(data)))
    except ValueError:
        return
    assert pixels.shape == (40, 60)


def test_without_isal_opencv_does_it_all(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'isal', None)
    data = cv2.imencode('.png', noisy((40, 60), 2))[1].tobytes()
    assert inflated(data) is data


@pytest.mark.parametrize('size', [(1, 1), (64, 48)])
def test_data_that_inflate_to_more_than_the_image_are_refused(size):
    """A few bytes may hold all of the memory."""
    pytest.importorskip('isal')

    def chunk(body):
        return struct.pack('>I', len(body) - 4) + body + struct.pack('>I', zlib.crc32(body))

    header = b'IHDR' + struct.pack('>IIBBBBB', *size, 8, 2, 0, 0, 0)
    data = b'IDAT' + zlib.compress(bytes(10_000_000), 9)
    png = b'\x89PNG\r\n\x1a\n' + chunk(header) + chunk(data) + chunk(b'IEND')
    with pytest.raises(ValueError, match='more image data than its header states'):
        inflated(png)


@pytest.mark.parametrize('place', range(3))
@pytest.mark.parametrize('length', [2**32 - 1, 2**31 - 1, 10**9, 10_000])
def test_a_chunk_beyond_the_end_is_refused_before_it_is_allocated(place, length):
    sound = cv2.imencode('.png', noisy((20, 30), 2))[1].tobytes()
    data = bytearray(sound)
    starts, offset = [], 8
    while offset < len(data):
        starts.append(offset)
        offset += 12 + int.from_bytes(data[offset : offset + 4], 'big')
    start = starts[place]
    data[start : start + 4] = length.to_bytes(4, 'big')
    with pytest.raises(ValueError, match=f'a chunk of {length} bytes at byte {start}, beyond'):
        decode_png(replace(parse_image(sound, 'x'), png=bytes(data)))


@pytest.mark.parametrize(
    'size', [(2**31 - 1, 2**31 - 1), (2**31 - 1, 1), (1, 2**31 - 1), (30000, 30000)]
)
@pytest.mark.parametrize('has_isal', [True, False])
def test_a_header_of_more_pixels_than_the_data_can_have_is_refused(size, has_isal, monkeypatch):
    """OpenCV allocates the pixels of the header before it looks at the data."""
    if not has_isal:
        monkeypatch.setitem(sys.modules, 'isal', None)
    data = cv2.imencode('.png', noisy((16, 32), 1))[1].tobytes()
    head = data[12:16] + struct.pack('>II', *size) + data[24:29]
    made = data[:12] + head + struct.pack('>I', zlib.crc32(head)) + data[33:]
    with pytest.raises(ValueError, match='bytes of image data, which is too little'):
        decode_png(parse_image(made, 'x'))


@pytest.mark.parametrize('channels', [1, 3])
def test_the_most_compressible_image_is_decoded(channels):
    shape = (2000, 3000, 3) if channels == 3 else (2000, 3000)
    data = cv2.imencode('.png', np.zeros(shape, np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    assert not decode_png(parse_image(data.tobytes(), 'x')).any()
