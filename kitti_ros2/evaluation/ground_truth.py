# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth of an evaluation: labels and poses, by frame and by stamp."""

from __future__ import annotations

from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..bags.locate import is_bag
from ..importer.box_labels import ImageOf, TrackIds, make_boxes
from ..kitti import names
from ..kitti.kitti_recording import rect_from_imu
from ..kitti.label_file import ResultFiles, find_frame_files
from ..kitti.names import LABEL_FOLDERS, SIX_DIGITS, SPLITS, TRACKING_LABELS, TXT, FileNames
from ..kitti.opening import open_recording
from ..kitti.recording_index import find_turns
from ..kitti.store import STORE
from ..messages.naming import base_t_imu
from ..model.errors import (
    BadFileError,
    KittiRos2Error,
    Loss,
    MissingDataError,
    MissingPathError,
    UsageError,
    describe_error,
)
from ..model.samples import NONE, Pose, default_tolerance_ns, nearest_stamps
from ..model.streams import FRAME_STREAMS, LAST_NS, Clock, Layout, Stream
from ..options.messages import MessageOptions
from ..options.read import ReadOptions
from .trajectories import CameraTrajectory, kitti_links, read_trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..kitti.kitti_recording import KittiRecording
    from ..messages.tf_tree import Link
    from ..model.boxes import Box
    from ..model.geometry import Transform
    from ..model.recording import StreamIndex
    from ..model.samples import FrameLabels, Int64Array, Turn
    from ..own_bags.recording import BagRecording, NumberedRecording


# The frames of a recording by stamp, and the time of a player by log time.
#
# All evaluations match the stamps of results to frames by this.

_STAMPED = tuple(stream for stream in FRAME_STREAMS if stream not in {Stream.OXTS, Stream.POSE})
ROUNDED_NS = 1_000_000
"""Stamps pass through float64 seconds, or microseconds."""


class StampMatch(NamedTuple):
    """The frames of M stamps.

    Attributes:
        numbers: (M,) of the frame, NONE where the nearest is too far.
        distances_ns: (M,) from the nearest stamp of the frame, nanoseconds.
        offsets_ns: (M,) how much later than the frame they are: 0 at the stamp of a sensor.
        stamped_at: Event of the stamps, such as start of turn; empty for sensors, or if unknown.
    """

    numbers: Int64Array
    distances_ns: Int64Array
    offsets_ns: Int64Array
    stamped_at: str = ''


class _StampSeries(NamedTuple):
    """A stamp of each of N frames.

    Attributes:
        name: For users; empty for the samples of a sensor.
        numbers: (N,) of the frames.
        stamps_ns: (N,) ascending.
        late_ns: (N,) how much later than the frame they are.
    """

    name: str
    numbers: Int64Array
    stamps_ns: Int64Array
    late_ns: Int64Array

    def frames_at(self, stamps_ns: Int64Array, within_ns: int) -> int:
        """Count the frames that have one of (M,) stamps."""
        nearest, off = nearest_stamps(self.stamps_ns, stamps_ns)
        return len(np.unique(nearest[np.abs(off) <= within_ns]))


class StampedFrames:
    """The frames of a recording by stamp.

    A frame has the stamps of its scan and of its images; results are stamped at one of them. It
    also has the start of the scanner's turn, which is the stamp of a scan with ring time, and the
    end, which is that of odometry whose scans are compensated to it. These are half a period from
    the frame, as near to another: a stamp is at one of them if it differs by rounding only. The end
    of a turn is also the start of the next, so all stamps of a result are judged together.

    Args:
        samples: Samples of the sensors by frame number; the first has the stamp of the frame.
        tolerance_ns: The largest distance from the stamp of a frame.
        turns: By number of the frame.

    Attributes:
        numbers: Numbers of the frames with expected results, ascending.
        stamps_ns: (N,) those of the samples, ascending.
        tolerance_ns: The largest distance from the stamp of a frame.
        first_ns: The stamp of the first frame.
    """

    def __init__(
        self,
        samples: Sequence[StreamIndex],
        tolerance_ns: int,
        turns: Mapping[int, Turn] | None = None,
    ) -> None:
        numbers = np.concatenate([index.numbers for index in samples])
        stamps = np.concatenate([index.stamps_ns for index in samples])
        order = np.argsort(stamps, kind='stable')
        self.stamps_ns, self._numbers = stamps[order], numbers[order]
        self._first_of: dict[int, int] = {}
        for number, stamp in zip(self._numbers.tolist(), self.stamps_ns.tolist(), strict=True):
            self._first_of.setdefault(number, stamp)
        self._frame_numbers, first = np.unique(numbers, return_index=True)
        self._reference_ns = stamps[first]
        self._frame_stamps = _stamps_of(samples, turns or {})
        self.numbers: list[int] = self._frame_numbers.tolist()
        self.first_ns = int(self.stamps_ns[0])
        self.tolerance_ns = tolerance_ns

    def stamp_of(self, number: int) -> int:
        """Return the first stamp of a frame."""
        return self._first_of[number]

    def reference_stamp_of(self, number: int) -> int:
        """Return the stamp of a frame: that of its scan, or of the first of its other samples."""
        return int(self._reference_ns[np.searchsorted(self._frame_numbers, number)])

    def match(self, stamps_ns: Int64Array, tolerance_ns: int | None = None) -> StampMatch:
        """Match the stamps of a result to frames.

        Args:
            stamps_ns: (M,) in any order.
            tolerance_ns: Another one than that of the frames.
        """
        tolerance = self.tolerance_ns if tolerance_ns is None else tolerance_ns
        indices, off = nearest_stamps(self.stamps_ns, stamps_ns)
        distances, nearest = np.abs(off), self._numbers[indices]
        offsets = stamps_ns - self._reference_ns[np.searchsorted(self._frame_numbers, nearest)]
        numbers = np.where(distances <= tolerance, nearest, NONE)
        rounded = min(ROUNDED_NS, tolerance)
        frames, best = max(
            ((stamps.frames_at(stamps_ns, rounded), stamps) for stamps in self._frame_stamps),
            key=lambda pair: pair[0],
        )
        if 2 * frames < min(len(stamps_ns), len(self.numbers)):
            return StampMatch(numbers, distances, offsets)
        indices, off = nearest_stamps(best.stamps_ns, stamps_ns)
        at_it = np.abs(off) <= rounded
        return StampMatch(
            np.where(at_it, best.numbers[indices], numbers),
            np.where(at_it, np.abs(off), distances),
            np.where(at_it, off + best.late_ns[indices], offsets),
            best.name,
        )

    def nearest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the frame of a stamp and its distance; None if it is too far."""
        match = self.match(np.array([min(stamp_ns, LAST_NS)], dtype=np.int64))
        number = int(match.numbers[0])
        return None if number == NONE else (number, int(match.distances_ns[0]))

    def latest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the last frame before a time and the distance.

        None if it is further than twice the tolerance, which is the time between frames.
        """
        index = int(np.searchsorted(self.stamps_ns, stamp_ns, 'right')) - 1
        distance = stamp_ns - int(self.stamps_ns[index]) if index >= 0 else -1
        within = 0 <= distance <= 2 * self.tolerance_ns
        return (int(self._numbers[index]), distance) if within else None


def frames_of(recording: NumberedRecording, tolerance_ns: int | None = None) -> StampedFrames:
    """Return the frames of a recording that results are expected of.

    These are the frames with labels where each frame has a file of labels, else all with a scan or
    an image.

    Args:
        recording: The recording.
        tolerance_ns: The largest distance from the stamp of a frame; None is half the median time
            between frames, at most half the nominal one.
    """
    streams = recording.streams
    stamped: list[Stream] = [stream for stream in _STAMPED if stream in streams]
    frames = _stamped_by(recording, stamped or [*streams], tolerance_ns)
    if Stream.LABELS in streams and recording.layout.traits.frame_set:
        frames.numbers = sorted({*streams[Stream.LABELS].numbers.tolist()})
    return frames


def posed_frames_of(recording: NumberedRecording) -> StampedFrames:
    """Return the frames of a recording with poses; they also have the stamps of these."""
    stamped = [stream for stream in _STAMPED if stream in recording.streams]
    return _stamped_by(
        recording, [*stamped, Stream.POSE] if recording.common_numbers else [Stream.POSE], None
    )


def _stamped_by(
    recording: NumberedRecording, streams: Sequence[Stream], tolerance_ns: int | None
) -> StampedFrames:
    """Return frames with the stamps of some streams.

    Args:
        recording: The recording.
        streams: the first has the numbers of frames where others have their own.
        tolerance_ns: See frames_of.
    """
    used = [recording.streams[stream] for stream in streams]
    if tolerance_ns is None:
        tolerance_ns = min(default_tolerance_ns(used[0].stamps_ns), recording.period_ns // 2)
    if not recording.common_numbers:
        return StampedFrames(used[:1], tolerance_ns)
    return StampedFrames(used, tolerance_ns, _turns(recording))


def _stamps_of(samples: Sequence[StreamIndex], turns: Mapping[int, Turn]) -> list[_StampSeries]:
    """Return the samples of each sensor, and starts and ends of turns."""
    none = np.zeros(1, dtype=np.int64)
    stamps = [('', index.numbers, index.stamps_ns, none) for index in samples]
    if turns:
        rows = [
            (number, turn.start_ns, turn.forward_ns, turn.end_ns) for number, turn in turns.items()
        ]
        numbers, starts, forward, ends = np.array(rows, dtype=np.int64).T
        stamps.append(('start of turn', numbers, starts, starts - forward))
        stamps.append(('end of turn', numbers, ends, ends - forward))
    return [_in_order(*columns) for columns in stamps]


def _in_order(
    name: str, numbers: Int64Array, stamps_ns: Int64Array, late_ns: Int64Array
) -> _StampSeries:
    order = np.argsort(stamps_ns, kind='stable')
    late = np.broadcast_to(late_ns, order.shape)
    return _StampSeries(name, numbers[order], stamps_ns[order], late[order])


def _turns(recording: NumberedRecording) -> Mapping[int, Turn]:
    """Return the turns of a recording, also of missing and of compensated scans.

    Its scans may have been played with --undo-deskew.
    """
    if recording.turns:
        return recording.turns
    streams = recording.streams
    index = streams[Stream.SCAN] if Stream.SCAN in streams else next(iter(streams.values()))
    forward = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
    return find_turns(forward, {}, {}, recording.period_ns)


class PlayedTime:
    """The recording's time at the log times of a bag, by the messages of /clock in it.

    Without such messages log times are used: recorders with use_sim_time store the same time.

    Args:
        log_ns: (N,) log times of the messages, ascending.
        clock_ns: (N,) the times in them.
    """

    def __init__(self, log_ns: Sequence[int], clock_ns: Sequence[int]) -> None:
        self._log: Int64Array = np.array(log_ns, dtype=np.int64)
        self._clock: Int64Array = np.array(clock_ns, dtype=np.int64)

    def at(self, log_ns: int) -> int:
        """Return the time of the last message of /clock before a log time."""
        if not len(self._log):
            return log_ns
        index = int(np.searchsorted(self._log, log_ns, 'right')) - 1
        return int(self._clock[max(index, 0)])


# The ground truth of a trajectory: a poses file, or a KITTI folder.


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The true poses of the vehicle, and its frames.

    Attributes:
        name: Sequence or drive, such as 09.
        trajectory: Poses of camera 0, in its first frame.
        frames: Its frames by stamp; None without stamps.
        links: Static transforms up to camera 0; empty without a calibration.
        epoch_ns: Stamp of second 0 in recordings without absolute time; None for others.
        listed: Whether the poses are listed by frame number, of those frames that have one.
    """

    name: str
    trajectory: CameraTrajectory
    frames: StampedFrames | None = None
    links: Sequence[Link] = ()
    epoch_ns: int | None = None
    listed: bool = False


_KITTI_360_POSES = names.KITTI_360_PARTS[2]
_Z_DOWN = -0.2


def truth_of_file(path: Path, read: ReadOptions) -> GroundTruth:
    """Read a poses file; stamps and calibration are read from the folder of its sequence, if any.

    KITTI-360's poses.txt, of the GPS/IMU, is read with its drive.

    Raises:
        KittiRos2Error: There are no poses.
        OSError: It cannot be read.
    """
    if path.name == names.KITTI_360_POSES[0] and path.parent.parent.name == _KITTI_360_POSES:
        return truth_of_folder(open_recording(path.parent, replace(read, layout=None)))
    trajectory = read_trajectory(path)
    if trajectory.numbers is None:
        raise UsageError(
            f'{path}: is a TUM file; as ground truth give a poses file of KITTI, the folder of a'
            f' sequence or drive, or a bag'
        )
    if not trajectory.by_line:
        notes = (*trajectory.notes, *_z_down(trajectory))
        return GroundTruth(path.stem, replace(trajectory, notes=notes), listed=True)
    folder = path.parent.parent / names.SEQUENCES / path.stem
    if path.parent.name != names.POSES or not folder.is_dir():
        return GroundTruth(path.stem, trajectory)
    try:
        beside = truth_of_folder(open_recording(folder, replace(read, layout=None, sequence=None)))
    except (KittiRos2Error, OSError):
        return GroundTruth(path.stem, trajectory)
    if beside.trajectory.numbers is None or not np.array_equal(
        beside.trajectory.numbers, trajectory.numbers
    ):
        return GroundTruth(path.stem, trajectory, links=beside.links)
    timed = replace(trajectory, stamps_ns=beside.trajectory.stamps_ns)
    return replace(beside, name=path.stem, trajectory=timed)


def _z_down(trajectory: CameraTrajectory) -> tuple[str, ...]:
    """Return a note on poses that are not of a camera: KITTI-360's poses.txt out of its folder."""
    if (trajectory.poses[:, 2, 2] > _Z_DOWN).any():
        return ()
    note = (
        f'{trajectory.source}: z of its frames points down, as in poses.txt of KITTI-360, of the'
        f' GPS/IMU, and they are taken as those of camera 0; give cam0_to_world.txt, or the folder'
        f' of the drive'
    )
    return (note,)


def truth_of_folder(recording: KittiRecording) -> GroundTruth:
    """Read the poses of a KITTI folder.

    Raises:
        MissingDataError: It has none.
    """
    epoch_ns = None if recording.clock is Clock.UTC else recording.options.epoch_ns
    return truth_of_recording(recording, base_t_imu(MessageOptions()), epoch_ns)


def truth_of_recording(
    recording: NumberedRecording, base_t_imu: Transform, epoch_ns: int | None
) -> GroundTruth:
    """Read the poses of imu_link, and convert them to camera 0 in its first frame.

    KITTI's matrices have seven digits. The conversion of poses/NN.txt to imu_link is undone by its
    inverse, not by its transpose, so that the result is poses/NN.txt again.

    Raises:
        MissingDataError: It has no poses.
    """
    index = recording.streams.get(Stream.POSE)
    if index is None:
        raise MissingDataError(
            f'{recording.root}: {recording.name} has no poses; the ground truth is poses/NN.txt of'
            f' odometry, poses.txt of KITTI-360, or oxts of raw drives and tracking'
        )
    calibration = recording.calibration(int(index.numbers[0]))
    imu_t_cam0 = np.linalg.inv(rect_from_imu(calibration).matrix())
    listed = Stream.POSE in recording.layout.traits.numbered_lines
    of_imu = listed or Stream.OXTS in recording.streams
    nominal = list(calibration.nominal) if of_imu else []
    parts = {'cam0_T_velo': calibration.cam0_T_velo, 'r0_rect': calibration.r0_rect}
    nominal += [part for part, value in parts.items() if value is None and part not in nominal]
    about = {Stream.POSE.value, recording.root.name}
    losses = [loss for loss in recording.losses if loss.stream in about]
    rows, poses = [], []
    for row, number in enumerate(index.numbers.tolist()):
        try:
            pose = recording.read(Stream.POSE, number)
        except (KittiRos2Error, OSError) as error:
            losses.append(Loss(Stream.POSE.value, 1, describe_error(error)))
            continue
        if isinstance(pose, Pose):
            rows.append(row)
            poses.append(pose.world_T_imu.matrix() @ imu_t_cam0)
    if not poses:
        raise MissingDataError(f'{recording.root}: no pose can be read; {losses[0].text()}')
    trajectory = CameraTrajectory(
        f'{recording.root} ({recording.layout.value} {recording.name})',
        np.linalg.inv(poses[0]) @ np.array(poses),
        index.numbers[rows],
        index.stamps_ns[rows],
        losses=tuple(losses),
        notes=tuple(f'{part}: not known, a nominal value is used' for part in nominal),
    )
    links, frames = kitti_links(calibration, base_t_imu), posed_frames_of(recording)
    return GroundTruth(recording.name, trajectory, frames, links, epoch_ns, listed)


# The boxes of label files or result files, by frame.

if TYPE_CHECKING:
    Progress = Callable[[], None]


@dataclass(frozen=True)
class FrameBoxes:
    """The boxes of labels or results by frame.

    Attributes:
        source: The file or folder.
        boxes: By frame number, ascending; a frame may have none.
        complete: True if frames that are not in boxes have no objects, as in a tracker's file;
            otherwise they are unknown.
        losses: Lines and files that could not be read.
        notes: One line each.
        frames: The names of the frames.
    """

    source: Path
    boxes: Mapping[int, Sequence[Box]]
    complete: bool = False
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    frames: FileNames = SIX_DIGITS


def read_boxes(
    path: Path,
    stream: str,
    progress: Progress = lambda: None,
    frames: FileNames | None = None,
) -> FrameBoxes:
    """Read all boxes of a folder of files named by frame, or of a tracker's file.

    Args:
        path: See ResultFiles.
        stream: For losses: invalid lines and files.
        progress: Called for each frame.
        frames: The names of the labels' frames.

    Raises:
        UsageError: The path contains no such files; the message contains the remedy.
        BadFileError: A tracker's file is no text, or has no frame numbers.
        OSError: A tracker's file cannot be read.
    """
    files = ResultFiles(path, stream, frames)
    boxes: dict[int, list[Box]] = {}
    losses = [*files.losses]
    for number in files.numbers:
        progress()
        try:
            boxes[number], errors = files.boxes(number)
        except (BadFileError, OSError) as error:
            losses.append(Loss(stream, 1, describe_error(error), (number,)))
            continue
        losses += [Loss(stream, 1, str(error), (number,)) for error in errors]
    return FrameBoxes(files.root, boxes, files.complete, tuple(losses), frames=files.frames)


# The labels of the ground truth: label files, or the labels of a recording.

_STREAM = 'ground truth'


def read_ground_truth(
    path: Path, options: ReadOptions, progress: Progress = lambda: None
) -> FrameBoxes:
    """Read the labels of a path.

    Args:
        path: label_2, a split or root of the object layout, label_02 or a file of it, or a
            recording with labels: its folder, or a bag that to-bag wrote.
        options: Layout and sequence of a recording.
        progress: Called for each frame.

    Raises:
        KittiRos2Error: There are no labels; the message contains the remedy.
    """
    if not path.exists():
        raise MissingPathError(path)
    if holds_bag(path):
        with open_truth_bag(path) as recording:
            return _read_recording(path, recording, progress)
    files = path if path.is_file() else _label_folder(path, options)
    if files is not None:
        return read_boxes(files, _STREAM, progress, _names_around(files))
    return _read_recording(
        path, open_recording(*recording_of(path, options), scans=False), progress
    )


def holds_bag(path: Path) -> bool:
    """Return whether a path is a bag; a text file named .txt is none, even if it is empty."""
    return path.suffix != TXT and is_bag(path)


@contextmanager
def open_truth_bag(path: Path) -> Iterator[BagRecording]:
    """Open the recording in a bag.

    Raises:
        UsageError: to-bag did not write the bag.
    """
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - readers of bags take 0.2 s
    from ..importer.survey import survey_bags  # noqa: PLC0415 - as above
    from ..own_bags.recording import open_own_recording  # noqa: PLC0415 - as above

    with open_bag_source(path) as bag:
        recording = open_own_recording(bag, survey_bags([bag]))
        if recording is None:
            raise UsageError(
                f'{path}: was not written by to-bag, so that its labels have no frame numbers;'
                f' convert it with to-kitti, and give that folder'
            )
        with closing(recording):
            yield recording


def recording_of(path: Path, options: ReadOptions) -> tuple[Path, ReadOptions]:
    """Return the path of the recording that labels belong to, and the options to open it.

    Args:
        path: See read_ground_truth.
        options: See read_ground_truth.
    """
    whole = path.absolute()
    if whole.name == TRACKING_LABELS:
        return whole.parent, replace(options, layout=Layout.TRACKING)
    if whole.parent.name == TRACKING_LABELS and whole.is_file():
        sequence = options.sequence or whole.stem
        return whole.parents[1], replace(options, layout=Layout.TRACKING, sequence=sequence)
    folder = _label_folder(whole, options)
    if folder is not None and folder.name in LABEL_FOLDERS:
        return folder.parent, options
    return path, options


def _names_around(files: Path) -> FileNames | None:
    """Return the names of the frames of the set that labels belong to, if they are no numbers."""
    if files.name not in LABEL_FOLDERS or not STORE.find_frames({files: (TXT,)}, 1).stems:
        return None
    return open_recording(files.parent, ReadOptions(layout=Layout.OBJECT)).file_names


def _label_folder(path: Path, options: ReadOptions) -> Path | None:
    """Return the folder with the labels of the object layout; None for other recordings."""
    if options.layout is not None or options.sequence is not None:
        return None
    folders = [
        path,
        *(folder / name for folder in (path, path / SPLITS[0]) for name in LABEL_FOLDERS),
    ]
    return next(filter(None, map(find_frame_files, folders)), None)


def _read_recording(path: Path, recording: NumberedRecording, progress: Progress) -> FrameBoxes:
    """Read the labels of a recording; a frame of a drive or sequence may have none."""
    if Stream.LABELS not in recording.streams:
        raise UsageError(
            f'{path}: {recording.layout.value} {recording.name} has no labels (KITTI publishes'
            f' none of {SPLITS[1]}); give label_2 of {SPLITS[0]}, or a drive or sequence that has'
            f' labels'
        )
    of_stream = {stream: {*index.numbers.tolist()} for stream, index in recording.streams.items()}
    labelled = of_stream[Stream.LABELS]
    traits, numbers = recording.layout.traits, set(labelled)
    if traits.world_boxes:  # those of a frame without a pose are not known
        numbers |= of_stream.get(Stream.SCAN, set()) & of_stream.get(Stream.POSE, set())
    elif not traits.frame_set:
        for stream in (Stream.SCAN, Stream(f'image_{traits.main_camera}')):
            numbers |= of_stream.get(stream, set())
    tracks = TrackIds()
    boxes: dict[int, Sequence[Box]] = {}
    losses: list[Loss] = []
    unset = 0
    for number in sorted(numbers):
        progress()
        boxes[number] = ()
        if number not in labelled:
            continue
        try:
            labels: FrameLabels = recording.read(Stream.LABELS, number)  # type: ignore[assignment]
            boxes[number] = _boxes_of(labels, recording, number, tracks)
        except (KittiRos2Error, OSError, ValueError) as error:
            del boxes[number]
            reason = str(error) if isinstance(error, ValueError) else describe_error(error)
            losses.append(Loss(_STREAM, 1, reason, (number,)))
            continue
        losses += [Loss(_STREAM, 1, reason, (number,)) for reason in labels.missing.values()]
        unset += sum(cuboid.occluded is None for cuboid in labels.cuboids)
    notes = (f'{path}: {unset} boxes without occlusion count as visible',) if unset else ()
    return FrameBoxes(path, boxes, losses=tuple(losses), notes=notes, frames=recording.file_names)


def _boxes_of(
    labels: FrameLabels,
    recording: NumberedRecording,
    number: int,
    tracks: TrackIds,
) -> list[Box]:
    """Return the labels of a frame; those of tracklets are projected into the main camera.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    if not labels.cuboids:
        return [box for box in labels.boxes if box is not None]
    calibration = recording.calibration(number)
    index = recording.layout.traits.main_camera
    camera = calibration.cameras.get(index)
    if camera is None or camera.size is None:
        raise ValueError(f'{recording.name}: camera {index} has no calibration with image size')
    image = ImageOf(index, camera.size)
    # The benchmark limits the truncated part, of which tracklets have a level.
    cuboids = [replace(cuboid, truncation=None) for cuboid in labels.cuboids]
    return make_boxes(cuboids, calibration, image, tracks)[0]
