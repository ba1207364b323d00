# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: Cloudini's clouds, the rests of compact scans, and the grid of their points."""

from __future__ import annotations

import json
import zlib
from base64 import b64decode, b64encode
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from cloudini_encoder import Encoder
from moved_scans import TWISTS, moved, street

from kitti_ros2.kitti.compact_scan import compact, restore
from kitti_ros2.kitti.scan_grid import snap
from kitti_ros2.messages.cloudini import decode_points, read_header
from kitti_ros2.messages.compact_clouds import decode_rest, encode_compact, encode_rest
from kitti_ros2.messages.ros_types import String

from .inputs import SEPARATOR, files, joined, parted
from .target import Target

if TYPE_CHECKING:
    from kitti_ros2.model.samples import CompactScan, Float32Array

_LARGEST_RATIO = 100
_POINT_BYTES = 16
_COUNT = 300
_ODD = np.array([0, -0.0, np.nan, np.inf, 1e-45, 3e38, 2097.151, 0.0005], np.float32)


def _cloudini(data: bytes) -> None:
    with suppress(ValueError):
        header = read_header(data)
        if header.count * header.point_step < _LARGEST_RATIO * len(data):
            decode_points(data, header).sum()


def _rest(data: bytes) -> None:
    """Read a rest of packed octets, so that mutations get past base64 and zlib."""
    head, values, steps = parted(data, 3)
    text = head
    with suppress(ValueError, TypeError, RecursionError):  # JSON of other kinds stays as it is
        texts = {
            name: b64encode(zlib.compress(octets)).decode()
            for name, octets in (('values', values), ('steps', steps))
            if octets
        }
        text = json.dumps(json.loads(head) | texts).encode()
    with suppress(ValueError):
        _, rest = decode_rest(String(text.decode('utf-8', 'replace')))
        for scan in _scans():
            with suppress(ValueError):
                restore(scan, rest)


def _points(data: bytes) -> None:
    """Round any points to the grid, and make them again."""
    whole = data[: len(data) - len(data) % _POINT_BYTES]
    points = np.frombuffer(whole, '<f4').reshape(-1, 4)
    scan = compact(points)
    if restore(points, scan.rest).tobytes() != whole:
        raise AssertionError('other points than those of the file')
    if len(points):
        snap(points)


@cache
def _scans() -> tuple[Float32Array, ...]:
    """A scan on the grid, one compensated for motion, and one with odd values."""
    grid = np.column_stack([street(0), np.zeros(len(street(0)))])[::400][:_COUNT].astype('<f4')
    whole = moved(street(1), TWISTS['left bend'])
    other = np.column_stack([whole, np.zeros(len(whole))]).astype('<f4')
    odd = grid.copy()
    odd.reshape(-1)[: len(_ODD)] = _ODD
    return grid, other, odd


def _compact_scans() -> list[CompactScan]:
    return [compact(scan) for scan in _scans()]


def _rests() -> list[bytes]:
    """JSON of rests, with the octets of their values and steps apart."""
    made = []
    for scan in _compact_scans():
        values = json.loads(encode_rest(scan.rest, Path('000000.bin')).data)
        octets = [
            zlib.decompress(b64decode(values.pop(name))) if name in values else b''
            for name in ('values', 'steps')
        ]
        made.append(joined([json.dumps(values).encode(), *octets]))
    return [*made, b'', b'[]', b'{}', b'{"file": 1, "crc32": 1e400, "values": ""}']


def _clouds() -> list[bytes]:
    """Clouds as to-bag writes them, and of other versions, without zstd."""
    own = [
        encode_compact(points, scan.multiples, 0, 'velo_link').compressed_data.tobytes()
        for points, scan in zip(_scans(), _compact_scans(), strict=True)
        if len(points) == _COUNT
    ]
    names = ('x', 'y', 'z', 'intensity', 'stamp', 'ring')
    points = np.zeros(
        20, [*((name, '<f4') for name in names[:4]), ('stamp', '<f8'), ('ring', '<u2')]
    )
    points['x'], points['y'] = np.arange(20) * 0.013, np.arange(20) * -1.7
    points['z'][3], points['stamp'], points['ring'] = np.nan, np.arange(20) * 1e-4, range(20)
    steps = dict.fromkeys(names[:4], 0.001)
    return [
        *own,
        *(
            Encoder(version, encoding, 'NONE', mode, binary, steps).encode(points)
            for version, mode, binary in ((3, 0, True), (4, 0, False), (5, 0, True), (5, 1, False))
            for encoding in ('LOSSY', 'LOSSLESS', 'NONE')
        ),
    ]


TARGETS = (
    Target('cloudini', _cloudini, _clouds,
           ('messages/cloudini.py', 'messages/cloudini_values.py'),
           (b'ZSTD', b'LZ4', b'NONE', b'width: 4294967295', b'\xff' * 5, b'null'), short=200),
    Target('scan_rest', _rest, _rests,
           ('messages/compact_clouds.py', 'kitti/compact_scan.py'),
           (SEPARATOR, b'"twist": [0, 0, 0, 0, 0, 0]', b'NaN', b'\xff' * 4, b'null'), short=30),
    Target('scan_points', _points,
           lambda: [*(scan[:_COUNT].tobytes() for scan in _scans()), *files('*.bin')],
           ('kitti/compact_scan.py', 'kitti/scan_grid.py'),
           tuple(value.tobytes() for value in _ODD), short=100),
)  # fmt: skip
"""All of them."""
