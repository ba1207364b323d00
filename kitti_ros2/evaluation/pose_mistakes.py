# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The usual mistakes behind absurd scores of trajectories, told from motions otherwise right."""

from __future__ import annotations

from itertools import permutations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .box_mistakes import Change
from .trajectories import path_distances

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

# Motions are compared over a tenth of the way, 100 m at most; those of a passable odometry are
# off by less than a twentieth of it. A shift in time is told by those over a second, where speed
# or turn changes most.

_STEPS, _LONGEST_M, _LEAST_M = 100, 100.0, 0.02
_OFF_PART, _TURNED = 0.05, 0.05
_DIRECTIONS = ('right', 'down', 'forward', 'left', 'up', 'backward')
_SCANNER = 'x forward, y left, z up'
_SAME_SCALE = 0.1
_LATEST_FRAMES, _APART = 20, 10
_LATE_BEFORE = 0.8  # tolerances: a scale that is off looks like another time by less
_LATE_AFTER = 0.4  # other drives have much the same speeds
_FEWER = 0.9
_TELLING = 0.75  # of the frames, those whose speed or turn says most about the time


class _Interpretation(NamedTuple):
    """A way to read a result.

    Attributes:
        text: What it is then, after "the result agrees with the ground truth".
        poses: (N, 4, 4) the result so read.
    """

    text: str
    poses: Float64Array


def diagnose_poses(
    source: str, numbers: Int64Array, truth: Float64Array, result: Float64Array
) -> Iterator[str]:
    """Yield a note if a result agrees with the ground truth only when it is read in another way.

    Args:
        source: Of the result, for users.
        numbers: (N,) frame numbers, ascending.
        truth: (N, 4, 4) poses of camera 0.
        result: (N, 4, 4) poses of the same frames.
    """
    if len(truth) < 2:
        return
    first, last = _segments(truth)
    way = _motions(truth, first, last)
    before = _errors(way, _motions(result, first, last))
    if not len(before):
        return
    best: tuple[float, Change, str] | None = None
    for reading in (*_axes(result), *_scales(way, result, first, last)):
        change = Change(before, _errors(way, _motions(reading.poses, first, last)))
        middle = float(np.median(change.after))
        if change.explains and np.median(before) > 2 and (best is None or middle < best[0]):
            best = middle, change, reading.text
    if best is not None:
        _, change, text = best
        percent = [100 * _OFF_PART * float(np.median(part)) for part in change]
        yield (
            f'{source}: agrees with the ground truth {text} (the median drift is then'
            f' {percent[1]:.2g} % instead of {percent[0]:.3g} %)'
        )
        return
    yield from _late(source, numbers, truth, result)


def diagnose_keyframes(source: str, truth: Float64Array, result: Float64Array) -> Iterator[str]:
    """Yield a note on keyframes, whose lines are not the frames that they are matched with.

    Args:
        source: Of the result, for users.
        truth: (N, 4, 4) poses of all frames.
        result: (M, 4, 4) poses, of lines 0 to M - 1.
    """
    count, frames = len(result), len(truth)
    if not 2 < count < _FEWER * frames:
        return
    own, whole = path_distances(result), path_distances(truth)
    at = np.minimum(np.searchsorted(whole, own), len(truth) - 1)
    even = np.rint(np.linspace(0, len(truth) - 1, count)).astype(np.int64)
    first, last = _segments(result)
    motions = _motions(result, first, last)
    before = _errors(_motions(truth, first, last), motions)
    for frame_of in (even, at):
        change = Change(before, _errors(_motions(truth, frame_of[first], frame_of[last]), motions))
        if change.explains and np.median(before) > 2:
            yield (
                f'{source}: has {count} poses for {frames} frames, which agree with frames spread'
                f' over all of them: keyframes, matched by line; write the frame number before'
                ' each pose (13 columns), or a TUM file with stamps'
            )
            return


def _segments(poses: Float64Array) -> tuple[Int64Array, Int64Array]:
    """Return first and last frame of parts of the way."""
    distances = path_distances(poses).astype(np.float64)
    length = min(_LONGEST_M, distances[-1] / 10)
    first = np.unique(np.linspace(0, len(poses) - 1, _STEPS).astype(np.int64))
    last = np.searchsorted(distances, distances[first] + max(length, _LEAST_M))
    inside = last < len(poses)
    return first[inside], last[inside]


def _motions(poses: Float64Array, first: Int64Array, last: Int64Array) -> Float64Array:
    """Return (P, 4, 4) the poses of the last frames in the first."""
    motions: Float64Array = np.linalg.inv(poses[first]) @ poses[last]
    return motions


def _errors(way: Float64Array, motions: Float64Array) -> Float64Array:
    """Return (P,) differences of motions, of their way or turn, in tolerances."""
    rest = np.linalg.inv(way) @ motions
    off = np.linalg.norm(rest[:, :3, 3], axis=1) / np.maximum(_lengths(way), _LEAST_M)
    turned = np.arccos(np.clip((np.trace(rest[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    error: Float64Array = np.maximum(off / _OFF_PART, turned / _TURNED)
    return error


def _lengths(motions: Float64Array) -> Float64Array:
    lengths: Float64Array = np.linalg.norm(motions[:, :3, 3], axis=1)
    return lengths


def _axes(result: Float64Array) -> Iterator[_Interpretation]:
    """Yield a result as that of another frame, as inverse poses, and as transposed rotations."""
    inverse = np.linalg.inv(result)
    transposed = result.copy()
    transposed[:, :3, :3] = result[:, :3, :3].transpose(0, 2, 1)
    forms = (
        ('', result),
        ('inverted (world to camera; KITTI has camera to world)', inverse),
        ('with transposed rotations', transposed),
    )
    for (form, poses), (axes, turn) in product(forms, _turns()):
        is_own = axes == 'x right, y down, z forward'
        if is_own and not form:
            continue
        hint = '; give --frame velo_link, or imu_link, and the folder of the sequence'
        frame = f'as poses of a frame with {axes}{hint if axes == _SCANNER and not form else ""}'
        text = form if is_own else f'{form}, {frame}' if form else frame
        yield _Interpretation(text, turn @ poses @ turn.T)


def _turns() -> Iterator[tuple[str, Float64Array]]:
    """Yield the 24 frames of right-handed axes, with their rotation to camera 0."""
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.eye(4)
        turn[:3, :3] = 0
        turn[[*order], range(3)] = signs
        if np.linalg.det(turn) > 0:
            names = (
                f'{axis} {_DIRECTIONS[index + (0 if sign > 0 else 3)]}'
                for axis, index, sign in zip('xyz', order, signs, strict=True)
            )
            yield ', '.join(names), turn


def _scales(
    way: Float64Array, result: Float64Array, first: Int64Array, last: Int64Array
) -> Iterator[_Interpretation]:
    """Yield a result of another scale."""
    lengths = _lengths(_motions(result, first, last))
    if not len(lengths) or np.median(lengths) <= 0:
        return
    scale = float(np.median(_lengths(way)) / np.median(lengths))
    if abs(np.log(scale)) > _SAME_SCALE:
        scaled = result.copy()
        scaled[:, :3, 3] *= scale
        yield _Interpretation(
            f'scaled by {scale:.4g}, as that of one camera has to be; give --align sim3', scaled
        )


def _late(
    source: str, numbers: Int64Array, truth: Float64Array, result: Float64Array
) -> Iterator[str]:
    """Yield a note on poses that are those of other frames."""
    if (np.diff(numbers) != 1).any():
        return
    first = np.arange(max(len(truth) - _APART, 0))
    steps = [_motions(poses, first, first + _APART) for poses in (truth, result)]
    best: tuple[float, int] | None = None
    for late in (*range(-_LATEST_FRAMES, 0), *range(1, _LATEST_FRAMES + 1)):
        inside = slice(max(-late, 0), len(steps[0]) - max(late, 0))
        moved = slice(inside.start + late, inside.stop + late)
        if inside.stop - inside.start < _STEPS // 2:
            continue
        own, others = steps[0][inside], steps[1][moved]
        changes = _errors(own, steps[0][moved])
        telling = changes > np.quantile(changes, _TELLING)
        change = Change(
            _errors(own[telling], steps[1][inside][telling]), _errors(own[telling], others[telling])
        )
        middle = float(np.median(change.after))
        if (
            change.explains
            and np.median(change.before) > _LATE_BEFORE
            and middle < _LATE_AFTER
            and (best is None or middle < best[0])
        ):
            best = middle, late
    if best is not None:
        late = best[1]
        yield (
            f'{source}: agrees with the ground truth when each pose is taken as that of'
            f' {abs(late)} frames {"before" if late > 0 else "after"} its own: numbers or stamps'
            ' are off'
        )
