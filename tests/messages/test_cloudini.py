# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cloudini's compressed clouds have the values of their points, or those rounded to a step."""

from __future__ import annotations

import numpy as np
import pytest
from cloudini_encoder import CHUNK, COMPRESS, NAMES, TYPES, Encoder

from kitti_ros2.messages.cloudini import decode_points, read_header

RNG = np.random.default_rng(4)
COUNT = 150
STEPS = {'x': 0.01, 'y': 0.01, 'z': 0.001, 'intensity': 1 / 256, 'precise': 0.25}


def made(*fields: tuple[str, str], count: int = COUNT, missing: bool = False) -> np.ndarray:
    """Points with fields in turn, and three bytes of padding behind each."""
    kinds = [np.dtype(kind) for _, kind in fields]
    offsets = np.cumsum([0, *(kind.itemsize for kind in kinds)])
    layout = {'names': [name for name, _ in fields], 'formats': kinds, 'offsets': offsets[:-1]}
    points = np.zeros(count, np.dtype({**layout, 'itemsize': int(offsets[-1]) + 3}))
    for name, kind in zip(points.dtype.names, kinds, strict=True):
        points[name] = values_of(name, kind, count)
        if missing and name in STEPS:
            points[name][RNG.random(count) < 0.2] = np.nan
    return points


def values_of(name: str, kind: np.dtype, count: int) -> np.ndarray:
    rows = np.arange(count)
    if name == 'stamp':
        return np.where(rows % 7 == 3, -1.5, 1.6e9 + 1e-6 * (rows - rows % 2) ** 2)
    if kind.kind == 'f':
        return RNG.normal(0, 30, count)
    if name == 'ring':
        return rows // 10 % 64
    if name == 'column':
        return 3 * rows
    limits = np.iinfo(kind)
    return RNG.integers(limits.min, limits.max, count, kind, endpoint=True)


XYZ = (('x', '<f4'), ('y', '<f4'), ('z', '<f4'))
XYZI = (*XYZ, ('intensity', '<f4'))
LAYOUTS = {
    'xyz': XYZ,
    'xyzi': XYZI,
    'xy': XYZ[:2],
    'five floats': (*XYZI, ('precise', '<f4')),
    'Velodyne': (*XYZI, ('ring', '<u2'), ('time', '<f4')),
    'Ouster': (*XYZI, ('column', '<u4'), ('any', '<u2'), ('byte', '|u1'), ('range', '<u4')),
    'Hesai': (*XYZI, ('stamp', '<f8'), ('ring', '<u2')),
    'doubles': (('x', '<f8'), ('stamp', '<f8'), ('other', '<f8'), ('precise', '<f8')),
    'integers': tuple((f'any{index}', kind) for index, kind in enumerate(('<i2', '<i4', '<i8'))),
    'unsigned': (('any', '<u8'), ('ring', '<u2'), ('column', '<u4'), ('byte', '|i1')),
    'bytes': (('byte', '|u1'),),
}


def expected(points: np.ndarray, encoder: Encoder) -> np.ndarray:
    if encoder.encoding != 'LOSSY':
        return points
    result = points.copy()
    for name in set(encoder.steps).intersection(points.dtype.names):
        kind = points.dtype[name].type
        step = np.float32(encoder.steps[name])
        multiples = np.rint(points[name].astype(np.float64) / float(step))
        result[name] = multiples.astype(kind) * kind(step)
    return result


def decoded(data: bytes, points: np.ndarray) -> np.ndarray:
    return decode_points(data, read_header(data)).view(points.dtype)


def assert_same(actual: np.ndarray, points: np.ndarray) -> None:
    for name in points.dtype.names:
        np.testing.assert_array_equal(actual[name], points[name], err_msg=name)


@pytest.mark.parametrize('encoding', ['NONE', 'LOSSY', 'LOSSLESS'])
@pytest.mark.parametrize('version', [3, 4, 5])
@pytest.mark.parametrize('fields', LAYOUTS.values(), ids=LAYOUTS)
def test_points_are_those_encoded(fields, version, encoding):
    for missing in (False, True):
        points = made(*fields, missing=missing)
        encoder = Encoder(version, encoding, 'NONE', steps=STEPS)
        assert_same(decoded(encoder.encode(points), points), expected(points, encoder))


@pytest.mark.parametrize('mode', range(4))
@pytest.mark.parametrize('count', [1, 2, COUNT])
def test_each_mode_of_integers_in_version_5(mode, count):
    for fields in LAYOUTS.values():
        points = made(*fields, count=count)
        encoder = Encoder(mode=mode, steps=STEPS)
        assert_same(decoded(encoder.encode(points), points), expected(points, encoder))


@pytest.mark.parametrize('compression', ['NONE', 'LZ4', 'ZSTD'])
@pytest.mark.parametrize('binary', [False, True])
def test_compressions_headers_and_several_chunks(compression, binary):
    points = np.tile(made(*XYZI, ('ring', '<u2'), missing=True), CHUNK // COUNT + 2)
    encoder = Encoder(5, 'LOSSY', compression, 2, binary, STEPS)
    data = encoder.encode(points, height=2)
    header = read_header(data)
    assert (header.width, header.height, header.version) == (len(points) // 2, 2, 5)
    assert header.lossy_fields == {
        name: float(np.float32(STEPS[name])) for name in ('x', 'y', 'z', 'intensity')
    }
    assert_same(decoded(data, points), expected(points, encoder))


def damages(data: bytes, begin: int) -> dict[str, tuple[bytes, str]]:
    """Damaged data by name, with a part of the reason."""
    text = data[:begin]
    return {
        'no magic': (b'PCLOUD' + data, 'begin with'),
        'version': (data.replace(b'V05', b'V06', 1), 'version'),
        'header cut off': (data[: begin - 20], 'header is damaged'),
        'unknown type': (data.replace(b'FLOAT32', b'FLOAT16', 1), 'header is damaged'),
        'beyond point_step': (data.replace(b'offset: 8', b'offset: 9999', 1), 'beyond point_step'),
        'negative width': (data.replace(b'width: ', b'width: -', 1), 'header is damaged'),
        'negative offset': (data.replace(b'offset: ', b'offset: -1', 1), 'header is damaged'),
        'more points': (data.replace(b'width: 150', b'width: 151', 1), 'ends before'),
        'a chunk more': (data + data[begin:], 'more chunks'),
        'many more points': (data.replace(b'width: 150', b'width: 80000', 1), 'ends before'),
        'fewer points': (data.replace(b'width: 150', b'width: 149', 1), 'more than its points'),
        'cut off': (data[:-1], 'cut off'),
        'no chunk': (text, 'end after 0'),
        'length cut off': (text + b'\1', 'cut off'),
    }


CLEAN = made(*XYZI, ('stamp', '<f8'))
PLAIN = Encoder(compression='NONE', steps=STEPS).encode(CLEAN)


@pytest.mark.parametrize('kind', damages(PLAIN, read_header(PLAIN).begin))
def test_damaged_data_are_refused(kind):
    data, reason = damages(PLAIN, read_header(PLAIN).begin)[kind]
    with pytest.raises(ValueError, match=reason):
        decode_points(data, read_header(data))


@pytest.mark.parametrize('encoding', ['LOSSY', 'LOSSLESS'])
@pytest.mark.parametrize('mode', range(4))
def test_any_damaged_byte_costs_a_message_at_most(mode, encoding):
    """Bytes are changed one at a time; the decoder refuses, or gives other values."""
    fields = (*XYZ, ('byte', '|u1'), ('stamp', '<f8'), ('other', '<f8'), ('ring', '<u2'))
    data = Encoder(5, encoding, 'NONE', mode, steps=STEPS).encode(made(*fields, count=12))
    refused = 0
    for index in range(read_header(data).begin, len(data)):
        for value in (0, 0x7F, 0x80, 0xFF):
            damaged = data[:index] + bytes([value]) + data[index + 1 :]
            try:
                decode_points(damaged, read_header(damaged))
            except ValueError:
                refused += 1
    assert refused


@pytest.mark.parametrize('compression', ['ZSTD', 'LZ4'])
def test_a_chunk_of_more_bytes_than_points_can_have_is_refused(compression):
    plain = Encoder(compression=compression, steps=STEPS).encode(CLEAN)
    packed = COMPRESS[compression](bytes(2**26))
    data = plain[: read_header(plain).begin] + len(packed).to_bytes(4, 'little') + packed
    with pytest.raises(ValueError, match='a chunk'):
        decode_points(data, read_header(data))


@pytest.mark.parametrize('version', [3, 4, 5])
@pytest.mark.parametrize('encoding', range(3))
@pytest.mark.parametrize('fields', LAYOUTS.values(), ids=LAYOUTS)
def test_another_implementation_decodes_to_the_same(fields, encoding, version):
    peer = pytest.importorskip('pureini')
    points = made(*fields, count=5000, missing=True)
    own = [
        peer.PointField(
            name, offset, peer.FieldType[NAMES[TYPES.index(kind.str[1:])]], STEPS.get(name)
        )
        for name, (kind, offset) in points.dtype.fields.items()
    ]
    info = peer.EncodingInfo(
        own,
        len(points),
        1,
        points.dtype.itemsize,
        peer.EncodingOptions(encoding),
        peer.CompressionOption.LZ4,
        version,
    )
    data = peer.PointcloudEncoder(info).encode(points.tobytes())
    plain, _ = peer.PointcloudDecoder().decode(data)
    assert_same(decoded(data, points), np.frombuffer(plain, points.dtype))
