# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Velodyne scans: .bin (all layouts) and .txt (raw extract).

A .bin file of KITTI is a bare array of little-endian float32, four a point: x y z in metres in the
scanner's frame (x forward, y left, z up), reflectance 0..1. A .txt file has the same four numbers
a line. Source: readme.txt of the raw data devkit. Other data sets have .bin files of other columns.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..kitti import names
from ..model.errors import BadFileError
from ..model.samples import LineScan, Scan
from ..model.streams import KITTI_COLUMNS, REST, Stream
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..model.samples import Float32Array
    from ..model.streams import ScanColumns
    from .recording_index import RecordingIndex


# Detects scans that are not KITTI's 4 float32 a point, from the values of their first points.
#
# A column has values of its own kind: of some sign and magnitude. So values that are read with the
# right number of columns tell a column by its values best: that is the number with the greatest
# mutual information of column and kind of value. 4 columns stay without good evidence for others:
#
# - Reflectances of 0 to 1 in the fourth column are KITTI's, unless the number is a multiple of 4.
# - Multiples of 4 may be points in turn, such as those of two lasers: seen in the same directions,
#   and not all within 1 m or of whole numbers, as other features are; or reflectances are negative.
# - float64 read as float32 has values that are no lengths; and the reverse.
#
# Sources: 5 columns, nuScenes (nuscenes-devkit, python-sdk/nuscenes/utils/data_classes.py); 6,
# Waymo in KITTI's format (mmdetection3d, tools/dataset_converters/waymo_converter.py: x y z
# intensity elongation timestamp); 7, radar of View-of-Delft (x y z RCS v_r v_r_compensated time).

if TYPE_CHECKING:
    Values = npt.NDArray[np.floating[Any]]

HEAD_BYTES = 1 << 16
"""Read of a scan to detect its format: 4096 points."""
_ENOUGH_BYTES = 1 << 13
_FEW_BYTES = 1 << 10
_MOST_SCANS = 8  # small ones, until there is enough
_COLUMNS = 4
_NUMBERS = range(3, 33)
_LEAST_LABELS = 16
_FEWEST_VALUES = 128
_FEWEST_DOUBLES = 32

_LIMITS = (0.25, 1.0, 4.0, 16.0)
_KINDS = 12  # 5 magnitudes of either sign, zero, NaN
_LEAST_GAIN = 0.12
"""Nats a value that another number of columns must explain better than 4."""
_NEARLY = 0.08
"""Nats a value within which the smallest number of columns is the best."""
_DEVIATIONS = 4.0
_OTHER_DIRECTION = 0.6
_FARTHEST_M = 1e4
_NEAR_M = 1.0
_FEW = 0.02
_MOST = 0.98
_SHARE_OF_NONSENSE = 0.25
_MOST_OF_A_COLUMN = 0.9

_STARTS = (
    (b'version https://git-lfs', 'a pointer of Git LFS', 'fetch the file itself: git lfs pull'),
    (b'# .PCD', 'a PCD file', ''),
    (b'VERSION .7', 'a PCD file', ''),
    (b'ply\n', 'a PLY file', ''),
    (b'ply\r\n', 'a PLY file', ''),
    (b'LASF', 'a LAS file', ''),
    (b'PK\x03\x04', 'a ZIP archive, as .npz is', ''),
    (b'\x1f\x8b\x08', 'compressed by gzip', 'decompress it: gunzip'),
    (b'\x89HDF', 'an HDF5 file', ''),
)
_NUMPY = b'\x93NUMPY'
_NUMPY_HEADER = re.compile(rb"'descr': *'[<|=]?(\w+)'.*'shape': *\(([\d, ]*)\)")
_DIGITS = b'0123456789+-.eE,; \t\r\nnaifNAIF'
_TO_FLOAT32 = 'write its points as bare float32, such as with tofile of NumPy'
_EXPECTED = 'x y z reflectance, 4 float32 a point'


class Mismatch(NamedTuple):
    """The format of scans that are not KITTI's.

    Attributes:
        problem: A sentence without its subject.
        remedy: The remedy.
        point_bytes: Bytes of a point, 0 if points are not bare; None if it is not known.
    """

    problem: str
    remedy: str
    point_bytes: int | None = None


class ScanFormat(NamedTuple):
    """The format of the scans of a recording.

    Attributes:
        path: One of them.
        mismatch: Columns or format, if not KITTI's.
        normalized: Whether reflectances are 0 to 1, so that a scan of other columns stands out.
    """

    path: Path | None = None
    mismatch: Mismatch | None = None
    normalized: bool = False

    @property
    def error(self) -> BadFileError | None:
        """The error if they are not KITTI's."""
        return mismatch_error(self.path, self.mismatch) if self.path and self.mismatch else None

    def doubt(self, columns: ScanColumns) -> str | None:
        """Return the note that the given columns are not theirs; None if they may be."""
        if self.mismatch is None or self.mismatch.point_bytes in {None, columns.point_bytes}:
            return None
        return f'{self.path}: {self.mismatch.problem}, not those of --columns; check what is read'

    def check(self, path: Path, data: npt.NDArray[np.uint8]) -> None:
        """Check that a scan is not of other columns than the others.

        Raises:
            BadFileError: It is.
        """
        whole = len(data) % KITTI_COLUMNS.point_bytes == 0
        if self.normalized and whole and not _is_normalized(data[:_FEW_BYTES].view('<f4')[3::4]):
            mismatch = find_mismatch([(data[:HEAD_BYTES].tobytes(), len(data))])
            if mismatch is not None and mismatch.point_bytes is not None:
                raise odd_scan_error(path, mismatch)


def detect_scan_format(recording: RecordingIndex, *, labelled: bool) -> ScanFormat:
    """Detect the format of scans from the first bytes of the first ones.

    One other scan must agree, as a single file may be damaged. If it is labelled, SemanticKITTI's
    labels beside the first scan count its points.
    """
    listing = recording.listings.get(Stream.SCAN)
    if listing is None:
        return ScanFormat()
    paths = [listing.path(number) for number in listing.numbers.tolist()]
    paths = [path for path in paths if path.suffix.lower() != names.TXT]
    first, used = _first_heads(paths)
    points = _label_count(used[0]) if used and labelled else None
    mismatch = find_mismatch(first, points)
    if mismatch is None:
        return ScanFormat(normalized=_are_normalized(first))
    others, _ = _first_heads(paths[len(paths) // 2 :][:1]) if len(paths) > len(used) else ([], [])
    if others and find_mismatch(others) is None:
        return ScanFormat(normalized=_are_normalized(others))
    return ScanFormat(used[0], mismatch)


def _are_normalized(heads: Sequence[tuple[bytes, int]]) -> bool:
    return all(_is_normalized(_values(head, np.dtype('<f4'))[3::4]) for head, _ in heads)


def _is_normalized(reflectance: Values) -> bool:
    return bool(((reflectance >= 0) & (reflectance <= 1)).all())


def mismatch_error(path: Path | str, mismatch: Mismatch) -> BadFileError:
    """Return the error of a scan."""
    return BadFileError(path, mismatch.problem, _EXPECTED, remedy=mismatch.remedy)


def odd_scan_error(path: Path | str, mismatch: Mismatch) -> BadFileError:
    """Return the error of a scan among KITTI's."""
    return BadFileError(path, mismatch.problem, _EXPECTED, remedy='move it to a set of its own')


def _first_heads(paths: Sequence[Path]) -> tuple[list[tuple[bytes, int]], list[Path]]:
    """Return heads and sizes of the first scans that can be read, and their paths."""
    heads: list[tuple[bytes, int]] = []
    used = []
    for path in paths[:_MOST_SCANS]:
        try:
            data, size = STORE.read_ends(path, HEAD_BYTES)
        except (BadFileError, OSError):
            continue
        if size:
            heads.append((data[: min(HEAD_BYTES, size)], size))
            used.append(path)
        if sum(len(head) for head, _ in heads) >= _ENOUGH_BYTES:
            break
    return heads, used


def _label_count(scan: Path) -> int | None:
    """Return the number of SemanticKITTI's labels beside a scan, None if there are none."""
    path = scan.parents[1] / names.POINT_LABELS / (scan.stem + names.LABEL)
    try:
        return path.stat().st_size // 4
    except OSError:
        return None


def find_mismatch(heads: Sequence[tuple[bytes, int]], points: int | None = None) -> Mismatch | None:
    """Return what scans are, if they are not 4 float32 a point.

    Args:
        heads: First bytes and size of each.
        points: Count of the first scan, from its labels; None if unknown.
    """
    heads = [(head, size) for head, size in heads if size]
    if not heads:
        return None
    head, size = heads[0]
    if points and size == points * KITTI_COLUMNS.point_bytes:
        return None
    sizes = [size for _, size in heads]
    with np.errstate(all='ignore'):
        return (
            _other_format(head)
            or _doubles([head for head, _ in heads], sizes)
            or _by_labels(size, points)
            or _floats([head for head, _ in heads], sizes)
        )


def _other_format(head: bytes) -> Mismatch | None:
    """Return the format of a file that begins as those of others do."""
    if head.startswith(_NUMPY):
        match = _NUMPY_HEADER.search(head[:256])
        shape = f' of {match[1].decode()} ({match[2].decode()})' if match else ''
        return Mismatch(f'it is a NumPy file (.npy){shape}', _TO_FLOAT32, 0)
    for start, what, remedy in _STARTS:
        if head.startswith(start):
            return Mismatch(f'it is {what}', remedy or _TO_FLOAT32, 0)
    if not head.translate(None, _DIGITS) and head.split()[1:]:
        return Mismatch('it is a text file of numbers', _TO_FLOAT32, 0)
    return None


def _doubles(heads: Sequence[bytes], sizes: Sequence[int]) -> Mismatch | None:
    """Return the mismatch if the values are float64."""
    doubles = [_values(head, np.dtype('<f8')) for head in heads]
    every = np.concatenate(doubles)
    few = len(every) < _FEWEST_DOUBLES
    if few or any(size % 8 for size in sizes) or _nonsense_share(heads) < _FEW:
        return None
    magnitude = np.abs(every)
    rows = _rows(doubles, _best(doubles, sizes))
    lengths = np.concatenate([row[:, :3].ravel() for row in rows])
    sane = (magnitude == 0) | ((magnitude > 1e-9) & (magnitude < 1e12)) | np.isnan(every)
    if not len(lengths) or sane.mean() < _MOST or (np.abs(lengths) < _FARTHEST_M).mean() < _MOST:
        return None
    columns = _best(doubles, sizes)
    if len(every) < _FEWEST_VALUES or any(size % (8 * columns) for size in sizes):
        return Mismatch('values are those of float64', 'read them with --columns, :f8 behind each')
    return _of_columns(columns, 'float64')


def _by_labels(size: int, points: int | None) -> Mismatch | None:
    """Return the mismatch by the number of labels, one for each point."""
    if points is None or points < _LEAST_LABELS or size % (4 * points):
        return None
    columns = size // (4 * points)
    return _of_columns(columns, 'float32') if columns in _NUMBERS else None


def _floats(heads: Sequence[bytes], sizes: Sequence[int]) -> Mismatch | None:
    """Return the mismatch of float32 of another number of columns, or of values that are none."""
    values = [_values(head, np.dtype('<f4')) for head in heads]
    if not sum(map(len, values)):
        return None
    columns = _best(values, sizes)
    if columns != _COLUMNS and _is_proved(values, columns):
        return _of_columns(columns, 'float32')
    if sum(map(len, values)) < _FEWEST_VALUES:
        return None
    if _nonsense_share(heads) > _SHARE_OF_NONSENSE:
        return Mismatch('most values cannot be float32 of a scan', _TO_FLOAT32)
    fourth = np.concatenate([row[:, 3] for row in _rows(values, _COLUMNS)])
    wrong = _is_nonsense(fourth)
    if wrong.mean() > _MOST_OF_A_COLUMN:
        problem = f'the fourth value of most points is no reflectance, such as {fourth[wrong][0]:g}'
        return Mismatch(problem, "leave it out: --columns 'x y z -'; a name in place of - keeps it")
    return None


def _of_columns(columns: int, kind: str) -> Mismatch:
    suffix, width = (':f8', 8) if kind == 'float64' else ('', 4)
    xyzi = KITTI_COLUMNS.names[:columns]
    text = ' '.join(f'{name}{suffix}' for name in (*xyzi, *['-'] * (columns - len(xyzi))))
    keeps = '; a name in place of - keeps a column' if columns > _COLUMNS else ''
    return Mismatch(
        f'size and values are those of {columns} {kind} a point',
        f"read them with --columns '{text}'{keeps}",
        columns * width,
    )


def _values(head: bytes, kind: np.dtype) -> Values:
    whole = len(head) // kind.itemsize * kind.itemsize
    return np.frombuffer(head[:whole], kind)


def _nonsense_share(heads: Sequence[bytes]) -> float:
    wrong = _is_nonsense(np.concatenate([_values(head, np.dtype('<f4')) for head in heads]))
    return float(wrong.mean()) if len(wrong) else 0.0


def _is_nonsense(values: Values) -> npt.NDArray[np.bool_]:
    """Return which float32 are no coordinate: tiny, above 2^24, or NaN of odd bits."""
    bits = values.view('<u4') & 0x7FFFFFFF
    exponent, mantissa = bits >> 23, bits & 0x7FFFFF
    odd_nan = (exponent == 255) & (mantissa != 0) & (mantissa != 0x400000)
    wrong: npt.NDArray[np.bool_] = (
        odd_nan | ((exponent > 150) & (exponent < 255)) | ((exponent < 107) & (bits != 0))
    )
    return wrong


def _best(values: Sequence[Values], sizes: Sequence[int]) -> int:
    """Return the number of columns that explains values best, the smallest of equals."""
    width = values[0].itemsize
    possible = [n for n in _NUMBERS if all(size % (n * width) == 0 for size in sizes)]
    kinds = [_kinds_of(value) for value in values]
    gains = {n: _information(kinds, n) for n in {*possible, _COLUMNS}}
    best = max(gains.values())
    columns = min((n for n in possible if gains[n] >= best - _NEARLY), default=_COLUMNS)
    count = sum(map(len, values))
    noise = _DEVIATIONS * np.sqrt(2 * (columns - 1) * (_KINDS - 1)) / (2 * count)
    return columns if gains[columns] - gains[_COLUMNS] > _LEAST_GAIN + noise else _COLUMNS


def _kinds_of(values: Values) -> npt.NDArray[np.intp]:
    """Return the kind of each value: of 0 to 11, by sign and magnitude."""
    kinds = np.searchsorted(_LIMITS, np.abs(values)) + np.where(values < 0, len(_LIMITS) + 1, 0)
    kinds[values == 0] = _KINDS - 2
    kinds[np.isnan(values)] = _KINDS - 1
    return kinds


def _information(kinds: Sequence[npt.NDArray[np.intp]], columns: int) -> float:
    """Return the mutual information of column and kind, nats a value, without that of chance."""
    table = np.zeros(columns * _KINDS)
    for kind in kinds:
        column = np.arange(len(kind)) % columns
        table += np.bincount(column * _KINDS + kind, minlength=columns * _KINDS)
    counts = table.reshape(columns, _KINDS)
    total = counts.sum()
    expected = counts.sum(1, keepdims=True) * counts.sum(0, keepdims=True) / total
    present = counts > 0
    gain = float((counts[present] * np.log(counts[present] / expected[present])).sum())
    freedom = (columns - 1) * max(int((counts.sum(0) > 0).sum()) - 1, 1)
    return (gain - freedom / 2) / float(total)


def _rows(values: Sequence[Values], columns: int) -> list[Values]:
    """Return (N, columns) rows of each scan."""
    return [value[: len(value) // columns * columns].reshape(-1, columns) for value in values]


def _is_proved(values: Sequence[Values], columns: int) -> bool:
    """Return whether nothing speaks for 4 columns, and x y z of the others are lengths.

    Two points of 18 bytes, as of the fields x y z intensity ring, have the size of 9 columns.
    """
    reflectance = np.concatenate([row[:, 3] for row in _rows(values, _COLUMNS)])
    rows = np.concatenate(_rows(values, columns))
    if not len(rows) or (np.abs(rows[:, :3]) < _FARTHEST_M).mean() < _MOST:
        return False
    if (_is_nonsense(rows).mean(axis=0) > _SHARE_OF_NONSENSE).mean() > 1 / 2:
        return False
    if columns % _COLUMNS:
        return not _is_normalized(reflectance)
    groups = [rows[:, at : at + 3] for at in range(0, columns, _COLUMNS)]
    return bool((reflectance < 0).mean() > _FEW) or any(
        _is_other(group, groups[0]) for group in groups[1:]
    )


def _is_other(group: Values, points: Values) -> bool:
    """Return whether columns are no points of others' scanner: seen elsewhere, small, or whole.

    Points of lasers that look into the sky are 0 or NaN: those prove nothing, unless all are 0.
    """
    seen = _is_seen(group)
    if not seen.any():
        return not np.isnan(group).any()
    seen &= _is_seen(points)
    group, points = group[seen], points[seen]
    if not len(points):
        return False
    apart = float(np.hypot(*(_mean_direction(group) - _mean_direction(points))))
    if apart > _OTHER_DIRECTION + 2 / np.sqrt(len(points)):
        return True
    return any(
        share(group) > _MOST and share(points) < 1 / 2 for share in (_share_near, _share_whole)
    )


def _is_seen(points: Values) -> npt.NDArray[np.bool_]:
    seen: npt.NDArray[np.bool_] = (points != 0).any(axis=1) & np.isfinite(points).all(axis=1)
    return seen


def _share_near(points: Values) -> float:
    return float((np.abs(points) <= _NEAR_M).all(axis=1).mean())


def _share_whole(points: Values) -> float:
    return float((points == np.rint(points)).all(axis=1).mean())


def _mean_direction(points: Values) -> npt.NDArray[np.float64]:
    """Return (2,) the mean of the unit vectors to points; near 0 for those all around."""
    xy = points[:, :2].astype(np.float64)
    mean: npt.NDArray[np.float64] = np.nan_to_num(xy / np.hypot(*xy.T)[:, None]).mean(axis=0)
    return mean


POINT_BYTES = KITTI_COLUMNS.point_bytes


def parse_scan(data: bytes | npt.NDArray[np.uint8], path: Path | str) -> Float32Array:
    """Parse a .bin file into (N, 4) float32 points, a view of its bytes.

    Raises:
        BadFileError: The file is empty, or truncated inside a point.
    """
    if not len(data):
        raise BadFileError(path, 'the file is empty', 'a scan of 16 bytes a point')
    if len(data) % POINT_BYTES:
        mismatch = find_mismatch([(bytes(data[:HEAD_BYTES]), len(data))])
        if mismatch is not None:
            raise odd_scan_error(path, mismatch)
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


LINE_POINT_BYTES = 8


def parse_line_scan(data: bytes | npt.NDArray[np.uint8], path: Path | str) -> LineScan:
    """Parse a .bin file of KITTI-360's SICK: pairs of float32 (a, b), the points (0, -a, b).

    Source: LoadSickData of the authors' accumulation, kitti360Scripts; no real file was at hand.

    Raises:
        BadFileError: The file is empty, or truncated inside a point.
    """
    if not len(data) or len(data) % LINE_POINT_BYTES:
        problem = f'{len(data)} bytes, cut inside a point' if len(data) else 'the file is empty'
        raise BadFileError(path, problem, 'two float32 a point, 8 bytes')
    pairs = np.frombuffer(data, '<u4').reshape(-1, 2)
    points = np.zeros((len(pairs), 3), '<u4')
    points[:, 1:] = pairs
    points[:, 1] ^= _SIGN
    return LineScan(points.view('<f4'))


def format_line_scan(scan: LineScan) -> bytes:
    """Format a scan of the SICK as a .bin file; the inverse of parse_line_scan."""
    pairs = np.array(scan.points[:, 1:], '<f4').view('<u4')
    pairs[:, 0] ^= _SIGN
    return pairs.tobytes()


_SIGN = np.uint32(1 << 31)
"""Its bit is flipped, as the negative of NaN may have other bits."""


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


# SemanticKITTI's point labels, labels/NNNNNN.label: one uint32 a point, in the scan's order.
#
# The low 16 bits are the class, the high 16 the instance, 0 for none. Source: README of
# semantic-kitti-api.


def parse_point_labels(data: bytes, points: int, path: Path | str) -> npt.NDArray[np.uint32]:
    """Parse the (N,) uint32 labels of a scan of N points.

    Raises:
        BadFileError: The file has another number of labels.
    """
    if len(data) != points * 4:
        raise BadFileError(path, f'{len(data)} bytes', f'{points * 4}, four a point of its scan')
    return np.frombuffer(data, dtype='<u4')


def format_point_labels(labels: npt.NDArray[np.uint32]) -> bytes:
    """Format a .label file; the inverse of parse_point_labels."""
    return np.ascontiguousarray(labels, dtype='<u4').tobytes()
