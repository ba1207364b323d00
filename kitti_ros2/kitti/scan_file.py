# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Velodyne scans: .bin (all layouts) and .txt (raw extract).

A .bin file of KITTI is a bare array of little-endian float32, four a point: x y z in metres in the
scanner's frame (x forward, y left, z up), reflectance 0..1. A .txt file has the same four numbers
a line. Source: readme.txt of the raw data devkit. Other data sets have .bin files of other columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError
from ..model.samples import Scan
from ..model.scan_columns import KITTI_COLUMNS, REST
from .scan_check import HEAD_BYTES, find_mismatch, odd_scan_error

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from ..model.samples import Float32Array
    from ..model.scan_columns import ScanColumns

POINT_BYTES = KITTI_COLUMNS.point_bytes


def parse_scan(data: bytes | npt.NDArray[np.uint8], path: Path | str) -> Float32Array:
    """Parse a .bin file into (N, 4) float32 points, a view of its bytes.

    Raises:
        BadFileError: The file is empty, or truncated inside a point.
    """
    if not len(data):
        raise BadFileError(path, 'the file is empty', 'a scan of 16 bytes a point')
    if len(data) % POINT_BYTES:
        found = find_mismatch([(bytes(data[:HEAD_BYTES]), len(data))])
        if found is not None:
            raise odd_scan_error(path, found)
        raise BadFileError(
            path,
            f'{len(data)} bytes, cut inside a point',
            'a multiple of 16 bytes',
            remedy='copy the file again from its source',
        )
    return np.frombuffer(data, dtype='<f4').reshape(-1, 4)


def parse_points(
    data: bytes | npt.NDArray[np.uint8], path: Path | str, columns: ScanColumns | None = None
) -> Scan:
    """Parse a .bin file of some columns; None are KITTI's.

    Returns:
        The points, with 0 for a missing reflectance, and the extra columns. What float32 cannot
        hold of float64 is an extra column, such as x_rest.

    Raises:
        BadFileError: As parse_scan.
    """
    if columns is None or columns.is_kitti:
        return Scan(parse_scan(data, path))
    rows = parse_rows(data, path, columns)
    points = np.zeros((len(rows), 4), np.float32)
    extra = {name: rows[name] for name in columns.extra}
    with np.errstate(over='ignore', invalid='ignore'):
        for index, name in enumerate(columns.main):
            points[:, index] = rows[name]
            if columns.kind_of(name) == 'f8':
                rest = rows[name] - points[:, index]
                rest[~np.isfinite(rest)] = 0
                extra |= {name + REST: rest} if rest.any() else {}
    return Scan(points, extra=extra)


def parse_rows(
    data: bytes | npt.NDArray[np.uint8], path: Path | str, columns: ScanColumns
) -> npt.NDArray[np.void]:
    """Parse a .bin file into (N,) points of the columns' structured type, a view of its bytes.

    Raises:
        BadFileError: As parse_scan.
    """
    if not len(data):
        raise BadFileError(path, 'the file is empty', f'{columns.point_bytes} bytes a point')
    if len(data) % columns.point_bytes:
        raise BadFileError(
            path,
            f'{len(data)} bytes, cut inside a point',
            f'a multiple of {columns.point_bytes} bytes, of the columns {columns.text}',
        )
    return np.frombuffer(data, columns.point)


def format_points(scan: Scan, columns: ScanColumns) -> bytes:
    """Format a scan as a .bin file of the columns that are not skipped.

    Raises:
        ValueError: It has no such column.
    """
    missing = [name for name in columns.extra if name not in scan.extra]
    if missing:
        raise ValueError(f'the cloud has no field {missing[0]}')
    rows = np.empty(len(scan.points), columns.kept)
    for index, name in enumerate(columns.main):
        rows[name] = scan.points[:, index]
        if name + REST in scan.extra:
            rest = scan.extra[name + REST]
            np.add(rows[name], rest, out=rows[name], where=rest != 0)  # -0.0 + 0.0 is 0.0
    for name in columns.extra:
        rows[name] = scan.extra[name]
    return rows.tobytes()


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
