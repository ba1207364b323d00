# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories: their text files, and their errors by segments, APE and RPE."""

from __future__ import annotations

from array import array
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import hypot
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.kitti_recording import rect_from_imu
from ..kitti.text_file import parse_numbers
from ..messages.naming import FrameNames
from ..messages.tf_tree import FrameTree
from ..model.errors import (
    BadFileError,
    Loss,
    MissingDataError,
    UsageError,
    did_you_mean,
    format_count,
    format_numbers,
    naming,
)
from ..model.geometry import quaternion_to_rotation
from ..model.streams import CAMERA_NAMES, parse_seconds
from ..options.evaluation import Alignment

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..messages.tf_tree import Link
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, Float32Array, Int64Array


# Trajectories and their text files.
#
# - KITTI's poses file: twelve numbers a line, a row-major 3x4 matrix; line n is frame n. Some tools
#   write the frame number before them, which is a line of thirteen. KITTI-360's cam0_to_world.txt
#   has it before a 4x4 matrix, seventeen numbers.
# - TUM: stamp in seconds, x y z, and the quaternion x y z w; lines that begin with # are comments.

_BY_LINE, _WHOLE = 12, 17  # columns of poses/NN.txt, and of cam0_to_world.txt of KITTI-360
_FARTHEST_M = 1e9
_QUATERNION = 1e-2
"""Tolerance of the length of a quaternion, as in tf2."""
_ROTATION = 0.1
"""Tolerance of R^T R; the devkit accepts any matrix, and products of many are not exact."""
_REPORTED_ROTATION = 1e-3
EXPECTED = (
    '12 numbers a line (KITTI), 13 or 17 (frame number first) or 8 (TUM: stamp x y z qx qy qz qw)'
)


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
        losses: Unusable lines.
        notes: One line each.
        by_line: Whether the numbers are those of lines, from 0, because there are no others.
    """

    source: str
    poses: Float64Array
    numbers: Int64Array | None = None
    stamps_ns: Int64Array | None = None
    frame: str = ''
    frame_T_cam0: Float64Array | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    by_line: bool = False

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
    numbered_rows = ((row + 1, content[row].split()) for row in rows)
    lines, keys, poses, losses = _parse_rows(path, numbered_rows, form)
    ascending, order = np.unique(np.array(keys, dtype=np.int64), return_index=True)
    again = sorted({*range(len(keys))} - {*order.tolist()})
    if again:
        where = format_numbers([lines[index] for index in again])
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
        by_line=columns == _BY_LINE,
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
    """Return whether a line is neither blank nor a comment."""
    words = line.split(maxsplit=1)
    return bool(words) and words[0][0] != '#'


def _has_number(line: str) -> bool:
    """Return whether a line has a number, with any separators."""
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
    faults |= {lines[index]: fault for index, fault in wrong.items()}
    valid = [index for index in range(len(keys)) if index not in wrong]
    errors = [
        BadFileError(path, fault, form.expected, line=line)
        for line, fault in sorted(faults.items())
    ]
    if not valid:
        raise errors[0]
    losses = [Loss(path.name, 1, str(error)) for error in errors]
    return [lines[index] for index in valid], [keys[index] for index in valid], poses[valid], losses


def _parse_kitti(words: list[str], position: int) -> tuple[int, list[float]]:
    return position, parse_numbers(words, 12)


def _parse_numbered(words: list[str], _: int) -> tuple[int, list[float]]:
    number, *values = parse_numbers(words, len(words) if len(words) == _WHOLE else 13)
    if values[12:] not in ([], [0, 0, 0, 1]):
        raise ValueError('the last row is not 0 0 0 1')
    if not (number.is_integer() and 0 <= number < 2**31):
        raise ValueError(f'{words[0]!r} is no frame number')
    return int(number), values[:12]


def _parse_tum(words: list[str], _: int) -> tuple[int, list[float]]:
    x, y, z, *quaternion = parse_numbers(words, 8)[1:]
    length = hypot(*quaternion)
    if abs(length - 1) > _QUATERNION:
        raise ValueError(f'the quaternion has length {length:.3g}, not 1')
    first, second, third = quaternion_to_rotation(quaternion).tolist()
    return parse_seconds(words[0]), [*first, x, *second, y, *third, z]


def _faults(poses: Float64Array) -> dict[int, str]:
    """Return the faults of (N, 4, 4) poses by index: no rotation, or a position too far."""
    off, sign = _errors_of_rotation(poses), np.linalg.det(poses[:, :3, :3])
    far = np.abs(poses).max(axis=(1, 2), initial=0) > _FARTHEST_M
    faults = {}
    for index in np.flatnonzero(far | ~(off <= _ROTATION) | (sign < 0)).tolist():
        if far[index]:
            faults[index] = 'a position beyond 1e9 m'
        elif off[index] <= _ROTATION:
            faults[index] = 'the matrix is a reflection (left-handed axes, determinant -1)'
        else:
            faults[index] = f'the matrix is no rotation (R^T R is off by {off[index]:.2g})'
    return faults


def _errors_of_rotation(poses: Float64Array) -> Float64Array:
    """Return (N,) greatest differences of R^T R from the identity."""
    rotations = np.clip(poses[:, :3, :3], -_FARTHEST_M, _FARTHEST_M)
    products = rotations.transpose(0, 2, 1) @ rotations
    errors: Float64Array = np.abs(products - np.eye(3)).max(axis=(1, 2), initial=0)
    return errors


@dataclass(frozen=True)
class _PoseFormat:
    """A format of files.

    Attributes:
        name: For users.
        parse: Parses the words of a row at a position to its key and the 12 numbers of its matrix.
        expected: The content of a line.
        timed: True if poses are identified by a stamp, and not by a frame number.
    """

    name: str
    parse: Callable[[list[str], int], tuple[int, list[float]]]
    expected: str
    timed: bool = False

    @property
    def key(self) -> str:
        """The kind of the poses' keys."""
        return 'stamp' if self.timed else 'frame number'


_FORMATS = {
    _BY_LINE: _PoseFormat('poses file', _parse_kitti, 'twelve numbers, a 3x4 pose matrix'),
    13: _PoseFormat('poses file with frame numbers', _parse_numbered, 'a frame number and a pose'),
    _WHOLE: _PoseFormat('cam0_to_world.txt', _parse_numbered, 'a frame number and a 4x4 matrix'),
    8: _PoseFormat('TUM file', _parse_tum, 'stamp x y z qx qy qz qw', timed=True),
}
"""By number of columns."""


# The rectified camera 0 in any frame of the vehicle.

CAMERA_0 = FrameNames(cameras=CAMERA_NAMES).camera(0)
"""The name of the rectified camera 0 in TF."""


def kitti_links(calibration: Calibration, base_t_imu: Transform) -> list[Link]:
    """Return the static transforms of a recording up to camera 0, also of an unrectified one."""
    names = FrameNames()
    velo_t_cam0 = calibration.velo_T_imu @ rect_from_imu(calibration).inverse()
    return [
        (names.base, names.imu, base_t_imu),
        (names.imu, names.velo, calibration.velo_T_imu.inverse()),
        (names.velo, CAMERA_0, velo_t_cam0),
    ]


def frame_t_cam0(frame: str, own: Sequence[Link], others: Sequence[Link]) -> Float64Array:
    """Return (4, 4) camera 0 in a frame.

    Args:
        frame: The frame.
        own: Static transforms of the bag that it is from.
        others: Static transforms of the ground truth, for frames that the bag does not have.

    Raises:
        MissingDataError: They do not connect the two.
    """
    if frame == CAMERA_0:
        return np.eye(4)
    # A bag may have an unrectified camera 0; that of the ground truth is rectified.
    rectified = any(link[1] == CAMERA_0 for link in others)
    own_links = [link for link in own if not rectified or link[1].lstrip('/') != CAMERA_0]
    placed = {link[1].lstrip('/') for link in own_links}
    tree = FrameTree([*own_links, *(link for link in others if link[1] not in placed)])
    transform = tree.find(frame, CAMERA_0)
    if transform is not None:
        return transform.matrix()
    if not tree.frames:
        raise MissingDataError(
            f'the frame {frame} cannot be converted to camera 0: neither the ground truth nor the'
            f' result has a calibration; give the folder of the sequence as ground truth, or poses'
            f' of camera 0'
        )
    near = did_you_mean(frame, sorted(tree.frames)) if frame not in tree.frames else ''
    raise MissingDataError(
        f'no static transform from {frame or "a frame without a name"} to camera 0; known are'
        f' {tree}; name the frame of these whose poses they are with --frame{near}'
    )


# The errors of KITTI's odometry benchmark, segment by segment.
#
# Source: evaluate_odometry.cpp of the odometry devkit: trajectoryDistances,
# lastFrameFromSegmentLength, rotationError, translationError, calcSequenceErrors and saveStats.
# Properties that are not obvious there, and are the same here:
#
# - The length of a segment is measured along the ground truth, in float32, and its last frame is
#   the first one *beyond* the length; errors are divided by the length itself (100 m), not by the
#   distance of the frames (100.7 m).
# - Every 10th frame is a start, and a start has a segment of each length that still fits. All
#   segments have the same weight in the mean, so that short ones, of which there are more, count
#   more.
# - The rotation error is the angle of the trace in float32: angles below about 0.02 degrees are 0,
#   and the next possible one is 0.028 degrees.
# - Matrices are inverted as such, not transposed: a rotation of seven digits has no error against
#   itself.
# - The speed of a segment counts both its first and its last frame, at 10 Hz.
#
# The devkit refuses a result with another number of poses than the ground truth. Here a segment
# without a result at its first or last frame is left out, and counted.

LENGTHS_M = (100, 200, 300, 400, 500, 600, 700, 800)
STEP = 10
_PERIOD_S = 0.1


@dataclass(frozen=True, eq=False)
class SegmentErrors:
    """The errors of N segments, by first frame, and of one frame by length.

    Attributes:
        first, last: (N,) positions of its first and last frame in the ground truth.
        lengths_m: (N,) float32, of LENGTHS_M.
        translations: (N,) float32, metres per metre.
        rotations: (N,) float32, radians per metre.
        speeds_m_s: (N,) float32.
        left_out: Number of segments of the ground truth without a result.
    """

    first: Int64Array
    last: Int64Array
    lengths_m: Float32Array
    translations: Float32Array
    rotations: Float32Array
    speeds_m_s: Float32Array
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.first)

    @property
    def t_err_percent(self) -> float | None:
        """Mean translation error in percent; None without segments."""
        return _mean(self.translations, 100)

    @property
    def r_err_deg_per_m(self) -> float | None:
        """Mean rotation error in degrees per metre; None without segments."""
        return _mean(self.rotations, 180 / np.pi)

    def chosen(self, mask: npt.NDArray[np.bool_]) -> SegmentErrors:
        """Return some of the segments, (N,) bool."""
        return SegmentErrors(
            self.first[mask],
            self.last[mask],
            self.lengths_m[mask],
            self.translations[mask],
            self.rotations[mask],
            self.speeds_m_s[mask],
        )

    def of_length(self, length_m: int) -> SegmentErrors:
        """Return the segments of one of LENGTHS_M."""
        return self.chosen(self.lengths_m == length_m)


def _mean(errors: Float32Array, factor: float) -> float | None:
    """Return the mean of the devkit: a float32 sum, one after the other."""
    if not len(errors):
        return None
    total = np.cumsum(errors, dtype=np.float32)[-1]
    return float(total / np.float32(len(errors))) * factor


def path_distances(poses: Float64Array) -> Float32Array:
    """Return (N,) metres along (N, 4, 4) poses up to each."""
    steps = np.diff(poses[:, :3, 3], axis=0).astype(np.float32)
    distances: Float32Array = np.cumsum(np.append(np.float32(0), _norms(steps)), dtype=np.float32)
    return distances


def segment_errors(
    numbers: Int64Array,
    ground_truth: Float64Array,
    result: Float64Array,
    posed: npt.NDArray[np.bool_],
) -> SegmentErrors:
    """Compute the errors of all segments.

    Args:
        numbers: (N,) frame numbers of the ground truth, ascending; with holes, every 10th is by
            number.
        ground_truth: (N, 4, 4) poses of camera 0.
        result: (N, 4, 4) poses of camera 0 at the same frames, in any fixed frame.
        posed: (N,) which frames have a result.
    """
    distances = path_distances(ground_truth)
    starts = np.flatnonzero((numbers - numbers[0]) % STEP == 0)
    first = np.repeat(starts, len(LENGTHS_M))
    lengths = np.tile(np.array(LENGTHS_M, dtype=np.float32), len(starts))
    last = np.searchsorted(distances, distances[first] + lengths, side='right')
    fits = last < len(distances)
    first, last, lengths = first[fits], last[fits], lengths[fits]
    scored = posed[first] & posed[last]
    left_out = int(np.count_nonzero(~scored))
    first, last, lengths = first[scored], last[scored], lengths[scored]
    errors = np.linalg.inv(_between(result, first, last)) @ _between(ground_truth, first, last)
    frames = (numbers[last] - numbers[first] + 1).astype(np.float32)
    return SegmentErrors(
        first,
        last,
        lengths,
        _norms(errors[:, :3, 3].astype(np.float32)) / lengths,
        _angles(errors) / lengths,
        (lengths / (_PERIOD_S * frames.astype(np.float64))).astype(np.float32),
        left_out,
    )


def _between(poses: Float64Array, first: Int64Array, last: Int64Array) -> Float64Array:
    """Return (M, 4, 4) poses of the last frames in the first ones."""
    relative: Float64Array = np.linalg.inv(poses[first]) @ poses[last]
    return relative


def _norms(vectors: Float32Array) -> Float32Array:
    """Return (N,) lengths of (N, 3) vectors, added in the order of the devkit."""
    x, y, z = vectors.T
    norms: Float32Array = np.sqrt(x * x + y * y + z * z)
    return norms


def _angles(errors: Float64Array) -> Float32Array:
    """Return (N,) radians of the rotations of (N, 4, 4) transforms."""
    a, b, c = (errors[:, axis, axis].astype(np.float32) for axis in range(3))
    cosines = (0.5 * ((a + b + c).astype(np.float64) - 1.0)).astype(np.float32)
    angles: Float32Array = np.arccos(np.clip(cosines, np.float32(-1), np.float32(1)))
    return angles


# Absolute and relative pose errors (APE, RPE), by evo.


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """The errors of M frames, after an alignment.

    Attributes:
        ape_m: (M,) distances of the positions, metres.
        rpe_m: (K,) errors of the steps from a frame to the next, metres; steps over missing frames
            are left out.
        positions: (M, 3) aligned positions of the result.
        scale: Factor of the alignment; 1 unless it scales.
    """

    ape_m: Float64Array
    rpe_m: Float64Array
    positions: Float64Array
    scale: float = 1.0


def check_evo() -> None:
    """Check that evo is installed.

    Raises:
        UsageError: It is not.
    """
    if find_spec('evo') is None:
        raise UsageError(
            "eval odometry needs evo, which is not installed; run pip install 'kitti_ros2[eval]'"
        )


def pose_errors(
    numbers: Int64Array, ground_truth: Float64Array, result: Float64Array, alignment: Alignment
) -> PoseErrors:
    """Compute APE and RPE of the translation, as evo_ape and evo_rpe do.

    Args:
        numbers: (M,) frame numbers.
        ground_truth: (M, 4, 4) poses.
        result: (M, 4, 4) poses.
        alignment: Alignment of the result.

    Raises:
        UsageError: The alignment is not possible.
    """
    from evo.core.metrics import APE, RPE, PoseRelation  # noqa: PLC0415 - heavy, and an extra
    from evo.core.trajectory import PosePath3D  # noqa: PLC0415 - as above

    reference, estimate = (PosePath3D(poses_se3=[*rigid(path)]) for path in (ground_truth, result))
    scale = _align(estimate, reference, alignment)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((reference, estimate))
    steps = np.zeros(0)
    if len(numbers) > 1:
        rpe = RPE(PoseRelation.translation_part, delta=1)
        rpe.process_data((reference, estimate))
        after = np.array(rpe.delta_ids)
        steps = np.asarray(rpe.error)[numbers[after] - numbers[after - 1] == 1]
    return PoseErrors(np.asarray(ape.error), steps, np.asarray(estimate.positions_xyz), scale)


def _align(estimate: Any, reference: Any, alignment: Alignment) -> float:  # noqa: ANN401 - of evo
    """Align a path of evo in place; return the scale."""
    from evo import EvoException  # noqa: PLC0415 - as above

    try:
        if alignment in {Alignment.FIRST, Alignment.SCALE}:
            estimate.align_origin(reference)
        elif alignment is not Alignment.NONE:
            *_, scale = estimate.align(reference, correct_scale=alignment is Alignment.SIM3)
            return float(scale)
    except EvoException as error:
        other = Alignment.SCALE if alignment is Alignment.SIM3 else Alignment.FIRST
        raise UsageError(
            f'--align {alignment.value} is not possible (positions on a line, or at one place, do'
            f' not tell the rotation); give --align {other.value}'
        ) from error
    return 1.0


def fit_scale(ground_truth: Float64Array, result: Float64Array, alignment: Alignment) -> float:
    """Return the factor of the result's positions by which they fit those of the ground truth.

    Both are those of kitti-odom-eval (kitti_odometry.py, 2019), by which monocular odometry is
    reported: for sim3 that of the alignment of all positions (Umeyama), as its 7dof; for scale the
    least squares of positions from the first pose, as its scale.

    Args:
        ground_truth: (M, 4, 4) poses.
        result: (M, 4, 4) poses.
        alignment: One with a scale.

    Raises:
        UsageError: The alignment is not possible.
    """
    if alignment is Alignment.SIM3:
        return pose_errors(np.arange(len(result)), ground_truth, result, alignment).scale
    true, estimate = ((np.linalg.inv(path[0]) @ path)[:, :3, 3] for path in (ground_truth, result))
    squares, product = float(np.sum(estimate * estimate)), float(np.sum(estimate * true))
    if not squares or product <= 0:
        raise UsageError(
            f'--align {alignment.value} is not possible (the result does not move along the ground'
            f' truth); give --align first'
        )
    return product / squares


def rmse(errors: Float64Array) -> float | None:
    """Return the root of the mean square; None without errors."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None


def rigid(poses: Float64Array) -> Float64Array:
    """Return (M, 4, 4) poses with the rotations nearest to theirs.

    evo refuses matrices that are rounded to fewer than six digits.
    """
    u, _, vh = np.linalg.svd(poses[:, :3, :3])
    rigid_poses: Float64Array = poses.copy()
    rigid_poses[:, :3, :3] = u @ vh
    return rigid_poses
