# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import struct
import tracemalloc
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kitti_ros2.files.image_files import decode_png, inflated, parse_png


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
    np.testing.assert_array_equal(decode_png(parse_png(data, 'x')), pixels)


def chunk(kind: bytes, body: bytes = b'') -> bytes:
    return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))


def png(*chunks: bytes, size=(2, 2), depth=8, colour=0, methods=(0, 0, 0)) -> bytes:
    header = struct.pack('>IIBBBBB', *size, depth, colour, *methods)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + b''.join(chunks) + chunk(b'IEND')


def image_data(raw: bytes) -> bytes:
    return chunk(b'IDAT', zlib.compress(raw))


GREY = image_data(b'\0\1\2\0\3\4')


@pytest.fixture(params=['isal', 'zlib'])
def library(request, monkeypatch):
    """What inflates: isal where it is installed, or zlib."""
    if request.param == 'zlib':
        monkeypatch.setattr('kitti_ros2.files.image_files._LIBRARY', zlib)
    else:
        pytest.importorskip('isal')


@pytest.mark.usefixtures('library')
def test_the_data_is_stored_and_what_does_not_change_pixels_is_left_out():
    pixels = noisy((200, 400, 3), 1)
    data = cv2.imencode('.png', pixels)[1].tobytes()
    data = data[:33] + chunk(b'tEXt', b'key\0value') + data[33:]
    stored = inflated(data)
    assert len(stored) > 200 * 1200
    assert b'tEXt' not in stored
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(stored, np.uint8), -1), pixels)


@pytest.mark.usefixtures('library')
@pytest.mark.parametrize('damage', [slice(50, 60), slice(41, 43), slice(-20, -17)])
def test_damaged_data_are_refused(damage):
    data = bytearray(cv2.imencode('.png', noisy((40, 60), 2))[1])
    data[damage] = bytes(len(data[damage]))
    with pytest.raises(ValueError, match='a PNG whose image data are damaged'):
        inflated(bytes(data))


@pytest.mark.usefixtures('library')
@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (png(GREY, depth=5), 'colour type 0 with 5 bits'),
        (png(GREY, colour=1), 'colour type 1 with 8 bits'),
        (png(GREY, methods=(1, 0, 0)), r'methods \[1, 0, 0\]'),
        (png(GREY, methods=(0, 0, 2)), r'methods \[0, 0, 2\]'),
        (png(GREY, size=(0, 2)), 'a PNG of 0 x 2 pixels'),
        (png(image_data(bytes(2 * 10**6)), size=(10**6 + 1, 1)), 'a PNG of 1000001 x 1 pixels'),
        (png(GREY, colour=3), 'without the palette'),
        (png(GREY, chunk(b'PLTE', bytes(768)), colour=3), 'without the palette'),
        (png(chunk(b'PLTE', bytes(5)), GREY, colour=3), 'without the palette'),
        (png(chunk(b'ABCD'), GREY), "a chunk b'ABCD' that no decoder knows"),
        (png(image_data(b'\0\1\2\5\3\4')), 'a row whose filter does not exist'),
        (png(image_data(b'\0\1\2\0\3')), '5 of the 6 bytes of its image'),
        (png(), '0 bytes of image data, which is too little'),
        (b'\x89PNG\r\n\x1a\n' + chunk(b'IEND'), 'whose header is cut off'),
    ],
)
def test_what_libpng_would_complain_about_is_refused(data, said, capfd):
    with pytest.raises(ValueError, match=said):
        inflated(data)
    assert capfd.readouterr().err == ''


@pytest.mark.usefixtures('library')
@pytest.mark.parametrize(
    ('data', 'pixels'),
    [
        (png(GREY), [[1, 2], [3, 4]]),
        (png(GREY)[:-12], [[1, 2], [3, 4]]),
        (png(image_data(b'\0\1\2\0\3\4' + bytes(100))), [[1, 2], [3, 4]]),
        (png(GREY, chunk(b'tIME', bytes(7)), GREY), [[1, 2], [3, 4]]),
        (png(chunk(b'iCCP', b'x'), chunk(b'zTXt', b'y'), GREY), [[1, 2], [3, 4]]),
        (png(chunk(b'PLTE', bytes(7)), GREY), [[1, 2], [3, 4]]),
        (png(chunk(b'PLTE', bytes(range(6))), GREY, colour=3), [[4, 0], [0, 0]]),
        (png(image_data(b'\0\x40\0\xc0'), depth=1), [[0, 255], [255, 255]]),
    ],
)
def test_what_only_seems_wrong_is_decoded_without_a_word(data, pixels, capfd):
    found = cv2.imdecode(np.frombuffer(inflated(data), np.uint8), cv2.IMREAD_COLOR)
    assert found[..., 1].tolist() == pixels
    assert capfd.readouterr().err == ''


def adam7(pixels: np.ndarray) -> bytes:
    """The image data of an interlaced image of 8 bits grey, by the figure of the standard."""
    figure = np.array([[1, 6, 4, 6, 2, 6, 4, 6], [7] * 8, [5, 6] * 4, [7] * 8,
                       [3, 6, 4, 6, 3, 6, 4, 6], [7] * 8, [5, 6] * 4, [7] * 8])  # fmt: skip
    numbers = np.tile(figure, (20, 20))[: pixels.shape[0], : pixels.shape[1]]
    rows = [
        b'\0' + line[places].tobytes()
        for number in range(1, 8)
        for line, places in zip(pixels, numbers == number, strict=True)
        if places.any()
    ]
    return image_data(b''.join(rows))


@pytest.mark.usefixtures('library')
@given(st.integers(1, 40), st.integers(1, 40))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_interlaced_images_are_decoded(height, width):
    pixels = noisy((height, width), height * width)
    data = png(adam7(pixels), size=(width, height), methods=(0, 0, 1))
    np.testing.assert_array_equal(decode_png(parse_png(data, 'x')), pixels)


@pytest.mark.usefixtures('library')
@pytest.mark.parametrize('size', [(1, 1), (64, 48)])
def test_data_that_inflate_to_more_than_the_image_are_refused(size):
    """A few bytes may hold all of the memory."""
    data = png(image_data(bytes(10_000_000)), size=size, colour=2)
    with pytest.raises(ValueError, match='more image data than its header states'):
        inflated(data)


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
        decode_png(replace(parse_png(sound, 'x'), data=bytes(data)))


@pytest.mark.parametrize(
    'size', [(2**31 - 1, 2**31 - 1), (2**31 - 1, 1), (1, 2**31 - 1), (30000, 30000)]
)
@pytest.mark.usefixtures('library')
def test_a_header_of_more_pixels_than_the_data_can_have_is_refused(size):
    """OpenCV allocates the pixels of the header before it looks at the data."""
    data = cv2.imencode('.png', noisy((16, 32), 1))[1].tobytes()
    head = data[12:16] + struct.pack('>II', *size) + data[24:29]
    made = data[:12] + head + struct.pack('>I', zlib.crc32(head)) + data[33:]
    with pytest.raises(ValueError, match='bytes of image data, which is too little'):
        inflated(made)
    with pytest.raises(ValueError, match='PNG of'):
        decode_png(parse_png(made, 'x'))


@pytest.mark.parametrize('channels', [1, 3])
def test_the_most_compressible_image_is_decoded(channels):
    shape = (2000, 3000, 3) if channels == 3 else (2000, 3000)
    data = cv2.imencode('.png', np.zeros(shape, np.uint8), [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    assert not decode_png(parse_png(data.tobytes(), 'x')).any()


def test_an_image_that_would_fill_the_memory_is_not_decoded():
    side = 2**13
    rows = zlib.compress(bytes((side + 1) * (side + 1)), 1)
    data = png(chunk(b'IDAT', rows), size=(side, side + 1))
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match='8192 x 8193 pixels is not decoded'):
            decode_png(parse_png(data, 'x'))
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 10**6
