# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.files.image_files import encode_png
from kitti_ros2.messages.cdr import make_header
from kitti_ros2.messages.images import decode_compressed_pixels, decode_pixels, png_of
from kitti_ros2.messages.ros_types import CompressedImage, ImageMsg

HEADER = make_header(0, 'camera')
PATTERNS = {'rggb': 'RGGB', 'bggr': 'BGGR', 'gbrg': 'GBRG', 'grbg': 'GRBG'}


def picture(height: int = 24, width: int = 32) -> np.ndarray:
    """(H, W, 3) uint8 BGR, smooth, its channels unlike each other."""
    v, u = np.mgrid[:height, :width]
    blue, green, red = 20 + 2 * u, 90 + 2 * v, 250 - u - v
    return np.dstack([blue, green, red]).astype(np.uint8)


def image(values: np.ndarray, encoding: str, padding: int = 0, bigendian: int = 0) -> ImageMsg:
    """A message whose rows hold the values and some bytes of padding."""
    height, width = values.shape[:2]
    order = '>' if bigendian else '<'
    stored = values.astype(values.dtype.newbyteorder(order))
    rows = np.frombuffer(stored.tobytes(), np.uint8).reshape(height, -1)
    padded = np.full((height, rows.shape[1] + padding), 0xAB, np.uint8)
    padded[:, : rows.shape[1]] = rows
    return ImageMsg(HEADER, height, width, encoding, bigendian, padded.shape[1], padded.reshape(-1))


def compressed(data: bytes, format_: str = '') -> CompressedImage:
    return CompressedImage(HEADER, format_, np.frombuffer(data, np.uint8))


def encoded(kind: str, pixels: np.ndarray) -> bytes:
    done, data = cv2.imencode(kind, pixels)
    assert done
    return data.tobytes()


def mosaic(pixels: np.ndarray, pattern: str) -> np.ndarray:
    """What a sensor under a filter of this pattern sees."""
    seen = np.empty(pixels.shape[:2], pixels.dtype)
    for place, colour in enumerate(pattern):
        row, column = divmod(place, 2)
        seen[row::2, column::2] = pixels[row::2, column::2, 'BGR'.index(colour)]
    return seen


class TestImage:
    @given(
        st.sampled_from(['mono8', '8UC1', 'bgr8', '8UC3', 'rgb8', 'bgra8', 'rgba8']),
        st.integers(1, 9),
        st.integers(1, 9),
        st.integers(0, 5),
    )
    @settings(deadline=None)
    def test_8_bit_values_are_kept(self, encoding, height, width, padding):
        bgr = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
        alpha = np.full((height, width, 1), 7, np.uint8)
        stored = {
            'm': bgr[..., 0],
            '8UC1': bgr[..., 0],
            'rgb8': bgr[..., ::-1],
            'bgra8': np.concatenate([bgr, alpha], axis=2),
            'rgba8': np.concatenate([bgr[..., ::-1], alpha], axis=2),
        }
        values = stored.get(encoding, stored['m'] if encoding == 'mono8' else bgr)
        pixels = decode_pixels(image(values, encoding, padding))
        assert pixels.dtype == np.uint8
        np.testing.assert_array_equal(pixels, values if values.ndim == 2 else bgr)

    @given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 5), st.booleans(), st.booleans())
    @settings(deadline=None)
    def test_16_bit_grey_is_kept_in_either_byte_order(
        self, height, width, padding, bigendian, plain
    ):
        grey = np.random.default_rng(0).integers(0, 65536, (height, width), np.uint16)
        encoding = 'mono16' if plain else '16UC1'
        pixels = decode_pixels(image(grey, encoding, padding, int(bigendian)))
        assert pixels.dtype == np.uint16
        assert pixels.dtype.isnative
        assert pixels.flags.aligned
        np.testing.assert_array_equal(pixels, grey)

    @pytest.mark.parametrize('bigendian', [0, 1])
    @pytest.mark.parametrize(
        ('encoding', 'order'),
        [('bgr16', [0, 1, 2]), ('rgb16', [2, 1, 0]), ('bgra16', [0, 1, 2, 0])],
    )
    def test_16_bit_colour_keeps_the_upper_8(self, encoding, order, bigendian):
        values = np.random.default_rng(0).integers(0, 65536, (4, 5, 3), np.uint16)
        pixels = decode_pixels(image(values[..., order], encoding, 3, bigendian))
        assert pixels.dtype == np.uint8
        np.testing.assert_array_equal(pixels, values >> 8)

    @pytest.mark.parametrize('pattern', PATTERNS)
    @pytest.mark.parametrize(('bits', 'bigendian'), [(8, 0), (16, 0), (16, 1)])
    @pytest.mark.parametrize('padding', [0, 4])
    def test_a_mosaic_becomes_colour(self, pattern, bits, bigendian, padding):
        bgr = picture()
        values = mosaic(bgr, PATTERNS[pattern]).astype(f'u{bits // 8}') << (bits - 8)
        pixels = decode_pixels(image(values, f'bayer_{pattern}{bits}', padding, bigendian))
        assert pixels.dtype == np.uint8
        inner = np.s_[2:-2, 2:-2]
        np.testing.assert_allclose(pixels[inner], bgr[inner].astype(int), atol=1)

    @pytest.mark.parametrize(
        ('encoding', 'code'),
        [
            ('yuv422', cv2.COLOR_BGR2YUV_UYVY),
            ('uyvy', cv2.COLOR_BGR2YUV_UYVY),
            ('yuv422_yuy2', cv2.COLOR_BGR2YUV_YUY2),
            ('yuyv', cv2.COLOR_BGR2YUV_YUY2),
        ],
    )
    def test_yuv_becomes_colour(self, encoding, code):
        bgr = picture() // 2 + 50
        pixels = decode_pixels(image(cv2.cvtColor(bgr, code), encoding, 2))
        np.testing.assert_allclose(pixels, bgr.astype(int), atol=6)

    @pytest.mark.parametrize('encoding', ['mono8', 'bgr8', 'mono16'])
    def test_what_needs_no_change_is_a_view(self, encoding):
        values = picture() if encoding == 'bgr8' else picture()[..., 0]
        message = image(values.astype(np.uint16 if encoding == 'mono16' else np.uint8), encoding)
        pixels = decode_pixels(message)
        assert np.shares_memory(pixels, message.data)
        assert pixels.flags.c_contiguous

    def test_a_data_field_that_begins_at_an_odd_byte(self):
        grey = np.arange(20, dtype=np.uint16).reshape(4, 5)
        message = image(grey, 'mono16')
        message.data = np.frombuffer(b'\0' + message.data.tobytes(), np.uint8)[1:]
        pixels = decode_pixels(message)
        assert pixels.flags.aligned
        np.testing.assert_array_equal(pixels, grey)

    @pytest.mark.parametrize('encoding', ['', '32FC1', 'MONO8', 'nv21', 'jpeg'])
    def test_an_unknown_encoding_is_named_with_the_known_ones(self, encoding):
        message = image(picture(), 'bgr8')
        message.encoding = encoding
        with pytest.raises(ValueError, match=f"unknown encoding '{encoding}'.*bayer_rggb16"):
            decode_pixels(message)

    @pytest.mark.parametrize(
        ('change', 'said'),
        [
            ({'width': 0}, 'an image of 0 x 24 pixels'),
            ({'height': 0}, 'an image of 32 x 0 pixels'),
            ({'step': 95}, '32 pixels of 3 bytes does not fit in step, 95 bytes'),
            ({'step': 0}, 'does not fit in step, 0 bytes'),
            ({'height': 25}, '2304 bytes of data; 25 rows of 96 bytes are 2400'),
            ({'step': 97}, '2304 bytes of data; 24 rows of 97 bytes are 2328'),
            ({'height': 2**32 - 1, 'step': 2**32 - 1}, '2304 bytes of data'),
            ({'encoding': 'yuv422', 'width': 31}, 'an odd width, 31 pixels'),
            ({'encoding': 'bayer_rggb8', 'height': 2}, 'a mosaic of 32 x 2 pixels'),
        ],
    )
    def test_what_contradicts_itself_is_told_in_numbers(self, change, said):
        message = image(picture(), 'bgr8')
        for name, value in change.items():
            setattr(message, name, value)
        with pytest.raises(ValueError, match=said):
            decode_pixels(message)


def chunk(kind: bytes, body: bytes = b'') -> bytes:
    return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))


def png(depth: int, colour: int, row_bytes: int, more: bytes = b'', interlace: int = 0) -> bytes:
    """5 x 4 pixels, all of the bytes 200; those of an interlaced one are 8 bits deep."""
    rows = b''.join(b'\0' + b'\xc8' * row_bytes for _ in range(4))
    if interlace:
        rows = b''.join(b'\0' + b'\xc8' * width for width in (1, 1, 1, 3, 2, 2, 5, 5))
    header = struct.pack('>IIBBBBB', 5, 4, depth, colour, 0, 0, interlace)
    data = chunk(b'IDAT', zlib.compress(rows))
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + more + data + chunk(b'IEND')


PLAIN = {
    'grey': png(8, 0, 5),
    'rgb': png(8, 2, 15),
    'grey16': png(16, 0, 10),
    'rgb16': png(16, 2, 30),
}
OTHERS = {
    'alpha': png(8, 6, 20),
    'grey and alpha': png(8, 4, 10),
    'palette': png(8, 3, 5, chunk(b'PLTE', b'\xc8' * 768)),
    'bilevel': png(1, 0, 1),
    'interlaced': png(8, 0, 5, interlace=1),
    'transparent colour': png(8, 2, 15, chunk(b'tRNS', bytes(6))),
}
FORMATS = ['', 'png', 'jpeg', 'jpg', 'rgb8; jpeg compressed bgr8', 'mono16; png compressed ']


class TestCompressedImage:
    @pytest.mark.parametrize('format_', FORMATS)
    def test_the_data_tell_what_it_is(self, format_):
        bgr, grey16 = picture(), picture()[..., 0].astype(np.uint16) * 257
        for pixels in (bgr, bgr[..., 0], grey16):
            back = decode_compressed_pixels(compressed(encode_png(pixels), format_))
            assert back.dtype == pixels.dtype
            np.testing.assert_array_equal(back, pixels)
        for pixels in (bgr, bgr[..., 0]):
            back = decode_compressed_pixels(compressed(encoded('.jpg', pixels), format_))
            assert back.shape == pixels.shape
            np.testing.assert_allclose(back, pixels.astype(int), atol=6)

    @pytest.mark.parametrize('name', PLAIN)
    def test_a_plain_png_keeps_its_bytes(self, name):
        for behind in (b'', b'\n' * 52):
            assert png_of(compressed(PLAIN[name] + behind, 'jpeg')) == PLAIN[name] + behind

    @pytest.mark.parametrize('name', OTHERS)
    def test_any_other_png_is_decoded(self, name):
        message = compressed(OTHERS[name], 'png')
        assert png_of(message) is None
        pixels = decode_compressed_pixels(message)
        assert pixels.shape[:2] == (4, 5)
        assert pixels.shape[2:] in {(), (3,)}
        assert pixels.dtype == np.uint8
        assert set(pixels.ravel().tolist()) <= {200, 0, 255}

    @pytest.mark.parametrize(
        'data',
        [
            PLAIN['rgb'][:-1],
            PLAIN['rgb'][:40],
            PLAIN['rgb'][:8],
            PLAIN['rgb'][:8] + chunk(b'IEND'),
            PLAIN['rgb'] + b'\n' * 53,
            encoded('.jpg', picture()),
            b'',
        ],
    )
    def test_neither_a_cut_nor_a_foreign_file_is_passed_on(self, data):
        assert png_of(compressed(data, 'png')) is None

    @pytest.mark.parametrize(
        ('data', 'said'),
        [
            (PLAIN['rgb'][:-1], 'the PNG is cut after 71 bytes'),
            (encoded('.jpg', picture())[:-2], 'the JPEG is cut after'),
            (PLAIN['rgb'][:8] + chunk(b'IEND'), 'a PNG whose header is cut off'),
            (b'\xff\xd8\xff\xff\xd9', 'the JPEG cannot be decoded'),
            (b'', "neither PNG nor JPEG nor WebP: format 'png', data b''"),
            (b'\0\0\0\x01h264 and so on', 'neither PNG nor JPEG'),
        ],
    )
    def test_what_cannot_be_decoded_is_told(self, data, said):
        with pytest.raises(ValueError, match=said):
            decode_compressed_pixels(compressed(data, 'png'))

    @pytest.mark.parametrize('ending', ['.png', '.jpg'])
    def test_too_many_pixels_are_refused_before_they_are_made(self, ending):
        data = bytearray(encoded(ending, picture()))
        if ending == '.png':
            data[16:24] = struct.pack('>II', 60_000, 60_000)
            data[29:33] = struct.pack('>I', zlib.crc32(data[12:29]))
        else:
            place = data.index(b'\xff\xc0') + 5
            data[place : place + 4] = struct.pack('>HH', 60_000, 60_000)
        with pytest.raises(ValueError, match='of 60000 x 60000 pixels'):
            decode_compressed_pixels(compressed(bytes(data)))

    @pytest.mark.parametrize('place', [20, 45, -5])
    def test_a_png_with_a_wrong_checksum_is_not_passed_on(self, place):
        data = bytearray(PLAIN['rgb'])
        data[place] ^= 1
        for decode in (decode_compressed_pixels, png_of):
            with pytest.raises(ValueError, match=r'the PNG is damaged: its .* wrong checksum'):
                decode(compressed(bytes(data)))

    @pytest.mark.parametrize(
        ('data', 'format_'),
        [
            (bytes(12) + PLAIN['grey16'], ''),
            (bytes(12) + PLAIN['grey16'], '16UC1; compressedDepth png'),
            (bytes(40), '16UC1; compressedDepth rvl'),
        ],
    )
    def test_a_depth_image_is_refused(self, data, format_):
        for decode in (decode_compressed_pixels, png_of):
            with pytest.raises(ValueError, match='a depth image'):
                decode(compressed(data, format_))

    @pytest.mark.parametrize('bits', [8, 16])
    def test_a_mosaic_that_was_compressed_as_grey_becomes_colour(self, bits):
        bgr = picture()
        grey = mosaic(bgr, 'GBRG').astype(f'u{bits // 8}') << (bits - 8)
        message = compressed(encode_png(grey), f'bayer_gbrg{bits}; png compressed ')
        assert png_of(message) is None
        pixels = decode_compressed_pixels(message)
        inner = np.s_[2:-2, 2:-2]
        np.testing.assert_allclose(pixels[inner], bgr[inner].astype(int), atol=1)

    def test_a_mosaic_that_was_converted_before_stays_as_it_is(self):
        message = compressed(encode_png(picture()), 'bayer_gbrg8; png compressed bgr8')
        np.testing.assert_array_equal(decode_compressed_pixels(message), picture())

    def test_exif_does_not_turn_a_picture(self):
        exif = b'Exif\0\0' + b'MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0'
        jpeg = encoded('.jpg', picture())
        app1 = b'\xff\xe1' + struct.pack('>H', 2 + len(exif)) + exif
        turned = jpeg[:2] + app1 + jpeg[2:]
        assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape == (32, 24, 3)
        assert decode_compressed_pixels(compressed(turned)).shape == (24, 32, 3)

    @given(st.integers(0, 2**31), st.integers(1, 20))
    @settings(deadline=None, max_examples=60)
    def test_damage_ends_in_pixels_or_a_value_error(self, seed, count):
        rng = np.random.default_rng(seed)
        for file in (encode_png(picture()), encoded('.jpg', picture())):
            data = np.frombuffer(file, np.uint8).copy()
            data[rng.integers(0, len(data), count)] = rng.integers(0, 256, count)
            try:
                pixels = decode_compressed_pixels(compressed(data.tobytes(), 'jpeg'))
            except ValueError:
                continue
            assert pixels.dtype in {np.dtype(np.uint8), np.dtype(np.uint16)}
