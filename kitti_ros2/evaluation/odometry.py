# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of a trajectory: KITTI's segment errors, APE and RPE."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..files.remote import as_path
from ..options.evaluation_tables import ODOMETRY, make_odometry_options
from .frame_matching import match_result, poses_at_frames
from .open_trajectories import open_result, open_truth
from .pose_errors import check_evo, fit_scale, pose_errors, rmse
from .segment_errors import LENGTHS_M, path_distances, segment_errors

if TYPE_CHECKING:
    import os
    from collections.abc import Container
    from pathlib import Path

    import numpy.typing as npt
    from typing_extensions import Unpack

    from ..api.keywords import OdometryKeywords
    from ..model.geometry import Float64Array
    from ..model.losses import Loss
    from ..model.samples import Float32Array, Int64Array
    from ..options.eval_odometry import Alignment, OdometryOptions
    from ..options.read import ReadOptions
    from .frame_matching import FrameMatch
    from .ground_truth_poses import GroundTruth
    from .pose_errors import PoseErrors
    from .segment_errors import SegmentErrors
    from .trajectories import CameraTrajectory

__all__ = ['OdometryScores', 'evaluate_odometry']

_SCALE_STEPS = 5
_SAME_SCALE = 1e-9


@dataclass(frozen=True, eq=False)
class OdometryScores:
    """The scores of a trajectory.

    Attributes:
        name: Sequence or drive of the ground truth, such as 09.
        ground_truth, result: Descriptions of both.
        numbers: (N,) frame numbers of the ground truth, of the frames to score.
        known: (N,) which of them have a result.
        positions: (N, 3) of the ground truth, in its first camera 0, metres.
        distances_m: (N,) along the ground truth up to each frame.
        segments: KITTI's segment errors.
        errors: APE and RPE of the frames with a result.
        alignment: How the result was aligned for APE and RPE; segments have its scale, too.
        matched_by: What poses and frames were matched by.
        losses: What was missing or could not be used.
        notes: Remarks that are no loss.
    """

    name: str
    ground_truth: str
    result: str
    numbers: Int64Array
    known: npt.NDArray[np.bool_]
    positions: Float64Array
    distances_m: Float32Array
    segments: SegmentErrors
    errors: PoseErrors
    alignment: Alignment
    matched_by: str
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def t_err_percent(self) -> float | None:
        """KITTI's translation error in percent; None without a segment."""
        return self.segments.t_err_percent

    @property
    def r_err_deg_per_m(self) -> float | None:
        """KITTI's rotation error in degrees per metre; None without a segment."""
        return self.segments.r_err_deg_per_m

    @property
    def ape_m(self) -> float | None:
        """Absolute pose error of the translation, root mean square, metres."""
        return rmse(self.errors.ape_m)

    @property
    def rpe_m(self) -> float | None:
        """Relative pose error from frame to frame, the same; None without two neighbours."""
        return rmse(self.errors.rpe_m)


def evaluate_odometry(
    ground_truth: str | os.PathLike[str],
    result: str | os.PathLike[str],
    *,
    frames: Container[int] | None = None,
    **options: Unpack[OdometryKeywords],
) -> OdometryScores:
    """Score a trajectory as KITTI's odometry benchmark does, and with APE and RPE.

    Args:
        ground_truth: A poses file, the folder of a sequence or drive, or a bag.
        result: A poses file (12 columns, or 13 with the frame number first), a TUM file or a bag.
        frames: Numbers of the frames to score, such as those that were played; None is all. Only
            these are losses if they have no pose.
        options: Those of `kitti-ros2 eval odometry --help`, with the same defaults:
            topic='/odom', tf=['odom', 'base_link'], frame='velo_link', align='se3',
            tolerance=0.02, sequence='09'.

    Returns:
        The scores; each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: A path cannot be read, an option is invalid, or no pose has a frame.

    Examples:
        >>> from kitti_ros2.evaluation import evaluate_odometry
        >>> evaluate_odometry('odometry/poses/00.txt', 'my_00.txt').ape_m  # doctest: +SKIP
        1.273
    """
    from ..api.keywords import by_name  # noqa: PLC0415 - for the library only
    from ..api.source import warn  # noqa: PLC0415 - as above

    read, chosen = make_odometry_options(by_name(options, ODOMETRY))
    scores = score_trajectory(as_path(ground_truth), as_path(result), read, chosen, frames)
    for loss in scores.losses:
        warn(loss.text())
    return scores


def score_trajectory(
    ground_truth: Path,
    result: Path,
    read: ReadOptions,
    options: OdometryOptions,
    frames: Container[int] | None = None,
) -> OdometryScores:
    """Score a trajectory; see evaluate_odometry."""
    check_evo()
    truth = open_truth(ground_truth, read, options)
    found = open_result(result, options, truth.links)
    poses, numbers = truth.trajectory.poses, truth.trajectory.numbers
    if numbers is None:
        numbers = np.arange(len(poses), dtype=np.int64)
    scored = np.array([frames is None or number in frames for number in numbers.tolist()])
    match = match_result(truth, numbers, found, options.tolerance_ns, scored)
    numbers, poses, known = numbers[scored], poses[scored], match.known[scored]
    at_frames, scale = _scaled_poses(truth, match, found, scored, options.align)
    segments = segment_errors(numbers, poses, at_frames, known)
    errors = pose_errors(numbers[known], poses[known], at_frames[known], options.align)
    errors = replace(errors, scale=errors.scale * scale)
    distances = path_distances(poses)
    short = _note_short(segments, float(distances[-1]))
    return OdometryScores(
        truth.name,
        truth.trajectory.source,
        found.source,
        numbers,
        known,
        poses[:, :3, 3],
        distances,
        segments,
        errors,
        options.align,
        match.by,
        (*truth.trajectory.losses, *found.losses, *match.losses),
        (*truth.trajectory.notes, *found.notes, *match.notes, *short),
    )


def _scaled_poses(
    truth: GroundTruth,
    match: FrameMatch,
    result: CameraTrajectory,
    scored: npt.NDArray[np.bool_],
    alignment: Alignment,
) -> tuple[Float64Array, float]:
    """Return (N, 4, 4) poses of a result at the frames to score, scaled, and their scale.

    The way to camera 0 and the motion from a stamp to its frame are metres: they are applied to
    scaled poses, so that the scale is found in steps.
    """
    at_frames = poses_at_frames(truth.trajectory, match, result)
    scale, kept = 1.0, scored & match.known
    for _ in range(_SCALE_STEPS if alignment.has_scale else 0):
        step = fit_scale(truth.trajectory.poses[kept], at_frames[kept], alignment)
        scale, result = scale * step, result.scaled(step)
        at_frames = poses_at_frames(truth.trajectory, match, result)
        if abs(step - 1) < _SAME_SCALE:
            break
    return at_frames[scored], scale


def _note_short(segments: SegmentErrors, length_m: float) -> tuple[str, ...]:
    """Return the reason why there are no figures of KITTI's, if there are none."""
    if len(segments):
        return ()
    reason = f'the ground truth is {length_m:.1f} m long, and the shortest {LENGTHS_M[0]} m'
    if segments.left_out:
        reason = f'all {segments.left_out} have no pose at their first or their last frame'
    return (f"there are no segments of KITTI's: {reason}",)
