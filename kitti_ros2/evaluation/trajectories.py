# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories, and the text files that hold them.

- KITTI's poses file: twelve numbers a line, a row-major 3x4 matrix; line n is frame n. Some tools
  write the frame number before them, which is a line of thirteen.
- TUM: stamp in seconds, x y z, and the quaternion x y z w; lines that begin with # are comments.
"""

from __future__ import annotations

from array import array
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.text_file import parse_numbers
from ..model.errors import BadFileError, naming
from ..model.geometry import quaternion_to_rotation
from ..model.losses import Loss, format_numbers
from ..model.stamps import parse_seconds
from ..model.text import format_count

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

_FARTHEST_M = 1e9
_QUATERNION = 1e-2
"""How far the length of a quaternion may be from 1, as in tf2."""
_ROTATION = 0.1
"""The same of R^T R; the devkit accepts any matrix, and products of many are not exact."""
_REPORTED_ROTATION = 1e-3
EXPECTED = '12 numbers a line (KITTI), 13 (frame number first) or 8 (TUM: stamp x y z qx qy qz qw)'


@dataclass(frozen=True, eq=False)
class CameraTrajectory:
    """Poses of a frame of the vehicle in a fixed frame; of camera 0 once its frame is resolved.

    Attributes:
        source: Description, such as poses/09.txt (poses file).
        poses: (N, 4, 4) float64.
        numbers: (N,) KITTI's frame numbers, ascending; None if they have none.
        stamps_ns: (N,) nanoseconds, ascending; None if they have none.
        frame: The frame whose poses they are; empty for the rectified camera 0.
        frame_T_cam0: (4, 4) camera 0 in the frame whose poses they were; None if they were its own.
        losses: What could not be used.
        notes: Remarks that are no loss.
    """

    source: str
    poses: Float64Array
    numbers: Int64Array | None = None
    stamps_ns: Int64Array | None = None
    frame: str = ''
    frame_T_cam0: Float64Array | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.poses)

    def moved(self, frame_t_cam0: Float64Array) -> CameraTrajectory:
        """Return the poses of camera 0, in a fixed frame with its axes.

        Args:
            frame_t_cam0: (4, 4) camera 0 in the frame whose poses these are.
        """
        poses = np.linalg.inv(frame_t_cam0) @ self.poses @ frame_t_cam0
        return replace(self, poses=poses, frame='', frame_T_cam0=frame_t_cam0)

    def scaled(self, factor: float) -> CameraTrajectory:
        """Return poses with positions times a factor: not the way from their frame to camera 0."""
        mount = np.eye(4) if self.frame_T_cam0 is None else self.frame_T_cam0
        own = mount @ self.poses @ np.linalg.inv(mount)
        own[:, :3, 3] *= factor
        return replace(self, poses=np.linalg.inv(mount) @ own @ mount)


def read_trajectory(path: Path) -> CameraTrajectory:
    """Read a poses file or a TUM file, detected by the number of columns of most lines.

    An invalid line is a loss, and so is a second pose of one frame. A first line without a number
    is a header, which is left out with a note.

    Raises:
        BadFileError: It has no valid line.
        OSError: It cannot be read.
    """
    content = _read_lines(path)
    rows = array('q', (row for row, line in enumerate(content) if _may_hold_pose(line)))
    header = len(rows) > 1 and not _has_number(content[rows[0]])
    rows = rows[header:]
    if not rows:
        raise BadFileError(path, 'contains no poses', EXPECTED)
    ((columns, _),) = Counter(len(content[row].split()) for row in rows).most_common(1)
    form, first = _FORMATS.get(columns), content[rows[0]]
    if form is None or ',' in first.split()[0]:
        raise _unknown_columns(path, rows[0] + 1, columns, first)
    found = ((row + 1, content[row].split()) for row in rows)
    lines, keys, poses, losses = _parse_rows(path, found, form)
    ascending, order = np.unique(np.array(keys, dtype=np.int64), return_index=True)
    again = sorted({*range(len(keys))} - {*order.tolist()})
    if again:
        where = format_numbers([lines[place] for place in again])
        text = f'{path}: a second pose of the same {form.key} in lines {where}; the first is used'
        losses.append(Loss(path.name, len(again), text))
    notes = [f'{path}: the first line has no numbers; taken as a header'] if header else []
    if keys != sorted(keys):
        notes.append(f'{path}: {form.key}s are not in order; sorted')
    off = float(_errors_of_rotation(poses[order]).max())
    if off > _REPORTED_ROTATION:
        notes.append(f'{path}: matrices are no exact rotations, R^T R is off by up to {off:.2g}')
    return CameraTrajectory(
        f'{path} ({form.name})',
        poses[order],
        numbers=None if form.timed else ascending,
        stamps_ns=ascending if form.timed else None,
        losses=tuple(losses),
        notes=tuple(notes),
    )


def _read_lines(path: Path) -> list[str]:
    try:
        with naming(path):
            text = path.read_text(encoding='utf-8-sig')
    except UnicodeDecodeError:
        text = '\0'
    if '\0' in text:
        raise BadFileError(path, 'is no UTF-8 text', EXPECTED)
    return text.splitlines()


def _may_hold_pose(line: str) -> bool:
    """Whether a line is neither blank nor a comment."""
    words = line.split(maxsplit=1)
    return bool(words) and words[0][0] != '#'


def _has_number(line: str) -> bool:
    """Whether a line has a number, with any separators."""
    for word in line.replace(',', ' ').replace(';', ' ').split():
        with suppress(ValueError):
            float(word)
            return True
    return False


def _unknown_columns(path: Path, line: int, columns: int, text: str) -> BadFileError:
    for name, mark in (('commas', ','), ('semicolons', ';')):
        if mark in text:
            return BadFileError(
                path, f'numbers are separated by {name}', f'spaces, and {EXPECTED}', line=line
            )
    return BadFileError(path, format_count(columns, 'column'), EXPECTED, line=line)


def _parse_rows(
    path: Path, rows: Iterable[tuple[int, list[str]]], form: _PoseFormat
) -> tuple[list[int], list[int], Float64Array, list[Loss]]:
    """Return line, key and (4, 4) pose of each valid row, and the others as losses.

    Raises:
        BadFileError: No row is valid.
    """
    lines, keys, values = [], [], []
    faults: dict[int, str] = {}
    for position, (line, words) in enumerate(rows):
        try:
            key, matrix = form.parse(words, position)
        except ValueError as error:
            faults[line] = str(error)
            continue
        lines.append(line)
        keys.append(key)
        values.append(matrix)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3] = np.reshape(values, (-1, 3, 4))
    wrong = _faults(poses)
    faults |= {lines[place]: fault for place, fault in wrong.items()}
    kept = [place for place in range(len(keys)) if place not in wrong]
    errors = [
        BadFileError(path, fault, form.expected, line=line)
        for line, fault in sorted(faults.items())
    ]
    if not kept:
        raise errors[0]
    losses = [Loss(path.name, 1, str(error)) for error in errors]
    return [lines[place] for place in kept], [keys[place] for place in kept], poses[kept], losses


def _parse_kitti(words: list[str], position: int) -> tuple[int, list[float]]:
    return position, parse_numbers(words, 12)


def _parse_numbered(words: list[str], _: int) -> tuple[int, list[float]]:
    number, *values = parse_numbers(words, 13)
    if not (number.is_integer() and 0 <= number < 2**31):
        raise ValueError(f'{words[0]!r} is no frame number')
    return int(number), values


def _parse_tum(words: list[str], _: int) -> tuple[int, list[float]]:
    x, y, z, *quaternion = parse_numbers(words, 8)[1:]
    length = hypot(*quaternion)
    if abs(length - 1) > _QUATERNION:
        raise ValueError(f'the quaternion has length {length:.3g}, not 1')
    first, second, third = quaternion_to_rotation(quaternion).tolist()
    return parse_seconds(words[0]), [*first, x, *second, y, *third, z]


def _faults(poses: Float64Array) -> dict[int, str]:
    """Return by index why one of (N, 4, 4) poses is no rotation and translation."""
    off, sign = _errors_of_rotation(poses), np.linalg.det(poses[:, :3, :3])
    far = np.abs(poses).max(axis=(1, 2), initial=0) > _FARTHEST_M
    found = {}
    for place in np.flatnonzero(far | ~(off <= _ROTATION) | (sign < 0)).tolist():
        if far[place]:
            found[place] = 'a position beyond 1e9 m'
        elif off[place] <= _ROTATION:
            found[place] = 'the matrix is a reflection (left-handed axes, determinant -1)'
        else:
            found[place] = f'the matrix is no rotation (R^T R is off by {off[place]:.2g})'
    return found


def _errors_of_rotation(poses: Float64Array) -> Float64Array:
    """Return (N,) how far R^T R is from the identity."""
    rotations = np.clip(poses[:, :3, :3], -_FARTHEST_M, _FARTHEST_M)
    products = rotations.transpose(0, 2, 1) @ rotations
    found: Float64Array = np.abs(products - np.eye(3)).max(axis=(1, 2), initial=0)
    return found


@dataclass(frozen=True)
class _PoseFormat:
    """A format of files.

    Attributes:
        name: For users.
        parse: Parses the words of a row at a position to its key and the 12 numbers of its matrix.
        expected: What a line holds.
        timed: Whether poses are identified by a stamp, and not by a frame number.
    """

    name: str
    parse: Callable[[list[str], int], tuple[int, list[float]]]
    expected: str
    timed: bool = False

    @property
    def key(self) -> str:
        """What poses are identified by."""
        return 'stamp' if self.timed else 'frame number'


_FORMATS = {
    12: _PoseFormat('poses file', _parse_kitti, 'twelve numbers, a 3x4 pose matrix'),
    13: _PoseFormat('poses file with frame numbers', _parse_numbered, 'a frame number and a pose'),
    8: _PoseFormat('TUM file', _parse_tum, 'stamp x y z qx qy qz qw', timed=True),
}
"""By number of columns."""
