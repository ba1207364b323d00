# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that are written as Cloudini does it are those that its readers read."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from cloudini_encoder import CHUNK, Encoder

from kitti_ros2.messages.cloudini import decode_points, read_header
from kitti_ros2.messages.cloudini_writer import write_bytes, write_multiples

NAMES = ('x', 'y', 'z', 'intensity')
STEPS = ('0.001', '0.001', '0.001', '0.01')
MISSING = -(2**31)
ENCODER = Encoder(4, 'LOSSY', steps={n: float(s) for n, s in zip(NAMES, STEPS, strict=True)})
EDGES = (0, 1, 63, 64, 65, 8191, 8192, 8193, 2**20, 2**20 + 1, 2**21 - 1)
RNG = np.random.default_rng(3)
SIZES = [0, 1, 2, CHUNK - 1, CHUNK, CHUNK + 1]


def multiples(count, missing=0.0):
    values = np.cumsum(RNG.normal(0, 40, (count, 4)), axis=0).astype(np.int32) % 2**20
    far = RNG.random(values.shape) < 0.1
    values[far] = RNG.choice([*EDGES, *(-edge for edge in EDGES)], far.sum())
    values[RNG.random(values.shape) < missing] = MISSING
    return values


def points_of(values):
    points = values.astype(np.float32) * np.array(STEPS, np.float32)
    points[values == MISSING] = np.nan
    return points


def blocks(data):
    """The header, and the chunks without compression."""
    begin = read_header(data).begin
    plain = [data[:begin]]
    while begin < len(data):
        end = begin + 4 + int.from_bytes(data[begin : begin + 4], 'little')
        plain.append(zstandard.ZstdDecompressor().decompress(data[begin + 4 : end]))
        begin = end
    return plain


@pytest.mark.parametrize('missing', [0.0, 0.05])
@pytest.mark.parametrize('count', SIZES)
def test_multiples_are_written_as_value_by_value(count, missing):
    values = multiples(count, missing)
    data = write_multiples(values, NAMES, STEPS, MISSING)
    expected = points_of(values)
    # The encoder of the tests divides by its step, which is exact to half a multiple.
    rows = expected.astype('<f4').view([(name, '<f4') for name in NAMES]).reshape(-1)
    if count < CHUNK - 1:
        assert blocks(data) == blocks(ENCODER.encode(rows))
    actual = decode_points(data, read_header(data)).view('<f4').reshape(-1, 4)
    np.testing.assert_array_equal(actual, expected)


def test_bytes_are_written_as_they_are():
    points = RNG.integers(0, 2**32, (CHUNK + 5, 4), np.uint32).view(np.float32)
    data = write_bytes(points, NAMES)
    assert decode_points(data, read_header(data)).tobytes() == points.tobytes()
    assert read_header(data).lossy_fields == {}


@pytest.mark.parametrize('missing', [0.0, 0.05])
def test_another_implementation_reads_them(missing):
    peer = pytest.importorskip('pureini')
    values = multiples(CHUNK + 50, missing)
    for data, expected in (
        (write_multiples(values, NAMES, STEPS, MISSING), points_of(values)),
        (write_bytes(points_of(values), NAMES), points_of(values)),
    ):
        plain, _ = peer.PointcloudDecoder().decode(data)
        actual = np.frombuffer(plain, '<f4').reshape(-1, 4)
        np.testing.assert_allclose(actual, expected, rtol=1e-6)
