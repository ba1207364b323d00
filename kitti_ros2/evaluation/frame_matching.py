# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a result and frames of a ground truth, matched by frame number or by stamp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..importer.sync import NONE
from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.losses import Loss, describe_frames, format_numbers
from ..model.scanner_motion import ScannerMotion
from ..model.stamps import NS_PER_S, format_stamp
from ..model.text import format_count
from .pose_errors import rigid

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .frame_stamps import StampMatch
    from .ground_truth_poses import GroundTruth
    from .trajectories import CameraTrajectory

_LONGEST_RELATIVE_NS = 100_000_000 * NS_PER_S
"""Stamps of the first three years after 1970 count from the start of a recording."""


_SAME_NS = 10_000
"""A stamp that was rounded so far is that of its frame: 0.3 mm at 30 m/s."""


@dataclass(frozen=True, eq=False)
class FrameMatch:
    """The pose of each frame.

    Attributes:
        indices: (N,) index of the pose of each frame of the ground truth, NONE where it has none.
        by: What they are matched by, for users.
        offsets_ns: (N,) how much later than its frame each pose is; None without stamps.
        losses: Frames without a pose, and poses without a frame.
        notes: Remarks that are no loss.
    """

    indices: Int64Array
    by: str
    offsets_ns: Int64Array | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """(N,) which frames have a pose."""
        found: npt.NDArray[np.bool_] = self.indices != NONE
        return found


def match_result(
    truth: GroundTruth,
    numbers: Int64Array,
    result: CameraTrajectory,
    tolerance_ns: int | None,
    scored: npt.NDArray[np.bool_],
) -> FrameMatch:
    """Match a result to the frames of a ground truth.

    Each frame without a pose is a loss: a result that begins late is not told from one of a stack
    that failed. So is a pose with the number of no frame. Poses with other stamps are a note, since
    odometry at a higher rate has them between frames.

    Args:
        truth: The ground truth.
        numbers: (N,) its frame numbers.
        result: The result, with numbers or stamps.
        tolerance_ns: Largest accepted difference of stamps; None is half the period.
        scored: (N,) the frames that a pose is expected of.

    Raises:
        UsageError: No pose belongs to a frame to score, or the ground truth has no stamps.
    """
    if result.numbers is not None:
        found = _by_number(numbers, result.numbers, result.source)
    else:
        found = _by_stamp(truth, numbers, result, tolerance_ns)
    if not scored.all():
        shown = format_numbers(numbers[scored].tolist()) or 'none of the ground truth'
        if not (found.known & scored).any():
            raise UsageError(f'{result.source}: no pose of the frames to score, {shown}')
        found = replace(found, notes=(*found.notes, f'scored are frames {shown} only'))
    missing = numbers[scored & ~found.known].tolist()
    if not missing:
        return found
    loss = Loss('result', len(missing), f'{result.source}: no pose of frames {{}}', tuple(missing))
    return replace(found, losses=(loss, *found.losses))


def _by_number(numbers: Int64Array, given: Int64Array, source: str) -> FrameMatch:
    places = np.minimum(np.searchsorted(given, numbers), len(given) - 1)
    indices = np.where(given[places] == numbers, places, NONE)
    if (indices == NONE).all():
        raise UsageError(
            f'{source}: has {describe_frames(given)}; the ground truth has'
            f' {describe_frames(numbers)}, and none in common'
        )
    others = tuple(np.setdiff1d(given, numbers).tolist())
    text = f'{source}: the ground truth has no frames {{}}'
    losses = (Loss('result', len(others), text, others),) if others else ()
    return FrameMatch(indices, 'frame number', losses=losses)


def _by_stamp(
    truth: GroundTruth, numbers: Int64Array, result: CameraTrajectory, tolerance_ns: int | None
) -> FrameMatch:
    frames, stamps_ns = truth.frames, result.stamps_ns
    if frames is None or stamps_ns is None:
        raise UsageError(
            f'{truth.trajectory.source}: has no time stamps, which {result.source} is matched by;'
            f' give the folder of the sequence, with times.txt, or its bag as ground truth'
        )
    notes = []
    if truth.epoch_ns is not None and int(stamps_ns[-1]) < _LONGEST_RELATIVE_NS:
        stamps_ns = stamps_ns + truth.epoch_ns
        notes.append(f'{result.source}: stamps are taken as seconds from the start of the sequence')
    found = frames.match(stamps_ns, tolerance_ns)
    places, used = _nearest_poses(numbers, found)
    if not len(used):
        tolerance_s = (frames.tolerance_ns if tolerance_ns is None else tolerance_ns) / NS_PER_S
        raise UsageError(
            f'{result.source}: no pose within {tolerance_s:.3f} s of a frame; its stamps are'
            f' {_span(stamps_ns)}, those of the ground truth {_span(frames.stamps_ns)}; see'
            f' --tolerance, and --epoch of sequences without absolute time'
        )
    unused = len(stamps_ns) - len(used)
    if unused:
        notes.append(
            f'{result.source}: {format_count(unused, "pose")} of no frame, or not the nearest of'
            f' one, not used'
        )
    indices, offsets_ns = np.full((2, len(numbers)), [[NONE], [0]], dtype=np.int64)
    indices[places], offsets_ns[places] = used, found.offsets_ns[used]
    by = f'stamp, at most {np.abs(offsets_ns).max() / 1e6:.1f} ms apart'
    if found.moment:
        by = f'stamp ({found.moment})'
    true_ns = truth.trajectory.stamps_ns
    if true_ns is not None and (np.diff(true_ns) <= 0).any():
        text = 'stamps are not ascending; poses are compared with those of their frames as they are'
        notes.append(f'{truth.trajectory.source}: {text}')
        return FrameMatch(indices, by, notes=tuple(notes))
    return FrameMatch(indices, by, offsets_ns, notes=tuple(notes))


def _nearest_poses(numbers: Int64Array, found: StampMatch) -> tuple[Int64Array, Int64Array]:
    """Return the places of the frames that have poses, and the nearest pose of each."""
    places = np.minimum(np.searchsorted(numbers, found.numbers), len(numbers) - 1)
    order = np.argsort(np.abs(found.offsets_ns), kind='stable')
    order = order[numbers[places[order]] == found.numbers[order]]
    known, first = np.unique(places[order], return_index=True)
    return known, order[first]


def poses_at_frames(
    truth: CameraTrajectory, match: FrameMatch, result: CameraTrajectory
) -> Float64Array:
    """Return (N, 4, 4) poses of a result at the frames of a ground truth.

    A pose is that of the moment of its stamp, which may be another one than that of its frame: the
    start of the scanner's turn is half a turn earlier. So it is moved along with the truth, by the
    true motion from its stamp to the frame, which is to compare it with the truth at its stamp. The
    result itself is not interpolated, and frames without a pose remain without.

    The true velocity is that of the ground truth's steps at their middles, linear between, constant
    beyond. At the starts of turns on the synthetic street (8 m/s) a perfect result then has an
    error of 0.0007 %, at most 0.2 mm; taken as the pose of its frame, 0.25 % and 0.10 m.

    Args:
        truth: N poses.
        match: The pose of each of the N frames.
        result: The poses.
    """
    poses = result.poses[match.indices]
    if match.offsets_ns is None or truth.stamps_ns is None or len(truth) < 2:
        return poses
    moved = np.flatnonzero(np.abs(match.offsets_ns) > _SAME_NS)
    if len(moved):
        steps = [Transform.from_matrix(pose) for pose in rigid(truth.poses)]
        motion = ScannerMotion.from_poses(truth.stamps_ns.tolist(), steps)
        for place in moved.tolist():
            frame_ns = int(truth.stamps_ns[place])
            stamp_ns = frame_ns + int(match.offsets_ns[place])
            poses[place] = poses[place] @ motion.relative(stamp_ns, frame_ns)
    return poses


def _span(stamps_ns: Int64Array) -> str:
    return f'{format_stamp(int(stamps_ns[0]))} to {format_stamp(int(stamps_ns[-1]))}'
