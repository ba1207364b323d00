# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import hashlib
import struct
import sys
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.files.image_files import (
    decode_png,
    encode_depth_map,
    encode_png,
    is_in_kitti_form,
    parse_png,
)
from kitti_ros2.model.streams import PngForm


def decoded(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)


def pixels_of(kind: str, shape: tuple[int, ...], dtype: type, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    top = np.iinfo(dtype).max
    if kind == 'noise':
        return rng.integers(0, top, shape, dtype, endpoint=True)
    if kind == 'flat':
        return np.full(shape, rng.integers(0, top, endpoint=True), dtype)
    if kind == 'few values':
        return rng.choice([0, 1, top], shape).astype(dtype)
    ramp = np.arange(np.prod(shape)).reshape(shape) // shape[-1]
    return (ramp + rng.integers(0, 5, shape)).astype(dtype)


@pytest.fixture(params=['isal', 'zlib'])
def encoder(request, monkeypatch):
    """Each way of making the file, whatever the machine would choose."""
    if request.param == 'isal':
        pytest.importorskip('isal')
    if request.param == 'zlib':
        monkeypatch.setitem(sys.modules, 'isal', None)
    return request.param


class TestEveryEncoder:
    @pytest.fixture(autouse=True)
    def _encoder(self, encoder):
        pass

    @given(
        st.sampled_from(['noise', 'flat', 'few values', 'smooth']),
        st.integers(1, 60),
        st.one_of(st.integers(1, 8), st.integers(1, 400)),
        st.sampled_from([((), np.uint8), ((), np.uint16), ((3,), np.uint8)]),
        st.integers(0, 1000),
    )
    @settings(max_examples=150, deadline=None)
    def test_pixels_come_back(self, kind, height, width, form, seed):
        channels, dtype = form
        pixels = pixels_of(kind, (height, width, *channels), dtype, seed)
        back = decoded(encode_png(pixels))
        assert back.dtype == dtype
        np.testing.assert_array_equal(back, pixels)

    @pytest.mark.parametrize('shape', [(375, 1242, 3), (1080, 1920), (1, 5000, 3), (5000, 1)])
    @pytest.mark.parametrize('kind', ['noise', 'smooth', 'flat'])
    def test_large_ones_too(self, shape, kind):
        pixels = pixels_of(kind, shape, np.uint8, 1)
        np.testing.assert_array_equal(decoded(encode_png(pixels)), pixels)

    def test_every_checksum_is_right(self):
        """OpenCV does not look at all of them."""
        png = encode_png(pixels_of('smooth', (40, 50, 3), np.uint8, 1))
        offset, kinds, data = 8, [], b''
        while offset < len(png):
            length, kind = struct.unpack_from('>I4s', png, offset)
            body = png[offset + 8 : offset + 8 + length]
            (crc,) = struct.unpack_from('>I', png, offset + 8 + length)
            assert crc == zlib.crc32(kind + body)
            kinds.append(kind)
            data += body if kind == b'IDAT' else b''
            offset += 12 + length
        assert set(kinds) - {b'fdEC'} == {b'IHDR', b'IDAT', b'IEND'}
        assert len(zlib.decompress(data)) == 40 * (1 + 150)


def test_the_package_reads_the_header():
    image = parse_png(encode_png(np.zeros((5, 7, 3), np.uint8)), 'x')
    assert (image.width, image.height, image.channels) == (7, 5, 3)


def test_views_are_written_as_they_look():
    pixels = pixels_of('noise', (40, 60, 3), np.uint8, 1)
    pixels.setflags(write=False)
    for view in (pixels[::2, 5:50], pixels[..., 1], pixels[::-1], pixels[..., ::-1]):
        np.testing.assert_array_equal(decoded(encode_png(view)), view)
    wide = pixels_of('noise', (20, 30), np.uint16, 1)
    for view in (wide[::3, 1::2], wide.astype('>u2'), wide.T):
        np.testing.assert_array_equal(decoded(encode_png(view)), view)


def test_a_photograph_gets_hardly_larger_than_from_opencv(encoder):  # noqa: ARG001 - each
    rng = np.random.default_rng(0)
    smooth = cv2.GaussianBlur(rng.integers(0, 255, (375, 1242, 3), np.uint8), (0, 0), 3)
    noise = rng.integers(0, 6, smooth.shape, np.uint8)
    pixels = cv2.add(cv2.normalize(smooth, None, 0, 240, cv2.NORM_MINMAX), noise)
    done, data = cv2.imencode('.png', pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    assert done
    assert len(encode_png(pixels)) < 1.1 * len(data)


@pytest.mark.parametrize(
    ('shape', 'dtype'),
    [
        ((5,), np.uint8),
        ((), np.uint8),
        ((0, 5), np.uint8),
        ((5, 0, 3), np.uint8),
        ((5, 5, 4), np.uint8),
        ((5, 5, 1), np.uint8),
        ((5, 5, 3), np.int16),
        ((5, 5), np.int8),
        ((5, 5), np.float32),
    ],
)
def test_other_pixels_are_refused(shape, dtype):
    with pytest.raises(ValueError, match='pixels of shape'):
        encode_png(np.zeros(shape, dtype))


def test_colour_of_16_bits_comes_back():
    pixels = np.random.default_rng(0).integers(0, 2**16, (7, 9, 3), np.uint16)
    back = cv2.imdecode(np.frombuffer(encode_png(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(back, pixels)


def test_every_thread_writes_the_same_bytes(encoder):
    """Pixels in which a wrong entry of isal's hash table, wherever it is, changes a match.

    Each row is a run, whose inner bytes are not entered, and then two values in turn, which match
    what was not entered if an entry of something else happens to lie at their distance.
    """
    del encoder
    threads = 48
    values = np.random.default_rng(0).integers(0, 256, (20_000, 2), np.uint8)
    residuals = np.repeat(values[:, :1], 27, axis=1)
    residuals[:, 20::2] = values[:, 1:]
    pixels = np.cumsum(residuals, axis=1, dtype=np.uint8)
    together = threading.Barrier(threads)
    found = set()

    def run():
        together.wait()  # all threads live at once: no stack lies where another was
        found.add(encode_png(pixels))
        together.wait()

    running = [threading.Thread(target=run) for _ in range(threads)]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    assert len(found) == 1
    np.testing.assert_array_equal(decoded(found.pop()), pixels)


# --- the forms of KITTI's files -----------------------------------------------------------------

SHARED = Path(__file__).parents[3] / 'shared'
FORMS = {
    (PngForm.KITTI, 3): 'bf9c72fa91178d05314d890215a5e6e13bc72719643ddd99b9e7f2ca8b04fba2',
    (PngForm.KITTI, 1): 'e6e3a3b8e2d8165fbd1a7b478765e419068e6e169f5cb890a3a25413915e2596',
    (PngForm.KITTI_360, 3): 'f9113f2c69f505a72b49e57f289b31282f0fa50ccd5c1689a5d0e896c44c6139',
    (PngForm.KITTI_360, 1): '9e34e15702f31fa213f1d49ac4b0c35f47adb16691fc89a7216044bf04369787',
}
"""SHA-256 of the files of a generated picture: no version of zlib or NumPy may change a bit."""


def generated(channels):
    """A picture with flat parts, ramps and noise, made of integers alone."""
    row, column = np.indices((60, 200))
    grey = (row * 3 + column) % 256
    grey[:, 100:] = (grey[:, 100:] * 1103515245 + row[:, 100:] ** 3 * 12345 >> 7) % 256
    grey[20:40, 20:60] = 17
    grey = grey.astype(np.uint8)
    return grey if channels == 1 else np.stack([grey, grey[::-1], 255 - grey], axis=-1)


@pytest.mark.parametrize(('form', 'channels'), FORMS)
def test_the_bytes_of_a_form_never_change(form, channels):
    pixels = generated(channels)
    png = encode_png(pixels, form)
    assert hashlib.sha256(png).hexdigest() == FORMS[form, channels]
    np.testing.assert_array_equal(decoded(png), pixels)
    is_large = channels == 3  # a small file has one chunk
    assert is_in_kitti_form(png) == (is_large and form is PngForm.KITTI)
    assert not is_in_kitti_form(encode_png(pixels))


def test_the_bytes_of_a_depth_map_never_change():
    pixels = generated(1).astype(np.uint16) * 200
    png = encode_depth_map(pixels)
    assert (
        hashlib.sha256(png).hexdigest()
        == 'af7af7830c3b088682a1ee408b00f9ad4f26ad4a5fc4eef572b66677178ae574'
    )
    np.testing.assert_array_equal(decoded(png), pixels)


@pytest.mark.parametrize('shape', [(375, 1242, 3), (7, 9), (200, 300)])
def test_zlib_ng_writes_the_same_bits(shape):
    """So the bytes of a file do not depend on which of the two is installed."""
    zlib_ng = pytest.importorskip('zlib_ng.zlib_ng')
    data = pixels_of('smooth', shape, np.uint8, 1).tobytes()
    streams = []
    for library in (zlib, zlib_ng):
        packer = library.compressobj(1, zlib.DEFLATED, 15, 8, zlib.Z_HUFFMAN_ONLY)
        streams.append(packer.compress(data) + packer.flush())
    assert streams[0] == streams[1]


@given(
    st.sampled_from(['noise', 'flat', 'few values', 'smooth']),
    st.integers(1, 60),
    st.integers(1, 400),
    st.sampled_from([((), np.uint8), ((), np.uint16), ((3,), np.uint8), ((3,), np.uint16)]),
    st.sampled_from(PngForm),
)
@settings(max_examples=100, deadline=None)
def test_pixels_come_back_of_every_form(kind, height, width, shape, form):
    channels, dtype = shape
    pixels = pixels_of(kind, (height, width, *channels), dtype, 1)
    np.testing.assert_array_equal(decoded(encode_png(pixels, form)), pixels)


@pytest.mark.skipif(not SHARED.is_dir(), reason='no real KITTI files')
def test_kittis_files_are_made_again_of_their_pixels():
    paths = sorted(SHARED.glob('kitti*/**/*.png'))
    assert len(paths) > 20
    for path in paths:
        png = path.read_bytes()
        pixels = decode_png(parse_png(png, path))
        form = PngForm.KITTI_360 if 'kitti360' in path.parts else PngForm.KITTI
        assert (
            encode_depth_map(pixels) if pixels.dtype == np.uint16 else encode_png(pixels, form)
        ) == png, path
