# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a result and frames of a ground truth, matched by frame number or by stamp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..importer.sync import NONE, default_tolerance_ns, match_frames
from ..model.errors import UsageError
from ..model.losses import Loss, describe_frames
from ..model.stamps import NS_PER_S, format_stamp

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Int64Array
    from .ground_truth_poses import GroundTruth
    from .trajectories import CameraTrajectory

_LONGEST_RELATIVE_NS = 100_000_000 * NS_PER_S
"""Stamps of the first three years after 1970 count from the start of a recording."""


@dataclass(frozen=True, eq=False)
class FrameMatch:
    """The pose of each frame.

    Attributes:
        indices: (N,) index of the pose of each frame of the ground truth, NONE where it has none.
        by: What they are matched by, for users.
        losses: Frames without a pose, and poses without a frame.
        notes: Remarks that are no loss.
    """

    indices: Int64Array
    by: str
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """(N,) which frames have a pose."""
        found: npt.NDArray[np.bool_] = self.indices != NONE
        return found


def match_result(
    truth: GroundTruth, numbers: Int64Array, result: CameraTrajectory, tolerance_ns: int | None
) -> FrameMatch:
    """Match a result to the frames of a ground truth.

    Args:
        truth: The ground truth.
        numbers: (N,) its frame numbers.
        result: The result, with numbers or stamps.
        tolerance_ns: Largest accepted difference of stamps; None is half the period.

    Raises:
        UsageError: No pose belongs to a frame, or the ground truth has no stamps.
    """
    if result.numbers is not None:
        found = _by_number(numbers, result.numbers, result.source)
    else:
        found = _by_stamp(truth, result, tolerance_ns)
    missing = numbers[~found.known].tolist()
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
    return FrameMatch(indices, 'frame number', losses)


def _by_stamp(truth: GroundTruth, result: CameraTrajectory, tolerance_ns: int | None) -> FrameMatch:
    frames_ns, stamps_ns = truth.trajectory.stamps_ns, result.stamps_ns
    if frames_ns is None or stamps_ns is None:
        raise UsageError(
            f'{truth.trajectory.source}: has no time stamps, which {result.source} is matched by;'
            f' give the folder of the sequence, with times.txt, or its bag as ground truth'
        )
    notes = []
    if truth.epoch_ns is not None and int(stamps_ns[-1]) < _LONGEST_RELATIVE_NS:
        stamps_ns = stamps_ns + truth.epoch_ns
        notes.append(f'{result.source}: stamps are taken as seconds from the start of the sequence')
    if tolerance_ns is None:
        tolerance_ns = default_tolerance_ns(frames_ns)
    match = match_frames(frames_ns, {'result': stamps_ns}, tolerance_ns)['result']
    if not match.matched:
        raise UsageError(
            f'{result.source}: no pose within {tolerance_ns / NS_PER_S:.3f} s of a frame; its'
            f' stamps are {_span(stamps_ns)}, those of the ground truth {_span(frames_ns)}; see'
            f' --tolerance, and --epoch of sequences without absolute time'
        )
    if match.dropped:
        notes.append(f'{result.source}: {match.dropped} poses are of no frame, and not used')
    return FrameMatch(
        match.indices, f'stamp, at most {match.max_error_ns / 1e6:.1f} ms apart', (), tuple(notes)
    )


def _span(stamps_ns: Int64Array) -> str:
    return f'{format_stamp(int(stamps_ns[0]))} to {format_stamp(int(stamps_ns[-1]))}'
