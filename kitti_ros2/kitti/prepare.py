# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options applied to an opened recording: motion compensation, stereo pairs, predictions."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np

from ..model.errors import (
    KittiRos2Error,
    Loss,
    MissingDataError,
    UsageError,
    describe_frames,
    format_count,
    format_numbers,
)
from ..model.geometry import Transform
from ..model.recording import (
    Deskew,
    ScannerMotion,
    StreamIndex,
    compensate,
    make_twist,
    move_rigidly,
    twist_of,
    undo_compensation,
)
from ..model.samples import LEFT_OF, Turn
from ..model.streams import FRAME_STREAMS, IMAGE_STREAMS, Stream
from .label_file import ResultFiles
from .scan_grid import find_measured

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.recording import MovingRecording
    from ..model.samples import Int64Array, Pose, Scan
    from ..options.read import SelectionOptions
    from .kitti_recording import KittiRecording


# Motion compensation of the scans of a recording, and its reverse.
#
# The motion is that of the oxts packets near the turn: their velocities and rates of turn, since
# the positions jump (in drive 0005 their differences are 0.19 m/s off the measured velocity in the
# median, and up to 0.90 m/s). Odometry has poses alone: there the motion is that of the steps
# between neighbouring poses. Before the first and after the last, the nearest twist goes on.
#
# Every time of a turn must be within two turns (0.2 s) of a packet or pose.

CHANGES_NOTHING = 'changes nothing'
"""In notes on options of this file."""
_REACH_TURNS = 2
_FEWEST_POSES = 2  # which have no velocity, unlike a packet
_FASTEST_M_S = 100.0
_FASTEST_RAD_S = 10.0
_KITTI_TURN_NS = 100_000_000
"""The turn by which KITTI compensated, though the scanner took 0.1036 s."""
_MOST_UNREADABLE = 10
_BY_POSES = (
    "points do not come to lie on KITTI's grid of 1 mm: their compensation is undone by the poses,"
    ' up to some millimetres off'
)


def prepare_motion(recording: KittiRecording) -> None:
    """Make a recording return its scans as its options request: compensated, or as measured.

    Scans without packets or poses near their turn are left out, as a loss.

    Raises:
        MissingDataError: No scan has any.
    """
    options, compensated = recording.options, recording.layout.traits.compensated_scans
    if not (options.deskew or options.undo_deskew) or Stream.SCAN not in recording.streams:
        return
    if options.deskew is compensated:
        how = 'compensated for motion by KITTI' if compensated else 'as measured'
        option = 'deskew' if options.deskew else 'undo_deskew'
        recording.notes.append(
            f'{option} {CHANGES_NOTHING}: scans of layout {recording.layout.value} are {how}'
        )
        return
    if options.undo_deskew:
        _prepare_undoing(recording)
    else:
        _leave_out_uncovered(recording)
        turns = dict(recording.turns)
        first = int(recording.streams[Stream.SCAN].numbers[0])
        if 'velo_T_imu' in recording.calibration(first).nominal:
            recording.notes.append(
                'deskew takes a nominal velo_T_imu, which the calibration does not contain'
            )
        recording.deskew = Deskew.ON
        recording.adjust_scan = partial(_compensated, recording, turns)
        recording.turns = {}


def _prepare_undoing(recording: KittiRecording) -> None:
    """Make a recording return its scans as measured: from KITTI's grid, or by its poses.

    Raises:
        MissingDataError: Its first scan is not on the grid, and there are no poses near any.
    """
    if _is_on_grid(recording):
        recording.adjust_scan = partial(_as_measured, recording)
    else:
        _leave_out_uncovered(recording)
        recording.notes.append(f'undo_deskew: {_BY_POSES}')
        recording.adjust_scan = partial(_moved_back, recording)
    recording.deskew = Deskew.UNDO


def _is_on_grid(recording: KittiRecording) -> bool:
    """Return whether the first scan that can be read can be taken back to KITTI's grid."""
    for number in recording.streams[Stream.SCAN].numbers[:_MOST_UNREADABLE].tolist():
        try:
            scan = cast('Scan', recording.read(Stream.SCAN, number))
        except (KittiRos2Error, OSError):
            continue  # a loss of the command that reads it
        return find_measured(scan.points, _start_of(recording, number)) is not None
    return False


def scan_at(recording: MovingRecording, number: int, to_ns: int) -> Scan:
    """Read a scan with its points as they would have been measured at one time.

    Raises:
        MissingDataError: There are no packets or poses near its turn and the time, or the time of
            the points is not known.
        KittiRos2Error: The scan cannot be read.
        OSError: The same.
    """
    scan = cast('Scan', recording.read(Stream.SCAN, number))
    if scan.turn is not None:
        motion = _motion(recording, number, scan.turn, to_ns)
        return replace(scan, points=compensate(scan.points, scan.turn, motion, to_ns), turn=None)
    as_files = recording.layout.traits.compensated_scans and recording.deskew is None
    if not (as_files or recording.deskew is Deskew.ON):
        raise MissingDataError(
            f'{recording.name}: the time of the points is not known, since the stamps of the turns'
            f' are missing'
        )
    index = recording.streams[Stream.SCAN]
    from_ns = int(index.stamps_ns[np.searchsorted(index.numbers, number)])
    span = min(from_ns, to_ns), max(from_ns, to_ns)
    motion = _motion_between(recording, number, span, recording.period_ns)
    return replace(scan, points=move_rigidly(scan.points, motion.relative(to_ns, from_ns)))


def _compensated(
    recording: KittiRecording, turns: Mapping[int, Turn], number: int, scan: Scan
) -> Scan:
    """Return a scan compensated for motion, at the time of facing forward."""
    turn = turns[number]
    motion = _motion(recording, number, turn, turn.forward_ns)
    return replace(scan, points=compensate(scan.points, turn, motion, turn.forward_ns), turn=None)


def _as_measured(recording: KittiRecording, number: int, scan: Scan) -> Scan:
    """Return a scan that KITTI has compensated for motion as it was measured, exactly.

    One that is not on KITTI's grid is moved by the poses, with a note.
    """
    measured_scan = find_measured(scan.points, _start_of(recording, number))
    if measured_scan is None:
        return replace(_moved_back(recording, number, scan), note=_BY_POSES)
    points = scan.points.copy()
    points[:, :3] = measured_scan.xyz
    return replace(scan, points=points)


def _start_of(recording: KittiRecording, number: int) -> Float64Array | None:
    """Return the twist of a turn by the poses; None without any near."""
    turn = recording.turns[number]
    try:
        motion = _motion(recording, number, turn, turn.forward_ns)
    except MissingDataError:
        return None
    moved = motion.relative(turn.forward_ns, turn.forward_ns + _KITTI_TURN_NS)
    turning = twist_of(Transform.from_matrix(moved))
    return np.array([*moved[:3, 3], turning[2, 1], turning[0, 2], turning[1, 0]])


def _moved_back(recording: KittiRecording, number: int, scan: Scan) -> Scan:
    """Return a scan that was compensated for motion as it was measured, by the poses."""
    turn = recording.turns[number]
    motion = _motion(recording, number, turn, turn.forward_ns)
    start_ns = turn.forward_ns - _KITTI_TURN_NS // 2
    points = undo_compensation(scan.points, Turn(start_ns, _KITTI_TURN_NS), motion, turn.forward_ns)
    return replace(scan, points=points)


def _leave_out_uncovered(recording: KittiRecording) -> None:
    """Leave out the scans without packets or poses near.

    Raises:
        MissingDataError: These are all.
    """
    what = 'undo_deskew' if recording.options.undo_deskew else 'deskew'
    poses = recording.streams.get(Stream.POSE)
    if poses is None:
        raise MissingDataError(
            f'{recording.root}: {what} needs the motion of the car, and {recording.name} has'
            f' neither oxts packets nor poses'
        )
    numbers: list[int] = recording.streams[Stream.SCAN].numbers.tolist()
    by_packets = recording.layout.traits.packet_poses and Stream.OXTS in recording.streams
    least = 1 if by_packets else _FEWEST_POSES
    without = []
    for number in numbers:
        turn = recording.turns[number]
        span, reach_ns = (turn.start_ns, turn.end_ns), _REACH_TURNS * turn.length_ns
        near = poses.stamps_ns[_near(poses.stamps_ns, span, reach_ns)]
        if len(near) < least or not _covers(near, span, reach_ns):
            without.append(number)
    kind = 'oxts packets' if least == 1 else 'poses'
    reason = (
        f'{recording.path(Stream.POSE, 0).parent}: no {kind} near the turns of scans {{}}, which'
        f' {what} needs; they are left out'
    )
    if len(without) == len(numbers):
        raise MissingDataError(reason.replace('{}', format_numbers(numbers)))
    recording.leave_out(Stream.SCAN, without, reason)


def _motion(recording: MovingRecording, number: int, turn: Turn, target_ns: int) -> ScannerMotion:
    span = min(turn.start_ns, target_ns), max(turn.end_ns, target_ns)
    return _motion_between(recording, number, span, turn.length_ns)


def _motion_between(
    recording: MovingRecording, number: int, span: tuple[int, int], length_ns: int
) -> ScannerMotion:
    """Return the motion of the scanner from the packets or poses near two times.

    Args:
        recording: The recording.
        number: The scan, for its calibration.
        span: The times, nanoseconds.
        length_ns: Duration of a turn of the scanner.

    Raises:
        MissingDataError: There are none near.
    """
    poses_near = _poses_near(recording, span, _REACH_TURNS * length_ns)
    stamps_ns = [*poses_near]
    velo_t_imu = recording.calibration(number).velo_T_imu
    covered = _covers(np.array(stamps_ns, dtype=np.int64), span, _REACH_TURNS * length_ns)
    measured = _twists(list(poses_near.values()), velo_t_imu.matrix()) if covered else None
    if not covered or (measured is None and len(poses_near) < _FEWEST_POSES):
        raise MissingDataError(
            f'{recording.name}: no readable oxts packets or poses near the turn of scan {number},'
            f' which compensation of motion needs'
        )
    if measured is not None:
        motion = ScannerMotion.from_twists(stamps_ns, measured)
    else:
        imu_t_velo = velo_t_imu.inverse()
        poses = [pose.world_T_imu @ imu_t_velo for pose in poses_near.values()]
        motion = ScannerMotion.from_poses(stamps_ns, poses)
    speed, rate = motion.fastest()
    if speed > _FASTEST_M_S or rate > _FASTEST_RAD_S:
        raise MissingDataError(
            f'{recording.name}: the car moves at {speed:.3g} m/s and {rate:.3g} rad/s near the turn'
            f' of scan {number}: oxts or poses, or their stamps, are wrong'
        )
    return motion


def _poses_near(
    recording: MovingRecording, span: tuple[int, int], reach_ns: int
) -> dict[int, Pose]:
    """Return the readable poses near two times, by ascending stamp."""
    index = recording.streams.get(Stream.POSE)
    if index is None:
        return {}
    near = _near(index.stamps_ns, span, reach_ns)
    stamps = dict(zip(index.numbers[near].tolist(), index.stamps_ns[near].tolist(), strict=True))
    return {stamps[n]: pose for n, pose in recording.readable_poses(stamps, Stream.SCAN)}


def _near(stamps_ns: Int64Array, span: tuple[int, int], reach_ns: int) -> Int64Array:
    """Return the indices of the stamps near two times, in ascending order, each stamp once."""
    first, last = span
    within = np.flatnonzero((stamps_ns >= first - reach_ns) & (stamps_ns <= last + reach_ns))
    _, indices = np.unique(stamps_ns[within], return_index=True)
    return within[indices]


def _covers(stamps_ns: Int64Array, span: tuple[int, int], reach_ns: int) -> bool:
    """Return whether each time of a span is near one of ascending stamps."""
    if not len(stamps_ns):
        return False
    first, last = span
    halfway = stamps_ns[:-1] + np.diff(stamps_ns) // 2
    between = halfway[(halfway > first) & (halfway < last)]
    times_ns = np.array([first, *between.tolist(), last], dtype=np.int64)
    nearest = np.abs(times_ns[:, None] - stamps_ns).min(axis=1)
    return bool((nearest <= reach_ns).all())


def _twists(poses: list[Pose], velo_t_imu: Float64Array) -> Float64Array | None:
    """Return (K, 4, 4) the measured twists of the scanner; None if a pose has no velocity."""
    imu_t_velo = np.linalg.inv(velo_t_imu)
    twists = [
        velo_t_imu @ make_twist(pose.velocity, pose.angular_velocity) @ imu_t_velo
        for pose in poses
        if pose.velocity is not None and pose.angular_velocity is not None
    ]
    return np.stack(twists) if len(twists) == len(poses) else None


# Stereo pairs: cameras 0 and 1, 2 and 3, with one stamp a pair, that of the left image.
#
# KITTI triggers its cameras together, but each image has a stamp of its own: in drive 0001 image_3
# is 0.47 to 0.64 ms before image_2, and image_1 2.69 ms before to 2.43 ms after image_0. Stereo
# nodes pair by equal stamps (ExactTime) unless configured otherwise: image_pipeline 0131608,
# stereo_image_proc/src/stereo_image_proc/disparity_node.cpp, parameter approximate_sync.
#
# Images of one file number are a pair; in a raw extract, whose cameras are numbered independently,
# the nearest in time, at most 10 ms apart. An image without a partner keeps its stamp.

LEFT_STREAM_OF = {IMAGE_STREAMS[right]: IMAGE_STREAMS[left] for right, left in LEFT_OF.items()}
"""The stream of the left images of a stream of right ones."""
_NS_PER_MS = 1_000_000
_FARTHEST_NS = 10 * _NS_PER_MS


def prepare_stereo(recording: KittiRecording) -> None:
    """Give the right images of a recording the stamps of their left ones, if options request it."""
    if not recording.options.stereo:
        return
    streams = recording.streams
    pairs = [
        (left, right)
        for right, left in LEFT_STREAM_OF.items()
        if {left, right} <= {*streams} and right.camera in recording.layout.traits.right_cameras
    ]
    left_0 = pairs[0][0] if pairs else None
    own = left_0 is not None and recording.calibration(_first(streams[left_0])).is_independent(
        left_0.camera or 0
    )
    if own or not pairs:
        why = 'each camera has extrinsics of its own' if own else 'no two cameras are a pair'
        recording.notes.append(f'stereo {CHANGES_NOTHING}: {why}')
        return
    recording.stereo = True
    for left, right in pairs:
        _stamp(recording, left, right)


def pair_numbers(
    left_ns: Mapping[int, int], right_ns: Mapping[int, int], *, common: bool
) -> dict[int, int]:
    """Map the file numbers of right images to those of their left ones.

    Args:
        left_ns: Stamps of the left images, nanoseconds, by file number.
        right_ns: Stamps of the right ones.
        common: Whether a number is the same time in both.
    """
    if common:
        return {number: number for number in right_ns if number in left_ns}
    lefts = sorted((stamp_ns, number) for number, stamp_ns in left_ns.items())
    nearest: dict[int, tuple[int, int]] = {}
    for number, stamp_ns in right_ns.items():
        index = bisect_left(lefts, (stamp_ns, 0))
        for left_stamp_ns, left in lefts[max(index - 1, 0) : index + 1]:
            candidate = abs(left_stamp_ns - stamp_ns), number
            if candidate[0] <= _FARTHEST_NS:
                nearest[left] = min(nearest.get(left, candidate), candidate)
    # A right image between two left ones is the nearest of both: it belongs to the nearer.
    best: dict[int, tuple[int, int]] = {}
    for left, (apart_ns, number) in nearest.items():
        best[number] = min(best.get(number, (apart_ns, left)), (apart_ns, left))
    return {number: left for number, (_, left) in best.items()}


def pair_stamps(
    left_ns: Mapping[int, int], right_ns: Mapping[int, int], *, common: bool
) -> dict[int, int]:
    """Map the file numbers of right images to stamps: of their left ones, else their own."""
    pairs = pair_numbers(left_ns, right_ns, common=common)
    return {
        number: left_ns[pairs[number]] if number in pairs else stamp_ns
        for number, stamp_ns in right_ns.items()
    }


def _stamp(recording: KittiRecording, left: Stream, right: Stream) -> None:
    """Stamp the right images of a pair of streams; note how far apart they are, and lone ones."""
    left_ns, right_ns = (_stamps(recording.streams[stream]) for stream in (left, right))
    pairs = pair_numbers(left_ns, right_ns, common=recording.common_numbers)
    stamps = pair_stamps(left_ns, right_ns, common=recording.common_numbers)
    recording.streams[right] = StreamIndex(
        recording.streams[right].numbers, np.array([*stamps.values()], dtype=np.int64)
    )
    moved_ms = [(left_ns[of] - right_ns[number]) / _NS_PER_MS for number, of in pairs.items()]
    if any(moved_ms):
        recording.notes.append(
            f'{right.value} has the stamps of {left.value}, {min(moved_ms):+.2f} to'
            f' {max(moved_ms):+.2f} ms from its own, in {len(pairs)} pairs'
        )
    lone = {right: right_ns.keys() - pairs.keys(), left: left_ns.keys() - {*pairs.values()}}
    for stream, numbers in lone.items():
        if numbers:
            frames = format_numbers(sorted(numbers))
            count = format_count(len(numbers), 'image')
            other = left if stream is right else right
            recording.notes.append(
                f'{stream.value} of frames {frames} ({count}) has no {other.value}:'
                f' written with its own stamp, without a pair'
            )


def _stamps(index: StreamIndex) -> dict[int, int]:
    return dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))


def _first(index: StreamIndex) -> int:
    return int(index.numbers[0])


# Predictions of a detector or tracker as a stream of a recording.

_STREAMS = (Stream.LABELS, *(stream for stream in FRAME_STREAMS if stream is not Stream.LABELS))


def add_predictions(recording: KittiRecording, path: Path | None) -> None:
    """Add result files to a recording, with the stamps of its labels, or else of its scans.

    Frames without a result file are losses, and so are result files of other frames.

    Args:
        recording: Gets the stream of predictions.
        path: A folder with a file for each frame, or a tracker's file; None adds nothing.

    Raises:
        UsageError: The path contains no result file, or none of a frame of the recording.
        BadFileError: A tracker's file is no text.
        OSError: It cannot be read.
    """
    if path is None:
        return
    results = ResultFiles(path, frames=recording.frames)
    stamps = _frame_stamps(recording)
    own, frame_numbers = {*results.numbers}, sorted(stamps)
    if not own & {*frame_numbers}:
        frames = describe_frames(frame_numbers) if frame_numbers else 'none'
        of_results = describe_frames(results.numbers) if own else 'none'
        raise UsageError(
            f'{results.root}: contains results of {of_results}; {recording.name} has {frames}'
        )
    absent = results.absent(frame_numbers)
    lost = {*absent.numbers} if absent is not None else set()
    numbers = np.array([number for number in frame_numbers if number not in lost], np.int64)
    stamps_ns = np.array([stamps[number] for number in numbers.tolist()], np.int64)
    recording.results = results
    recording.streams[Stream.PREDICTIONS] = StreamIndex(numbers, stamps_ns)
    recording.losses += [*results.losses, *([] if absent is None else [absent])]
    others = sorted(own - {*frame_numbers})
    if others:
        reason = f'{results.root}: results of frames {{}}, which {recording.name} does not have'
        recording.losses.append(Loss(Stream.PREDICTIONS.value, len(others), reason, tuple(others)))


def _frame_stamps(recording: KittiRecording) -> dict[int, int]:
    """Return the stamp of each frame; a raw extract counts its frames by the scans."""
    present = [recording.streams[stream] for stream in _STREAMS if stream in recording.streams]
    stamps: dict[int, int] = {}
    for index in reversed(present if recording.common_numbers else present[:1]):
        stamps |= zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True)
    return stamps


# The frames that a selection takes: by their numbers, seconds from the first, or stamps.


def within(
    selection: SelectionOptions, numbers: Int64Array, stamps_ns: Int64Array
) -> npt.NDArray[np.bool_]:
    """Return (N,) which frames are between the start and the end of a selection, both included.

    Args:
        selection: Its seconds count from the first frame.
        numbers: (N,) of the frames.
        stamps_ns: (N,) of the frames.
    """
    mask = np.ones(len(numbers), dtype=np.bool_)
    for bound, compare in ((selection.start, np.greater_equal), (selection.end, np.less_equal)):
        if bound is None:
            continue
        if bound.frame is not None:
            mask &= compare(numbers, bound.frame)
        elif bound.offset_ns is not None:
            mask &= compare(stamps_ns, int(stamps_ns.min()) + bound.offset_ns)
        else:
            mask &= compare(stamps_ns, bound.stamp_ns or 0)
    return mask
