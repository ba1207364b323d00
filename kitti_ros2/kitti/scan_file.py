# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Velodyne scans: .bin (all layouts) and .txt (raw extract).

A .bin file is a bare array of little-endian float32, four a point: x y z in metres in the
scanner's frame (x forward, y left, z up), reflectance 0..1. A .txt file has the same four numbers
a line. Source: readme.txt of the raw data devkit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from ..model.samples import Float32Array

POINT_BYTES = 16


def parse_scan(data: bytes | npt.NDArray[np.uint8], path: Path | str) -> Float32Array:
    """Parse a .bin file into (N, 4) float32 points, a view of its bytes.

    Raises:
        BadFileError: The file is empty, or truncated inside a point.
    """
    if not len(data):
        raise BadFileError(path, 'the file is empty', 'a scan of 16 bytes a point')
    if len(data) % POINT_BYTES:
        raise BadFileError(
            path,
            f'{len(data)} bytes, cut inside a point',
            'a multiple of 16 bytes',
            remedy='copy the file again from its source',
        )
    return np.frombuffer(data, dtype='<f4').reshape(-1, 4)


def format_scan(points: Float32Array) -> bytes:
    """Format (N, 4) points as a .bin file; the inverse of parse_scan."""
    return np.ascontiguousarray(points, dtype='<f4').tobytes()


def parse_scan_text(data: bytes, path: Path | str) -> Float32Array:
    """Parse a .txt file into (N, 4) float32 points; NaN and infinity are kept.

    Raises:
        BadFileError: The file is empty or a line is not four numbers.
    """
    rows = [line.split() for line in data.splitlines()]
    if not rows or any(len(row) != 4 for row in rows):
        raise _bad_line(data, path)
    try:
        return np.array(rows, dtype=np.float64).astype(np.float32)
    except ValueError:
        raise _bad_line(data, path) from None


def format_scan_text(points: Float32Array) -> bytes:
    """Format (N, 4) points as a .txt file: millimetres and hundredths, as in raw extracts."""
    lines = [f'{x:.3f} {y:.3f} {z:.3f} {r:.2f}' for x, y, z, r in points.tolist()]
    return ('\n'.join(lines) + '\n').encode() if lines else b''


def _bad_line(data: bytes, path: Path | str) -> BadFileError:
    """Return the error with the first line that is not four numbers."""
    expected = 'four numbers a line: x y z reflectance'
    for index, line in enumerate(data.splitlines(), 1):
        words = line.split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            return BadFileError(path, f'{line[:40]!r}', expected, line=index)
        if len(numbers) != 4:
            return BadFileError(path, f'{len(numbers)} values', expected, line=index)
    return BadFileError(path, 'the file is empty', expected)
