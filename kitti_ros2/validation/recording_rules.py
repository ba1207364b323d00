# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a recording: folders, numbers, stamps, motion."""

from __future__ import annotations

import time
from array import array
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..kitti.kitti_recording import MercatorWorld
from ..kitti.recording_index import turn_length
from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.errors import format_count, format_numbers, some_of
from ..model.streams import NS_PER_S, Stream, format_stamp
from .rule import ERROR, NOTE, WARNING, Breach, RuleScope, RuleTable, breach_in, breach_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..kitti.kitti_recording import KittiRecording
    from ..kitti.text_file import Lines
    from ..model.errors import Loss
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array, OxtsPacket


# Rules about a recording: its folders, numbers, and common facts of its files.

_FEW_POINTS = 0.5  # of the median; KITTI's scans have 113,000 to 127,000 points
_LEAST_SCANS = 3
_MOST_UNKNOWN = 0.5

T = TypeVar('T')
ImageShape = tuple[int, int, int]
"""Width, height and channels."""


@dataclass
class RecordingFacts:
    """Common facts of the files of a recording.

    Attributes:
        recording: The recording, open.
        scans, points: File numbers of the scans, and their numbers of points.
        images: File numbers of the images of each shape, by stream.
        reported: Beginnings of the reader's losses that other rules report.
        occlusions: Number of labels of each occlusion, without DontCare.
        contradictions: Between its text files, each with file and line.
    """

    recording: KittiRecording
    scans: array[int] = field(default_factory=lambda: array('q'))
    points: array[int] = field(default_factory=lambda: array('q'))
    images: dict[Stream, dict[ImageShape, array[int]]] = field(default_factory=dict)
    reported: set[str] = field(default_factory=set)
    occlusions: Counter[int] = field(default_factory=Counter)
    contradictions: list[str] = field(default_factory=list)

    def enter_scan(self, number: int, points: int) -> None:
        """Add the number of points of a scan."""
        self.scans.append(number)
        self.points.append(points)

    def enter_image(self, stream: Stream, number: int, shape: ImageShape) -> None:
        """Add the shape of an image."""
        self.images.setdefault(stream, {}).setdefault(shape, array('q')).append(number)

    def losses(self) -> Iterator[tuple[Loss, bool]]:
        """Yield the losses that no other rule reports, each with True for missing files."""
        for loss in self.recording.losses:
            if not loss.text().startswith(tuple(self.reported)):
                yield loss, self._is_absence(loss)

    def _is_absence(self, loss: Loss) -> bool:
        stream = Stream(loss.stream)
        listing = self.recording.listings.get(stream)
        if listing is None or not loss.numbers:
            return False
        return loss.numbers[0] not in listing.numbers


RECORDING_RULES = RuleTable[RecordingFacts](RuleScope.RECORDING)


@RECORDING_RULES.add(
    'data-unusable',
    ERROR,
    'Every file can be used: it has a stamp, its lines are of frames',
    'the conversion skips these data: correct or complete the file',
)
def _find_losses(facts: RecordingFacts) -> Iterator[Breach]:
    for loss, absent in facts.losses():
        if not absent:
            yield breach_in(loss.text(), facts.recording.root)


@RECORDING_RULES.add(
    'image-size',
    ERROR,
    'Images have the size in the calibration, or that of the other images of the camera',
    'calibration holds for one size only: copy the images of this camera again',
)
def _find_other_size(facts: RecordingFacts) -> Iterator[Breach]:
    if facts.recording.layout.traits.calibration_per_frame:
        return
    for stream, shapes in facts.images.items():
        camera = facts.recording.calibration(0).cameras.get(stream.viewer)
        usual = _most_common({shape: shape[:2] for shape in shapes}, shapes)
        stated = None if camera is None else camera.size
        expected, source = (usual, 'other images') if stated is None else (stated, 'calibration')
        for (width, height, _), numbers in shapes.items():
            for number in numbers if (width, height) != expected else ():
                text = f'{width}x{height}; {source}: {expected[0]}x{expected[1]}'
                yield Breach(text, facts.recording.path(stream, number))


@RECORDING_RULES.add(
    'texts-contradict',
    WARNING,
    'Text files of a recording agree: cam0_to_world.txt is of the poses of poses.txt (KITTI-360)',
    'give the files of one download',
)
def _find_contradictions(facts: RecordingFacts) -> Iterator[Breach]:
    for text in facts.contradictions:
        yield breach_in(text, facts.recording.root)


@RECORDING_RULES.add(
    'scan-columns',
    ERROR,
    'Scans have 4 float32 a point, by the size and values of the first ones',
    'give --columns, or convert them; until then they are not checked',
    scope=RuleScope.STREAM,
)
def _find_other_columns(facts: RecordingFacts) -> Iterator[Breach]:
    error = facts.recording.scan_error
    if error is not None:
        breach = breach_of(error, facts.recording.root)
        yield breach._replace(text=f'{breach.text}; {error.remedy}')


@RECORDING_RULES.add(
    'frames-missing',
    WARNING,
    'Streams have the same numbers, and those of their time stamps',
    'copy the missing files; KITTI itself has gaps, such as 177 to 180 of drive 0009',
)
def _find_missing_frames(facts: RecordingFacts) -> Iterator[Breach]:
    for loss, absent in facts.losses():
        if absent:
            yield breach_in(loss.text(), facts.recording.root)


@RECORDING_RULES.add(
    'names-unusual',
    WARNING,
    'Files are named like the others in their folder',
    'rename or move them; they are not read',
    scope=RuleScope.STREAM,
)
def _find_unnumbered(facts: RecordingFacts) -> Iterator[Breach]:
    for listing in facts.recording.listings.values():
        if listing.strays:
            text = f'{some_of(listing.strays)}; names are like {listing.names.example}'
            yield Breach(text, listing.folder)


@RECORDING_RULES.add(
    'scan-points',
    WARNING,
    'Scans have at least half as many points as the median',
    'compare with the source: the file may be cut off',
    scope=RuleScope.STREAM,
)
def _find_sparse(facts: RecordingFacts) -> Iterator[Breach]:
    if len(facts.points) < _LEAST_SCANS:
        return
    counts = np.array(facts.points, np.int64)
    usual = float(np.median(counts))
    for index in np.flatnonzero(counts < _FEW_POINTS * usual).tolist():
        text = f'{counts[index]} points; the median of the scans is {usual:.0f}'
        yield Breach(text, facts.recording.path(Stream.SCAN, facts.scans[index]))


@RECORDING_RULES.add(
    'image-channels',
    WARNING,
    'Images of a camera are all grey or all coloured',
    'copy the images of this camera again',
    scope=RuleScope.STREAM,
)
def _find_other_channels(facts: RecordingFacts) -> Iterator[Breach]:
    for stream, shapes in facts.images.items():
        usual = _most_common({shape: shape[2] for shape in shapes}, shapes)
        for (_, _, channels), numbers in shapes.items():
            for number in numbers if channels != usual else ():
                text = f'{channels} channels; most images of the camera have {usual}'
                yield Breach(text, facts.recording.path(stream, number))


@RECORDING_RULES.add(
    'label-frame',
    WARNING,
    'Labelled frames have an image or a scan',
    'check the frame numbers of the labels; copy the missing files',
)
def _find_unlabelled_frames(facts: RecordingFacts) -> Iterator[Breach]:
    """Find labels of frames without image and scan."""
    streams = facts.recording.streams
    data = [
        index.numbers
        for stream, index in streams.items()
        if stream is Stream.SCAN or stream.camera is not None
    ]
    if Stream.LABELS not in streams or not data:
        return
    labelled = streams[Stream.LABELS].numbers
    without = np.setdiff1d(labelled, np.concatenate(data)).tolist()
    if without:
        path = facts.recording.path(Stream.LABELS, without[0])
        yield Breach(f'labels of frames {format_numbers(without)}, which have no data', path)


@RECORDING_RULES.add(
    'label-occlusion',
    WARNING,
    'The occlusion of most labels is known, or 0',
    'evaluations leave out labels with 3, unknown: write 0 for visible objects',
)
def _find_unknown_occlusion(facts: RecordingFacts) -> Iterator[Breach]:
    """Find labels that evaluations leave out; KITTI has single ones."""
    unknown, every = facts.occlusions[UNKNOWN_OCCLUSION], facts.occlusions.total()
    if unknown > _MOST_UNKNOWN * every:
        labels = facts.recording.streams[Stream.LABELS]
        path = facts.recording.path(Stream.LABELS, int(labels.numbers[0]))
        yield Breach(f'{unknown} of {every} labels have occlusion {UNKNOWN_OCCLUSION}', path)


def _most_common(kinds: Mapping[ImageShape, T], shapes: Mapping[ImageShape, array[int]]) -> T:
    """Return the most common shape of images."""
    counts: Counter[T] = Counter()
    for shape, numbers in shapes.items():
        counts[kinds[shape]] += len(numbers)
    return counts.most_common(1)[0][0]


@RECORDING_RULES.add(
    'stream-missing',
    NOTE,
    'The usual streams of the layout exist',
    'download the archive with them, if they are needed',
)
def _find_missing_streams(facts: RecordingFacts) -> Iterator[Breach]:
    for note in facts.recording.notes:
        if 'left out' in note and ('absent' in note or 'passed over' in note):
            yield breach_in(note, facts.recording.root)


@RECORDING_RULES.add(
    'stamps-missing',
    NOTE,
    'Layouts with time have time stamps',
    'download the archive with them; --period sets the time between frames',
)
def _find_no_stamps(facts: RecordingFacts) -> Iterator[Breach]:
    for note in facts.recording.notes:
        if 'stamps are nominal' in note:
            yield breach_in(note, facts.recording.root)


# Rules about the stamps of a stream and of its samples relative to the scans.
#
# Limits, from raw drives 0001 and 0005: periods are 0.099 to 0.111 s, cameras and oxts come 9 to 24
# ms after the scan of the same number, turns take 0.102 to 0.105 s.

_EARLIEST_NS = 946_684_800 * NS_PER_S
"""2000-01-01 UTC: unset clocks begin in 1970 or 1980."""
_DAY_NS = 86_400 * NS_PER_S
_WIDE_GAP = 3.5
_PAIRED_NS = NS_PER_S // 20


@dataclass(frozen=True, eq=False)
class StampsFile:
    """The stamps of a stream, line n for file number n.

    Attributes:
        path: The file.
        lines: Stamps, nanoseconds.
        relative: True for seconds from the start of the sequence.
        scans: Stamps of the scans with the same numbers; None if their times are independent.
        ends: Path and lines of the ends of turns, if path has their starts.
    """

    path: Path
    lines: Lines[int]
    relative: bool = False
    scans: Sequence[int | None] | None = None
    ends: Sequence[int | None] | None = None

    def stamped(self) -> tuple[Int64Array, Int64Array]:
        """Return the numbers of valid lines, from 0, and their stamps."""
        valid = self.lines.sound()
        return np.array(list(valid), np.int64), np.array(list(valid.values()), np.int64)


STAMP_RULES = RuleTable[StampsFile](RuleScope.STREAM)


@STAMP_RULES.add(
    'stamps-line',
    ERROR,
    'Lines of time stamps can be parsed, and are within 1970 to 2038',
    'correct the line: YYYY-MM-DD HH:MM:SS.nnnnnnnnn, in odometry seconds',
)
def _find_invalid(file: StampsFile) -> Iterator[Breach]:
    for error in file.lines.errors.values():
        yield breach_of(error, file.path)


@STAMP_RULES.add(
    'stamps-order',
    ERROR,
    'Stamps do not go back',
    'check the clock of the recorder, and the order of the lines',
)
def _find_backward(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.stamped()
    for row in np.flatnonzero(np.diff(stamps) < 0).tolist():
        text = f'{_ms(stamps[row] - stamps[row + 1])} before the stamp above'
        yield Breach(text, file.path, int(numbers[row + 1]) + 1)


@STAMP_RULES.add(
    'stamps-repeated',
    WARNING,
    'Stamps are not repeated',
    'check whether a sample was written twice',
)
def _find_repeated(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.stamped()
    for row in np.flatnonzero(np.diff(stamps) == 0).tolist():
        yield Breach('the same stamp as above', file.path, int(numbers[row + 1]) + 1)


@STAMP_RULES.add(
    'stamps-gap',
    WARNING,
    'Periods are at most 3.5 times the usual one',
    'samples were dropped, or lines are missing',
)
def _find_gaps(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.stamped()
    periods = np.diff(stamps) / np.maximum(np.diff(numbers), 1)
    positive = periods[periods > 0]
    if len(positive) < 3:  # too few for a usual period
        return
    usual = float(np.median(positive))
    for row in np.flatnonzero(periods > _WIDE_GAP * usual).tolist():
        text = f'{_ms(periods[row])} after the stamp above; usual are {_ms(usual)}'
        yield Breach(text, file.path, int(numbers[row + 1]) + 1)


@STAMP_RULES.add(
    'stamps-date',
    WARNING,
    'Stamps are between 2000 and today',
    'check whether the clock of the recorder was set',
)
def _find_implausible(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.stamped()
    latest = time.time_ns() + _DAY_NS
    outliers = np.zeros(0, np.int64) if file.relative else np.flatnonzero(
        (stamps < _EARLIEST_NS) | (stamps > latest)
    )  # fmt: skip
    if len(outliers):
        first = int(outliers[0])
        count = format_count(len(outliers), 'stamp')
        text = f'{count}, the first is {format_stamp(int(stamps[first]))}'
        yield Breach(text, file.path, int(numbers[first]) + 1)


@STAMP_RULES.add(
    'stamps-pair',
    WARNING,
    'Samples of one number are within 50 ms of the scan (raw, synchronized)',
    'check that no line or file is missing: numbers pair the streams',
)
def _find_unpaired(file: StampsFile) -> Iterator[Breach]:
    if file.scans is None or file.ends is not None:
        return
    for number, stamp in file.lines.sound().items():
        scan = file.scans[number] if number < len(file.scans) else None
        if scan is not None and abs(stamp - scan) > _PAIRED_NS:
            text = f'{_ms(abs(stamp - scan))} from the scan of the same number'
            yield Breach(text, file.path, number + 1)


@STAMP_RULES.add(
    'stamps-turn',
    WARNING,
    'Turns of the scanner take up to 1 s, and contain the stamp of their scan',
    'check timestamps_start.txt and timestamps_end.txt',
)
def _find_turns(file: StampsFile) -> Iterator[Breach]:
    if file.ends is None or file.scans is None:
        return
    for number, start in file.lines.sound().items():
        inside = max(number, 0) < min(len(file.ends), len(file.scans))
        end, forward = (file.ends[number], file.scans[number]) if inside else (None, None)
        if end is None or forward is None:
            continue
        if turn_length(start, end) is None or not start <= forward <= end:
            text = (
                f'a turn of {_ms(end - start)}; its scan is {_ms(forward - start)} after its start'
            )
            yield Breach(text, file.path, number + 1)


def _ms(nanoseconds: float) -> str:
    milliseconds = nanoseconds / 1e6
    return f'{milliseconds:.0f} ms' if abs(milliseconds) < 10_000 else f'{milliseconds / 1e3:.0f} s'


# Rules about motion: GPS/IMU packets against each other, and odometry's poses.
#
# Limits, from raw 0001 and 0005, tracking 0000 (oxts) and odometry 00 (4541 poses): positions and
# velocities differ by up to 0.93 m/s (the GPS is corrected now and then), yaw and its rate by 0.027
# rad/s, vf and ve, vn by 0.003 m/s; the mean of az is 9.80 m/s^2, roll and pitch are below 0.05
# rad; poses are at most 1.34 m apart, and orthonormal to 2.4e-7.

_SPEED_OFF = (3.0, 0.3)  # m/s, and as a part of the speed
_YAW_OFF = 0.2
_FORWARD_OFF = 0.1
_GRAVITY, _GRAVITY_OFF = 9.81, 1.5
_STEEPEST_RAD = 0.5
_FASTEST = 100.0
_HARDEST = 60.0
_QUICKEST_TURN = 5.0
_LONGEST_STEP_S = 1.0
_FARTHEST_STEP_M = 5.0
_PERIOD_NS = NS_PER_S // 10
_ORTHONORMAL = 1e-3
_LEANING = np.cos(np.radians(30.0))


@dataclass(frozen=True, eq=False)
class PacketTrack:
    """The packets of a recording.

    Attributes:
        path: The folder, or the file of all packets.
        line_of: Returns the file and line of a packet by number.
        numbers, stamps_ns, packets: The valid packets, ascending.
    """

    path: Path
    line_of: Callable[[int], tuple[Path, int]]
    numbers: Sequence[int]
    stamps_ns: Sequence[int]
    packets: Sequence[OxtsPacket]

    def breach(self, index: int, text: str) -> Breach:
        """Return the breach of a packet."""
        path, line = self.line_of(self.numbers[index])
        return Breach(text, path, line)

    def column(self, name: str) -> Float64Array:
        """Return a column of all packets."""
        return np.array([getattr(packet, name) for packet in self.packets], np.float64)

    @cached_property
    def steps_s(self) -> Float64Array:
        """(N - 1,) seconds between packets; NaN for gaps and stamps that do not ascend."""
        steps: Float64Array = np.diff(np.array(self.stamps_ns, np.int64)).astype(np.float64)
        steps /= NS_PER_S
        return np.where((steps > 0) & (steps <= _LONGEST_STEP_S), steps, np.nan)


OXTS_RULES = RuleTable[PacketTrack](RuleScope.RECORDING)


@OXTS_RULES.add(
    'oxts-position',
    WARNING,
    'Positions move as fast as the velocities say, to 3 m/s and 30 %',
    'the GPS jumped, or packets are missing or in another order',
)
def _find_position(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    world = MercatorWorld.at(track.packets[0])
    xy = np.array([world.pose(packet).translation[:2] for packet in track.packets])
    measured = np.stack([track.column('ve'), track.column('vn')], axis=1)
    measured = (measured[1:] + measured[:-1]) / 2
    velocity = np.diff(xy, axis=0) / track.steps_s[:, None]
    speed = np.linalg.norm(measured, axis=1)
    difference = np.linalg.norm(velocity - measured, axis=1)
    low, share = _SPEED_OFF
    for index in np.flatnonzero(difference > low + share * speed).tolist():
        text = f'the position moves at {np.linalg.norm(velocity[index]):.1f} m/s'
        yield track.breach(index + 1, f'{text}, the velocity is {speed[index]:.1f} m/s')


@OXTS_RULES.add(
    'oxts-yaw',
    WARNING,
    'Yaw turns as fast as the gyroscope says, to 0.2 rad/s',
    'check the axes (east is 0, counter-clockwise) and the order of the packets',
)
def _find_yaw(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    yaw_rate = np.diff(np.unwrap(track.column('yaw'))) / track.steps_s
    rate = track.column('wu')
    rate = (rate[1:] + rate[:-1]) / 2
    for index in np.flatnonzero(np.abs(yaw_rate - rate) > _YAW_OFF).tolist():
        text = f'yaw turns at {yaw_rate[index]:.2f} rad/s, wu is {rate[index]:.2f} rad/s'
        yield track.breach(index + 1, text)


@OXTS_RULES.add(
    'oxts-forward',
    WARNING,
    'vf is ve cos(yaw) + vn sin(yaw), to 0.1 m/s',
    'check the columns and axes of the packet',
)
def _find_forward(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    yaw, east, north = (track.column(name) for name in ('yaw', 've', 'vn'))
    forward = east * np.cos(yaw) + north * np.sin(yaw)
    vf = track.column('vf')
    for index in np.flatnonzero(np.abs(forward - vf) > _FORWARD_OFF).tolist():
        text = f'vf is {vf[index]:.2f} m/s; ve, vn and yaw make {forward[index]:.2f} m/s'
        yield track.breach(index, text)


@OXTS_RULES.add(
    'oxts-gravity',
    WARNING,
    'az contains gravity: its mean is 9.81 m/s^2, to 1.5 m/s^2',
    'KITTI has accelerations with gravity; add it',
)
def _find_gravity(track: PacketTrack) -> Iterator[Breach]:
    if not track.packets:
        return
    mean = float(track.column('az').mean())
    if abs(mean - _GRAVITY) > _GRAVITY_OFF:
        yield Breach(f'the mean of az is {mean:.2f} m/s^2', track.path)


@OXTS_RULES.add(
    'oxts-extreme',
    WARNING,
    'Speeds are below 100 m/s, accelerations 60 m/s^2, rates 5 rad/s, roll and pitch 0.5 rad',
    'check the units: radians, metres and seconds',
)
def _find_extremes(track: PacketTrack) -> Iterator[Breach]:
    limits = {
        **dict.fromkeys(('vn', 've', 'vf', 'vl', 'vu'), _FASTEST),
        **dict.fromkeys(('ax', 'ay', 'az'), _HARDEST),
        **dict.fromkeys(('wx', 'wy', 'wz'), _QUICKEST_TURN),
        **dict.fromkeys(('roll', 'pitch'), _STEEPEST_RAD),
    }
    for name, limit in limits.items() if track.packets else ():
        values = track.column(name)
        for index in np.flatnonzero(np.abs(values) > limit).tolist():
            text = f'{name} is {values[index]:g}; vehicles reach {limit:g}'
            yield track.breach(index, text)


@dataclass(frozen=True, eq=False)
class PosesFile:
    """A file of poses.

    Attributes:
        path: The file.
        lines: (3, 4) matrices.
        numbers: The frame of each line.
        level: Whether the world's z is up.
        stamps_ns: Stamps by frame, as far as known.
    """

    path: Path
    lines: Lines[Float64Array]
    numbers: Sequence[int]
    level: bool = False
    stamps_ns: Mapping[int, int] = field(default_factory=dict)


POSE_RULES = RuleTable[PosesFile](RuleScope.RECORDING)


@POSE_RULES.add(
    'pose-line',
    ERROR,
    'Lines of poses are twelve finite numbers, in KITTI-360 after the frame, which is listed once',
    'correct the line, or copy the file again',
)
def _find_invalid_poses(file: PosesFile) -> Iterator[Breach]:
    for error in file.lines.errors.values():
        yield breach_of(error, file.path)


@POSE_RULES.add(
    'pose-rotation',
    ERROR,
    'Rotations of poses are orthonormal to 1e-3',
    'write 3x4 matrices [R | t], row by row',
)
def _find_bent_poses(file: PosesFile) -> Iterator[Breach]:
    for line, pose in file.lines.sound().items():
        rotation = pose[:, :3]
        error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if error > _ORTHONORMAL or np.linalg.det(rotation) < 0:
            yield Breach(f'the rotation is not orthonormal, by {error:.1g}', file.path, line + 1)


@POSE_RULES.add(
    'pose-tilt',
    WARNING,
    'Vehicles lean by less than 30 degrees, and z of the GPS/IMU is down (KITTI-360)',
    'beyond 60 degrees a pose is left out, such as the first one of drive 0004',
)
def _find_tilted(file: PosesFile) -> Iterator[Breach]:
    for line, pose in file.lines.sound().items() if file.level else ():
        cosine = max(-1.0, -float(pose[2, 2]))
        if cosine < _LEANING:
            angle = np.degrees(np.arccos(cosine))
            yield Breach(f'the vehicle leans by {angle:.0f} degrees', file.path, line + 1)


@POSE_RULES.add(
    'pose-jump',
    WARNING,
    'Poses are less than 5 m a frame apart, or 50 m/s',
    'lines are missing, or the trajectory jumps',
)
def _find_pose_jumps(file: PosesFile) -> Iterator[Breach]:
    poses = file.lines.sound()
    for line, pose in poses.items():
        if line - 1 in poses:
            before, after = file.numbers[line - 1], file.numbers[line]
            distance = float(np.linalg.norm(pose[:, 3] - poses[line - 1][:, 3]))
            first_ns = file.stamps_ns.get(before)
            length_ns = 0 if first_ns is None else file.stamps_ns.get(after, first_ns) - first_ns
            periods = max(abs(after - before), length_ns / _PERIOD_NS)
            if distance > _FARTHEST_STEP_M * periods:
                yield Breach(f'{distance:.1f} m from the pose above', file.path, line + 1)


@POSE_RULES.add(
    'pose-order',
    WARNING,
    'Frames of poses ascend (KITTI-360)',
    'check whether lines of two files were joined; poses are read by frame',
)
def _find_pose_order(file: PosesFile) -> Iterator[Breach]:
    lines = list(file.lines.sound())
    for before, line in pairwise(lines):
        if file.numbers[line] < file.numbers[before]:
            text = f'frame {file.numbers[line]} after frame {file.numbers[before]}'
            yield Breach(text, file.path, line + 1)
