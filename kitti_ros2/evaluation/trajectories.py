# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories, and the text files that hold them.

- KITTI's poses file: twelve numbers a line, a row-major 3x4 matrix; line n is frame n. Some tools
  write the frame number before them, which is a line of thirteen.
- TUM: stamp in seconds, x y z, and the quaternion x y z w; lines that begin with # are comments.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.text_file import parse_numbers
from ..model.errors import BadFileError
from ..model.geometry import Transform
from ..model.losses import Loss
from ..model.stamps import parse_seconds

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

_FARTHEST_M = 1e9
_QUATERNION = 1e-2
"""How far the length of a quaternion may be from 1, as in tf2."""
_ROTATION = 0.1
"""The same of R^T R; the devkit accepts any matrix, and products of many are not exact."""
_REPORTED_ROTATION = 1e-3
_EXPECTED = '12 numbers a line (KITTI), 13 (frame number first) or 8 (TUM: stamp x y z qx qy qz qw)'


@dataclass(frozen=True, eq=False)
class CameraTrajectory:
    """Poses of a frame of the vehicle in a fixed frame; of camera 0 once its frame is resolved.

    Attributes:
        source: Description, such as poses/09.txt (poses file).
        poses: (N, 4, 4) float64.
        numbers: (N,) KITTI's frame numbers, ascending; None if they have none.
        stamps_ns: (N,) nanoseconds, ascending; None if they have none.
        frame: The frame whose poses they are; empty for the rectified camera 0.
        losses: What could not be used.
        notes: Remarks that are no loss.
    """

    source: str
    poses: Float64Array
    numbers: Int64Array | None = None
    stamps_ns: Int64Array | None = None
    frame: str = ''
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.poses)

    def moved(self, frame_t_cam0: Float64Array) -> CameraTrajectory:
        """Return the poses of camera 0, in a fixed frame with its axes.

        Args:
            frame_t_cam0: (4, 4) camera 0 in the frame whose poses these are.
        """
        return replace(
            self, poses=np.linalg.inv(frame_t_cam0) @ self.poses @ frame_t_cam0, frame=''
        )


def read_trajectory(path: Path) -> CameraTrajectory:
    """Read a poses file or a TUM file, detected by the number of columns of most lines.

    An invalid line is a loss, and so is a second pose of one frame.

    Raises:
        BadFileError: It has no valid line.
        OSError: It cannot be read.
    """
    rows = _rows(path)
    if not rows:
        raise BadFileError(path, 'holds no poses', _EXPECTED)
    ((columns, _),) = Counter(len(words) for _, words in rows).most_common(1)
    form = _FORMATS.get(columns)
    if form is None:
        raise BadFileError(path, f'{columns} columns', _EXPECTED, line=rows[0][0])
    keys, poses, losses = _parse_rows(path, rows, form)
    order, twice = _ascending(keys)
    if twice:
        losses.append(Loss(path.name, twice, f'{path}: a second pose of the same {form.key}'))
    ascending = np.array(keys, dtype=np.int64)[order]
    found = np.array(poses)[order]
    notes = [f'{path}: {form.key}s are not in order; sorted'] if keys != sorted(keys) else []
    off = max(map(_error_of_rotation, found))
    if off > _REPORTED_ROTATION:
        notes.append(f'{path}: matrices are no exact rotations, R^T R is off by up to {off:.2g}')
    return CameraTrajectory(
        f'{path} ({form.name})',
        found,
        numbers=None if form.timed else ascending,
        stamps_ns=ascending if form.timed else None,
        losses=tuple(losses),
        notes=tuple(notes),
    )


def _parse_rows(
    path: Path, rows: Sequence[tuple[int, list[str]]], form: _PoseFormat
) -> tuple[list[int], list[Float64Array], list[Loss]]:
    """Return the key and the pose of each valid row, and the others as losses.

    Raises:
        BadFileError: No row is valid.
    """
    keys, poses, bad = [], [], []
    for position, (number, words) in enumerate(rows):
        try:
            key, pose = form.parse(words, position)
        except ValueError as error:
            bad.append(BadFileError(path, str(error), form.expected, line=number))
            continue
        keys.append(key)
        poses.append(pose)
    if not poses:
        raise bad[0]
    return keys, poses, [Loss(path.name, 1, str(error)) for error in bad]


def _ascending(keys: Sequence[int]) -> tuple[Int64Array, int]:
    """Return the order of the first pose of each key, and the number of others."""
    _, first = np.unique(np.array(keys, dtype=np.int64), return_index=True)
    return first, len(keys) - len(first)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return line number and words of each line, without blank ones and comments."""
    try:
        text = path.read_text(encoding='utf-8')
    except UnicodeDecodeError:
        raise BadFileError(path, 'is no text', _EXPECTED) from None
    lines = enumerate(text.splitlines(), start=1)
    found = ((number, line.split()) for number, line in lines)
    return [(number, words) for number, words in found if words and words[0][0] != '#']


def _parse_kitti(words: list[str], position: int) -> tuple[int, Float64Array]:
    return position, _matrix(parse_numbers(words, 12))


def _parse_numbered(words: list[str], _: int) -> tuple[int, Float64Array]:
    number, *values = parse_numbers(words, 13)
    if not (number.is_integer() and 0 <= number < 2**31):
        raise ValueError(f'{words[0]!r} is no frame number')
    return int(number), _matrix(values)


def _parse_tum(words: list[str], _: int) -> tuple[int, Float64Array]:
    values = parse_numbers(words, 8)[1:]
    if abs(np.linalg.norm(values[3:]) - 1) > _QUATERNION:
        raise ValueError(f'the quaternion has length {np.linalg.norm(values[3:]):.3g}, not 1')
    pose = Transform.from_quaternion(values[3:], values[:3]).matrix()
    return parse_seconds(words[0]), _checked(pose)


def _matrix(values: list[float]) -> Float64Array:
    return _checked(np.vstack([np.reshape(values, (3, 4)), [0.0, 0.0, 0.0, 1.0]]))


def _checked(pose: Float64Array) -> Float64Array:
    """Return a (4, 4) pose.

    Raises:
        ValueError: It is no rotation and translation.
    """
    rotation = pose[:3, :3]
    if np.abs(pose).max() > _FARTHEST_M:
        raise ValueError('a position beyond 1e9 m')
    off = _error_of_rotation(pose)
    if off > _ROTATION or np.linalg.det(rotation) < 0:
        raise ValueError(f'the matrix is no rotation (R^T R is off by {off:.2g})')
    return pose


def _error_of_rotation(pose: Float64Array) -> float:
    """Return how far R^T R is from the identity."""
    rotation = pose[:3, :3]
    return float(np.abs(rotation.T @ rotation - np.eye(3)).max())


@dataclass(frozen=True)
class _PoseFormat:
    """A format of files.

    Attributes:
        name: For users.
        parse: Parses the words of a row at a position to its key and its (4, 4) pose.
        expected: What a line holds.
        timed: Whether poses are identified by a stamp, and not by a frame number.
    """

    name: str
    parse: Callable[[list[str], int], tuple[int, Float64Array]]
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
