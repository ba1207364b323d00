# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of a trajectory: KITTI's segment errors, APE and RPE."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.locate import locate_bag, looks_like_bag
from ..drawing.labelled_objects import BESIDE, INK, plot_file
from ..files.remote import as_path
from ..messages.naming import FrameNames
from ..model.errors import (
    BadFileError,
    KittiRos2Error,
    Loss,
    MissingPathError,
    NotABagError,
    UsageError,
    describe_frames,
    format_count,
    format_numbers,
)
from ..model.geometry import Transform
from ..model.recording import ScannerMotion
from ..model.samples import NONE
from ..model.streams import NS_PER_S, format_stamp
from ..options.evaluation import ODOMETRY, make_odometry_options
from .ground_truth import truth_of_file, truth_of_folder
from .pose_mistakes import diagnose_keyframes, diagnose_poses
from .trajectories import (
    EXPECTED,
    LENGTHS_M,
    check_evo,
    fit_scale,
    frame_t_cam0,
    path_distances,
    pose_errors,
    read_trajectory,
    rigid,
    rmse,
    segment_errors,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Container, Sequence
    from pathlib import Path

    import numpy.typing as npt
    from typing_extensions import Unpack

    from ..messages.tf_tree import Link
    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Int64Array
    from ..options.evaluation import Alignment, OdometryOptions
    from ..options.keywords import OdometryKeywords
    from ..options.read import ReadOptions
    from .ground_truth import GroundTruth, StampMatch
    from .trajectories import CameraTrajectory, PoseErrors, SegmentErrors

__all__ = ['OdometryScores', 'evaluate_odometry']


# Opening of the ground truth and the result of an evaluation; their kinds are detected.

_EXPECTED = 'a result is a poses file, a TUM file or a bag'


def open_truth(path: Path, read: ReadOptions, options: OdometryOptions) -> GroundTruth:
    """Read a ground truth.

    Raises:
        KittiRos2Error: It cannot be read, or has no poses.
        OSError: It cannot be read.
    """
    if _is_text(path):
        _refuse_gt_topic(path, options)
        return truth_of_file(path, read)
    from ..bags.bag_files import OpenBag  # noqa: PLC0415 - for folders and bags only
    from ..bags.open_source import open_source  # noqa: PLC0415 - as above

    source = open_source(path, read)
    if not isinstance(source, OpenBag):
        _refuse_gt_topic(path, options)
        return truth_of_folder(source)
    from .bag_trajectory import truth_of_bag  # noqa: PLC0415 - for bags only

    with source as bag:
        return truth_of_bag(bag, options)


def _refuse_gt_topic(path: Path, options: OdometryOptions) -> None:
    if options.gt_topic is not None:
        raise UsageError(f'{path}: is no bag; --gt-topic is for a bag')


def open_result(path: Path, options: OdometryOptions, links: Sequence[Link]) -> CameraTrajectory:
    """Read a result, and convert it to camera 0.

    Args:
        path: A file or a bag.
        options: The topic, link and frame.
        links: Static transforms of the ground truth.

    Raises:
        KittiRos2Error: It cannot be read, or has no poses.
        OSError: It cannot be read.
    """
    if not path.exists():
        raise MissingPathError(path)
    if path.is_dir() and not looks_like_bag(path):
        raise UsageError(f'{path}: is a folder without a bag; {_EXPECTED}')
    if not (path.is_dir() or path.is_file()):
        raise UsageError(f'{path}: is no regular file; {_EXPECTED}')
    if _is_text(path):
        if options.topic is not None or options.tf:
            option = '--tf' if options.tf else '--topic'
            raise UsageError(f'{path}: is a file of poses; {option} is for a bag')
        trajectory = read_trajectory(path)
        own: Sequence[Link] = ()
    else:
        trajectory, own = _open_bag_result(path, options)
    frame = (options.frame or trajectory.frame).lstrip('/')
    return trajectory.moved(frame_t_cam0(frame, own, links)) if frame else trajectory


def _refuse_truth(path: Path, read: ReadOptions, options: OdometryOptions) -> None:
    """Refuse a KITTI folder with poses as a result: the arguments are exchanged.

    Raises:
        UsageError: It is one.
    """
    if not path.is_dir() or looks_like_bag(path):
        return
    try:
        open_truth(path, read, options)
    except (KittiRos2Error, OSError):
        return
    raise UsageError(f'{path}: is a KITTI folder with poses; give GT first, then RESULT')


def _open_bag_result(
    path: Path, options: OdometryOptions
) -> tuple[CameraTrajectory, Sequence[Link]]:
    """Read a result in a bag, and the static transforms of the bag."""
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - for bags only
    from .bag_trajectory import choose_result, read_poses, survey_poses  # noqa: PLC0415 - as above

    with open_bag_source(path) as bag:
        survey = survey_poses(bag)
        plan = choose_result(bag, survey, options)
        trajectory = read_poses(bag, survey, plan)
    if plan.body or options.frame is not None:
        return trajectory, survey.static
    frame = FrameNames().base
    note = f'{plan.topic}: does not name its frame, taken as {frame}; see --frame'
    return replace(trajectory, frame=frame, notes=(*trajectory.notes, note)), survey.static


def _is_text(path: Path) -> bool:
    """Return whether a path is a file and no bag.

    Raises:
        BadFileError: It is empty.
        OSError: It cannot be read.
    """
    if not path.is_file():
        return False
    if not path.stat().st_size:
        raise BadFileError(path, 'is empty', f'a bag, or {EXPECTED}')
    try:
        locate_bag(path)
    except NotABagError:
        return True
    return False


# Poses of a result and frames of a ground truth, matched by frame number or by stamp.

_LONGEST_RELATIVE_NS = 100_000_000 * NS_PER_S
"""Smaller stamps, of the first three years after 1970, count from the start of a recording."""


_SAME_NS = 10_000
"""Tolerance for rounded stamps: 0.3 mm at 30 m/s."""


@dataclass(frozen=True, eq=False)
class FrameMatch:
    """The pose of each frame.

    Attributes:
        indices: (N,) index of the pose of each frame of the ground truth, NONE where it has none.
        by: The criterion of the match, for users.
        offsets_ns: (N,) how much later than its frame each pose is; None without stamps.
        losses: Frames without a pose, and poses without a frame.
        notes: One line each.
    """

    indices: Int64Array
    by: str
    offsets_ns: Int64Array | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def matched(self) -> npt.NDArray[np.bool_]:
        """(N,) which frames have a pose."""
        matched: npt.NDArray[np.bool_] = self.indices != NONE
        return matched


def match_result(
    truth: GroundTruth,
    numbers: Int64Array,
    result: CameraTrajectory,
    tolerance_ns: int | None,
    scored: npt.NDArray[np.bool_],
) -> FrameMatch:
    """Match a result to the frames of a ground truth.

    Each frame without a pose is a loss: a late start is not distinguished from a failure of the
    stack. So is a pose with the number of no frame. Poses with other stamps are a note, since
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
        match = _by_number(truth, numbers, result)
    else:
        match = _by_stamp(truth, numbers, result, tolerance_ns)
    if not scored.all():
        shown = format_numbers(numbers[scored].tolist()) or 'none of the ground truth'
        if not (match.matched & scored).any():
            raise UsageError(f'{result.source}: no pose of the frames to score, {shown}')
        match = replace(match, notes=(*match.notes, f'scored are frames {shown} only'))
    missing = numbers[scored & ~match.matched].tolist()
    if not missing:
        return match
    loss = Loss('result', len(missing), f'{result.source}: no pose of frames {{}}', tuple(missing))
    return replace(match, losses=(loss, *match.losses))


def _by_number(truth: GroundTruth, numbers: Int64Array, result: CameraTrajectory) -> FrameMatch:
    result_numbers, source = np.asarray(result.numbers), result.source
    notes = _check_lines(numbers, result) if truth.listed else ()
    nearest = np.minimum(np.searchsorted(result_numbers, numbers), len(result_numbers) - 1)
    indices = np.where(result_numbers[nearest] == numbers, nearest, NONE)
    if (indices == NONE).all():
        raise UsageError(
            f'{source}: has {describe_frames(result_numbers)}; the ground truth has'
            f' {describe_frames(numbers)}, and none in common'
        )
    others = tuple(np.setdiff1d(result_numbers, numbers).tolist())
    text = f'{source}: the ground truth has no frames {{}}'
    if others and truth.listed:
        notes = (*notes, f'{text.format(format_numbers(others))}; they are not scored')
    losses = (Loss('result', len(others), text, others),) if others and not truth.listed else ()
    return FrameMatch(indices, 'frame number', losses=losses, notes=notes)


def _check_lines(numbers: Int64Array, result: CameraTrajectory) -> tuple[str, ...]:
    """Check that the lines of a result can be frames, where the ground truth lacks some.

    Raises:
        UsageError: There are fewer lines than frames: which they are is not known.
    """
    frames = int(numbers[-1]) + 1
    if not result.by_line or np.array_equal(numbers, range(frames)):
        return ()
    if len(result) < frames:
        raise UsageError(
            f'{result.source}: {format_count(len(result), "pose")} without frame numbers, and the'
            f' ground truth lists {describe_frames(numbers)}, {len(numbers)} of {frames}: which'
            f' line is which frame is not known; write the frame number first in each line'
        )
    return (f'{result.source}: has no frame numbers; line n, from 0, is taken as frame n',)


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
    match = frames.match(stamps_ns, tolerance_ns)
    frame_indices, used = _nearest_poses(numbers, match)
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
    indices[frame_indices], offsets_ns[frame_indices] = used, match.offsets_ns[used]
    by = f'stamp, at most {np.abs(offsets_ns).max() / 1e6:.1f} ms apart'
    if match.stamped_at:
        by = f'stamp ({match.stamped_at})'
    true_ns = truth.trajectory.stamps_ns
    if true_ns is not None and (np.diff(true_ns) <= 0).any():
        text = 'stamps are not ascending; poses are compared with those of their frames as they are'
        notes.append(f'{truth.trajectory.source}: {text}')
        return FrameMatch(indices, by, notes=tuple(notes))
    return FrameMatch(indices, by, offsets_ns, notes=tuple(notes))


def _nearest_poses(numbers: Int64Array, match: StampMatch) -> tuple[Int64Array, Int64Array]:
    """Return the indices of the frames that have poses, and the nearest pose of each."""
    frame_indices = np.minimum(np.searchsorted(numbers, match.numbers), len(numbers) - 1)
    order = np.argsort(np.abs(match.offsets_ns), kind='stable')
    order = order[numbers[frame_indices[order]] == match.numbers[order]]
    posed, first = np.unique(frame_indices[order], return_index=True)
    return posed, order[first]


def poses_at_frames(
    truth: CameraTrajectory, match: FrameMatch, result: CameraTrajectory
) -> Float64Array:
    """Return (N, 4, 4) poses of a result at the frames of a ground truth.

    A pose is valid at its stamp, which may differ from that of its frame: the
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
        for index in moved.tolist():
            frame_ns = int(truth.stamps_ns[index])
            stamp_ns = frame_ns + int(match.offsets_ns[index])
            poses[index] = poses[index] @ motion.relative(stamp_ns, frame_ns)
    return poses


def _span(stamps_ns: Int64Array) -> str:
    return f'{format_stamp(int(stamps_ns[0]))} to {format_stamp(int(stamps_ns[-1]))}'


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
        alignment: Alignment of the result for APE and RPE; segments have its scale, too.
        matched_by: The criterion by which poses and frames were matched.
        losses: Missing or unusable data.
        notes: One line each.
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
        options: Options of `kitti-ros2 eval odometry --help-all`, with the same defaults:
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
    from ..api.arguments import by_name, warn_of  # noqa: PLC0415 - for the library only

    read, chosen = make_odometry_options(by_name(options, ODOMETRY))
    scores = score_odometry(as_path(ground_truth), as_path(result), read, chosen, frames)
    warn_of(scores.losses)
    return scores


def score_odometry(
    ground_truth: Path,
    result: Path,
    read: ReadOptions,
    options: OdometryOptions,
    frames: Container[int] | None = None,
) -> OdometryScores:
    """Score a trajectory; see evaluate_odometry."""
    check_evo()
    truth = open_truth(ground_truth, read, options)
    _refuse_truth(result, read, options)
    trajectory = open_result(result, options, truth.links)
    poses, numbers = truth.trajectory.poses, truth.trajectory.numbers
    if numbers is None:
        numbers = np.arange(len(poses), dtype=np.int64)
    scored = np.array([frames is None or number in frames for number in numbers.tolist()])
    match = match_result(truth, numbers, trajectory, options.tolerance_ns, scored)
    numbers, poses, posed = numbers[scored], poses[scored], match.matched[scored]
    at_frames, scale = _scaled_poses(truth, match, trajectory, scored, options.align)
    segments = segment_errors(numbers, poses, at_frames, posed)
    errors = pose_errors(numbers[posed], poses[posed], at_frames[posed], options.align)
    errors = replace(errors, scale=errors.scale * scale)
    distances = path_distances(poses)
    short = _note_short(segments, float(distances[-1]))
    mistakes = _mistakes(truth, trajectory, numbers[posed], poses[posed], at_frames[posed])
    return OdometryScores(
        truth.name,
        truth.trajectory.source,
        trajectory.source,
        numbers,
        posed,
        poses[:, :3, 3],
        distances,
        segments,
        errors,
        options.align,
        match.by,
        (*truth.trajectory.losses, *trajectory.losses, *match.losses),
        (*truth.trajectory.notes, *trajectory.notes, *match.notes, *short, *mistakes),
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
    scale, posed = 1.0, scored & match.matched
    for _ in range(_SCALE_STEPS if alignment.has_scale else 0):
        step = fit_scale(truth.trajectory.poses[posed], at_frames[posed], alignment)
        scale, result = scale * step, result.scaled(step)
        at_frames = poses_at_frames(truth.trajectory, match, result)
        if abs(step - 1) < _SAME_SCALE:
            break
    return at_frames[scored], scale


def _mistakes(
    truth: GroundTruth,
    result: CameraTrajectory,
    numbers: Int64Array,
    poses: Float64Array,
    at_frames: Float64Array,
) -> Sequence[str]:
    """Return notes on the usual mistakes in a result, given N matched poses of both."""
    by_line = result.numbers is not None and np.array_equal(result.numbers, range(len(result)))
    if by_line:
        notes = [*diagnose_keyframes(result.source, truth.trajectory.poses, result.poses)]
        if notes:
            return notes
    return [*diagnose_poses(result.source, numbers, poses, at_frames)]


def _note_short(segments: SegmentErrors, length_m: float) -> tuple[str, ...]:
    """Return a note with the reason if there are no KITTI segments."""
    if len(segments):
        return ()
    reason = f'the ground truth is {length_m:.1f} m long, and the shortest {LENGTHS_M[0]} m'
    if segments.left_out:
        reason = f'all {segments.left_out} have no pose at their first or their last frame'
    return (f"there are no segments of KITTI's: {reason}",)


# Drawing of a scored trajectory: the paths from above, and the errors.
#
# Axes are those of matplotlib.

_INCHES = (10.0, 6.6)
_RESULT = '#c8502b'
_PLACES = (('path', 't'), ('path', 'r'), ('ape', 'ape'))
_SPEEDS_M_S = np.arange(2, 25, 2)
_SPEED_RANGE_M_S = 2.0
_LEAST = 3
"""Means are of the segments within 2 m/s of a speed, and of 3 segments at least, as in
saveErrorPlots of evaluate_odometry.cpp."""


def draw_odometry(scores: OdometryScores, path: Path) -> None:
    """Draw the paths from above, KITTI's errors by length and speed, and APE along the path.

    Args:
        scores: The scores.
        path: The picture: .png, .pdf or .svg.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    with plot_file(path, _INCHES) as figure:
        axes = figure.subplot_mosaic([*map(list, _PLACES)], height_ratios=(1, 1, 0.6))
        figure.suptitle(_heading(scores), size=11, weight='bold')
        _draw_paths(axes['path'], scores)
        _draw_means(axes['t'], scores.segments, 'translation, %', lambda part: part.t_err_percent)
        _draw_means(
            axes['r'], scores.segments, 'rotation, deg/m', lambda part: part.r_err_deg_per_m
        )
        _draw_ape(axes['ape'], scores)


def _heading(scores: OdometryScores) -> str:
    parts = [f'{scores.name}, {scores.distances_m[-1]:,.0f} m']
    if scores.t_err_percent is not None and scores.r_err_deg_per_m is not None:
        parts.append(f'{scores.t_err_percent:.2f} %')
        parts.append(f'{scores.r_err_deg_per_m:.4f} deg/m')
    if scores.ape_m is not None:
        parts.append(f'APE {scores.ape_m:.2f} m')
    if scores.alignment.has_scale:
        parts.append(f'scale {scores.errors.scale:.6g}')
    return ', '.join(parts)


def _at_frames(scores: OdometryScores, values: Float64Array) -> Float64Array:
    """Return values of the frames with a result at all frames, NaN between them."""
    padded = np.full((len(scores.known), *values.shape[1:]), np.nan)
    padded[scores.known] = values
    return padded


def _draw_paths(axes: Any, scores: OdometryScores) -> None:  # noqa: ANN401
    """Draw both paths from above: x of camera 0 to the right, z up."""
    axes.plot(*scores.positions[:, [0, 2]].T, color=INK, linewidth=1.4, label='ground truth')
    aligned = _at_frames(scores, scores.errors.positions)
    aligned_as = f'result (align {scores.alignment.value})'
    axes.plot(*aligned[:, [0, 2]].T, color=_RESULT, linewidth=1.0, label=aligned_as)
    axes.plot(*scores.positions[0, [0, 2]], 'o', color=INK, markersize=4, label='start')
    missing = scores.positions[~scores.known]
    if len(missing):
        axes.plot(*missing[:, [0, 2]].T, '.', color='#9a9a9a', markersize=3, label='no result')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set_xlabel('x, m')
    axes.set_ylabel('z, m')
    axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncols=4, borderaxespad=0)


def _draw_means(
    axes: Any,  # noqa: ANN401 - as above
    segments: SegmentErrors,
    title: str,
    mean: Callable[[SegmentErrors], float | None],
) -> None:
    """Draw a mean error by length of the segments, and by speed on a second axis."""
    axes.set_title(title, loc='left')
    axes.set_xlabel('length of the segments, m')
    if not len(segments):
        axes.text(0.5, 0.5, 'no segment', ha='center', transform=axes.transAxes)
        return
    by_length = [segments.of_length(length) for length in LENGTHS_M]
    near = (np.abs(segments.speeds_m_s - speed) < _SPEED_RANGE_M_S for speed in _SPEEDS_M_S)
    by_speed = [segments.chosen(mask) for mask in near]
    means, means_by_speed = (
        [np.nan if len(part) < _LEAST else mean(part) for part in parts]
        for parts in (by_length, by_speed)
    )
    axes.plot(LENGTHS_M, means, 'o-', color=_RESULT, markersize=3, label='by length')
    speeds = axes.twiny()
    speeds.plot(_SPEEDS_M_S, means_by_speed, 's--', color=INK, markersize=3, linewidth=0.8)
    axes.plot([], [], 's--', color=INK, markersize=3, linewidth=0.8, label='by speed')
    speeds.set_xlabel('speed, m/s', loc='right')
    speeds.grid(visible=False)
    speeds.spines['top'].set_visible(True)
    axes.set_ylim(bottom=0)
    axes.legend(**BESIDE)


def _draw_ape(axes: Any, scores: OdometryScores) -> None:  # noqa: ANN401 - as above
    errors = _at_frames(scores, scores.errors.ape_m)
    axes.plot(scores.distances_m, errors, color=_RESULT, linewidth=1.0)
    axes.set_title('APE, m', loc='left')
    axes.set_xlabel('distance along the ground truth, m')
    axes.set_ylim(bottom=0)
    axes.margins(x=0.01)
