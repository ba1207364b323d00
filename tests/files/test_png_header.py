# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.cli import main
from kitti_ros2.files.image_files import parse_png
from kitti_ros2.model.errors import BadFileError


def png(*shape: int, dtype: type = np.uint8) -> bytes:
    done, data = cv2.imencode('.png', np.zeros(shape, dtype))
    assert done
    return data.tobytes()


@pytest.mark.parametrize(('shape', 'channels'), [((5, 7), 1), ((5, 7, 3), 3), ((5, 7, 4), 3)])
def test_size_and_channels_without_decoding(shape, channels):
    data = png(*shape)
    image = parse_png(data, 'x.png')
    assert (image.width, image.height, image.channels) == (7, 5, channels)
    assert image.data is data


def test_grey_may_have_16_bits():
    image = parse_png(png(5, 7, dtype=np.uint16), 'x.png')
    assert (image.width, image.height, image.channels) == (7, 5, 1)


def test_a_byte_behind_the_end_is_no_cut():
    assert parse_png(png(5, 7) + b'\n', 'x.png').width == 7


def test_colour_of_16_bits_is_an_image():
    image = parse_png(png(5, 7, 3, dtype=np.uint16), 'x.png')
    assert (image.width, image.height, image.channels) == (7, 5, 3)


@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (b'', 'empty'),
        (b'JFIF' * 20, 'no PNG'),
        (png(5, 7)[:20], 'no PNG'),
        (png(5, 7)[:-5], 'cut after'),
        (png(5, 7)[:40], 'cut after'),
    ],
)
def test_bad_images(data, said):
    with pytest.raises(BadFileError, match=said):
        parse_png(data, 'x.png')


def noise() -> bytes:
    """A PNG with more than one byte in every place that matters, and trailing bytes."""
    pixels = np.random.default_rng(0).integers(0, 255, (23, 31, 3), np.uint8)
    return cv2.imencode('.png', pixels)[1].tobytes() + b'\n\n'


def chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """The type and content of each chunk; independent of what is tested."""
    found, offset = [], 8
    while offset + 12 <= len(data):
        (length,) = struct.unpack_from('>I', data, offset)
        found.append((data[offset + 4 : offset + 8], data[offset + 8 : offset + 8 + length]))
        offset += 12 + length
    return found


def file_of(parts: list[tuple[bytes, bytes]]) -> bytes:
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
        for kind, body in parts
    )


@given(st.data())
def test_one_wrong_byte_anywhere_in_the_file_is_found(data):
    good = noise()
    parse_png(good, 'x.png')
    place = data.draw(st.integers(0, len(good) - 3))
    wrong = data.draw(st.integers(1, 255))
    bad = bytearray(good)
    bad[place] ^= wrong
    with pytest.raises(BadFileError, match=r'^x\.png: '):
        parse_png(bytes(bad), 'x.png')


@given(st.data())
def test_bytes_that_are_missing_or_too_many_are_found(data):
    good = noise()
    first = data.draw(st.integers(8, len(good) - 20))
    count = data.draw(st.integers(1, 9))
    for bad in (good[:first] + good[first + count :], good[:first] + b'\1' * count + good[first:]):
        with pytest.raises(BadFileError):
            parse_png(bad, 'x.png')


def test_the_chunk_is_named_and_where_it_is():
    [header, body, end] = chunks(noise())
    split = [header, *((b'IDAT', body[1][k : k + 500]) for k in range(0, len(body[1]), 500)), end]
    good = file_of(split)
    assert parse_png(good, 'x').width == 31
    place = 33 + 512 + 8 + 17
    bad = good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :]
    with pytest.raises(BadFileError, match='its IDAT at byte 545 has a wrong checksum'):
        parse_png(bad, 'x')
    with pytest.raises(BadFileError, match='IHDR at byte 8 has a wrong length, 2147483661'):
        parse_png(good[:8] + b'\x80' + good[9:], 'x')
    with pytest.raises(BadFileError, match='no image data'):
        parse_png(file_of([header, end]), 'x')


def test_a_png_that_is_damaged_inside_is_named_by_to_bag(drive, tmp_path, capsys):
    path = drive / 'image_02' / 'data' / '0000000003.png'
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    assert main(['to-bag', str(drive), str(tmp_path / 'o.mcap'), '-q']) == 1
    said = capsys.readouterr().err
    assert f'{path}: the PNG is damaged: its IDAT at byte' in said


def test_a_png_that_is_damaged_in_our_own_bag_is_named(drive, tmp_path, capsys):
    out, bag = tmp_path / 'out', tmp_path / 'o.bag'
    assert main(['to-bag', str(drive), str(bag), '-q']) == 0
    png = (drive / 'image_02' / 'data' / '0000000003.png').read_bytes()
    data = bag.read_bytes()
    assert data.count(png) == 1
    place = data.index(png) + len(png) // 2
    bag.write_bytes(data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :])
    assert main(['to-kitti', str(bag), str(out), '-q']) == 1
    said = capsys.readouterr().err
    assert '0000000003.png: the PNG is damaged' in said
    assert not list(out.rglob('image_02/data/0000000003.png'))
    assert (
        len(list(out.rglob('image_02/data/*.png')))
        == len(list(drive.rglob('image_02/data/*.png'))) - 1
    )
