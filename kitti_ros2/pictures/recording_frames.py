# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a recording: of a KITTI folder, or of a bag."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from ..bags.open_source import open_source
from ..drawing.labelled_objects import LABEL_CAMERA, colour_pixels, objects_of
from ..files.image_files import decode_image
from ..kitti.kitti_recording import KittiRecording
from ..kitti.prepare import scan_at
from ..messages.naming import base_t_imu, map_from_world, pose_in_map
from ..model.errors import (
    BadFileError,
    KittiRos2Error,
    MissingDataError,
    UsageError,
    describe_error,
    describe_frames,
)
from ..model.recording import BY_POSITION
from ..model.samples import (
    NONE,
    Calibration,
    FrameLabels,
    Image,
    OxtsPacket,
    Pose,
    Scan,
    default_tolerance_ns,
    has_complete_labels,
    match_frames,
)
from ..model.streams import CAMERA_COUNT, FRAME_STREAMS, IMAGE_STREAMS, Clock, Stream
from ..options.messages import MapFrame, MessageOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy.typing as npt
    from typing_extensions import TypeIs

    from ..drawing.labelled_objects import LabelledObject, Pixels
    from ..importer.planned_recording import PlannedRecording
    from ..model.errors import Loss
    from ..model.geometry import Float64Array, Transform
    from ..model.recording import FrameOrigin
    from ..model.samples import Float32Array, Int64Array, Sample
    from ..options.read import ReadOptions
    from ..own_bags.recording import NumberedRecording


# One decoded frame of a recording or a bag, the input of all pictures.

POINT_LABELS = 'point_labels'
"""The name of labels of points among missing data."""


@dataclass(frozen=True, eq=False)
class FrameData:
    """The data of one frame.

    Attributes:
        source: Display name of the recording.
        number: KITTI file number; in a bag not written by to-bag, the index of the frame from 0.
        stamp_ns: Nanoseconds since 1970 of the stream that frames are counted by.
        images: (H, W, 3) uint8 BGR by KITTI camera index, read-only; grey ones have three equal
            channels.
        points: (N, 4) float32 x y z in metres in velo_link and reflectance 0..1; None without.
        point_labels: (N,) SemanticKITTI labels of the points; None without, or if not read.
        calibration: Calibration of this frame, None without any.
        objects: Labels.
        labelled: True if the frame has labels, possibly none of an object.
        predictions: Objects found by a detector, drawn in a second style.
        packet: Packet of the GPS/IMU, if any.
        pose: Pose of the vehicle, if known.
        path: (N, 3) positions of the vehicle up to this frame, in the frame of its pose, metres;
            None without poses, or if not read.
        imaged, scanned: True if the recording has images and scans, this frame's or others.
        timed: True if the layout has times; otherwise stamps are nominal.
        missing: Missing or unreadable data of this frame: name to the reason, one line.
    """

    source: str
    number: int
    stamp_ns: int
    images: Mapping[int, Pixels]
    points: Float32Array | None = None
    point_labels: npt.NDArray[np.uint32] | None = None
    calibration: Calibration | None = None
    objects: Sequence[LabelledObject] = ()
    labelled: bool = False
    predictions: Sequence[LabelledObject] = ()
    packet: OxtsPacket | None = None
    pose: Pose | None = None
    path: Float64Array | None = None
    imaged: bool = True
    scanned: bool = True
    timed: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)


if TYPE_CHECKING:
    Readable: TypeAlias = NumberedRecording | PlannedRecording

S = TypeVar('S')


def _is_planned(recording: Readable) -> TypeIs[PlannedRecording]:
    """Return whether a recording has no KITTI numbers: its frames are numbered by position."""
    return recording.layout is None


class RecordingFrames:
    """The frames of a recording by number; frame may be called from several threads at once.

    If the same number is the same time in all streams, every number is a frame. In a raw extract
    the scans are the frames, with the nearest sample of each other stream within half their period.

    Attributes:
        name: Display name, such as ``raw 2011_09_26_drive_0005_sync`` or a bag's file name.
        numbers: (N,) int64, ascending.
        stamps_ns: (N,) int64, of the frames.
        streams: Stream name (samples.Stream values) to (N,) int64, the frames that have a sample.
        base_t_imu: imu_link in base_link, or in the body that the poses of a bag are of.
        origins: By number the raw drive's frame of an object set in real time; else empty.
        losses: Data missing or damaged from the start, by stream or topic.
        guess_notes: Guesses that may make pictures wrong, such as axes; one line each.
        notes: Other notes; one line each.

    Raises:
        MissingDataError: The recording has neither images nor scans nor labels.
    """

    def __init__(self, recording: Readable) -> None:
        if isinstance(recording, KittiRecording):
            self.name = f'{recording.layout.value} {recording.name}'
            self.base_t_imu = base_t_imu(MessageOptions())
        else:
            self.name, self.base_t_imu = recording.root.name, recording.base_t_imu
        self.origins: Mapping[int, FrameOrigin] = recording.origins
        self.losses: Sequence[Loss] = recording.losses
        self.guess_notes: Sequence[str] = ()
        self.notes: Sequence[str] = recording.notes
        self.recording = recording
        self._reading_poses = Lock()
        order = recording.streams if _is_planned(recording) else FRAME_STREAMS
        streams = [stream for stream in order if stream in recording.streams]
        if not streams:
            raise MissingDataError(
                f'{recording.root}: has no stream that pictures could be made of'
            )
        if recording.common_numbers:
            self.numbers, self.stamps_ns = _common(recording, streams)
            self._samples = {stream: _same(recording.streams[stream].numbers) for stream in streams}
        else:
            reference = recording.streams[streams[0]]
            self.numbers, self.stamps_ns = reference.numbers, reference.stamps_ns
            self._samples = _nearest(recording, streams)
        self.streams: Mapping[str, Int64Array] = {
            stream.value: np.array([*files], dtype=np.int64)
            for stream, files in self._samples.items()
        }
        if _is_planned(recording):
            self.guess_notes = [*recording.guess_notes, BY_POSITION]
            self._samples[Stream.POSE] = _same(self.numbers)

    @cached_property
    def cameras(self) -> Mapping[int, str]:
        """KITTI camera index to name, of cameras with images."""
        return self.recording.cameras

    @property
    def main_camera(self) -> int:
        """The camera of pictures by default, if it has images."""
        layout = self.recording.layout
        return LABEL_CAMERA if layout is None else layout.traits.main_camera

    @cached_property
    def _map_t_world(self) -> Transform:
        return map_from_world(self.recording.start, self.base_t_imu, MapFrame.ENU)

    def frame(self, number: int, streams: frozenset[str] | None = None) -> FrameData:
        """Return the frame with a number.

        Args:
            number: One of numbers.
            streams: Streams to read (samples.Stream values such as image_2, scan, labels); by
                default all but path, which takes the poses of all frames.

        Raises:
            UsageError: The frame does not exist.
        """
        index = int(np.searchsorted(self.numbers, number))
        if index == len(self.numbers) or self.numbers[index] != number:
            raise UsageError(
                f'{self.name} has no frame {number}; it has {describe_frames(self.numbers)}'
            )
        calibration = self.recording.calibration(number)
        missing = self._missing_calibration(calibration)
        samples: dict[Stream, Sample] = {}
        images: dict[int, Pixels] = {}
        for stream in self._samples:
            if not _is_requested(stream, streams):
                continue
            try:
                if stream.camera is None:
                    sample = self.read(stream, number)
                    samples |= {} if sample is None else {stream: sample}
                else:
                    pixels = self.pixels(stream.camera, number)
                    images |= {} if pixels is None else {stream.camera: pixels}
            except (KittiRos2Error, OSError) as error:
                missing[stream.value] = describe_error(error)
        scan = _of(samples, Stream.SCAN, Scan)
        for reason in scan.missing.values() if scan else ():
            missing[POINT_LABELS] = reason
        labels = _of(samples, Stream.LABELS, FrameLabels) or FrameLabels()
        missing |= {f'labels {row}': reason for row, reason in labels.missing.items()}
        return FrameData(
            source=self.name,
            number=number,
            stamp_ns=int(self.stamps_ns[index]),
            images=images,
            points=None if scan is None else scan.points,
            point_labels=None if scan is None or scan.missing else scan.labels,
            calibration=None if _is_empty(calibration) else calibration,
            objects=objects_of(labels, calibration),
            labelled=Stream.LABELS in samples
            or (_is_requested(Stream.LABELS, streams) and number in self.without_objects),
            packet=_of(samples, Stream.OXTS, OxtsPacket),
            path=self._path(index, missing) if _is_path_requested(streams) else None,
            imaged=bool(self.cameras),
            scanned=Stream.SCAN in self.recording.streams,
            pose=_of(samples, Stream.POSE, Pose),
            timed=self.recording.clock is Clock.UTC,
            missing=missing,
        )

    def _missing_calibration(self, calibration: Calibration) -> dict[str, str]:
        """Return the missing parts of a frame's calibration, but for those of absent cameras."""
        if _is_planned(self.recording):
            return dict(self.recording.no_calibration)
        absent = {f'P{index}' for index in range(CAMERA_COUNT) if index not in self.cameras}
        return {
            f'calibration {part}': reason
            for part, reason in calibration.missing.items()
            if part not in absent
        }

    def read(self, stream: Stream, number: int) -> Sample | None:
        """Read one sample of a frame, a pose in map; None if the frame has none.

        Raises:
            KittiRos2Error: It cannot be read.
            OSError: It cannot be read.
        """
        files = self._samples.get(stream, {})
        if number not in files:
            return None
        sample = self.recording.read(stream, files[number])
        return pose_in_map(sample, self._map_t_world) if isinstance(sample, Pose) else sample

    def scan_at(self, number: int, stamp_ns: int) -> Scan | None:
        """Read the scan of a frame, compensated to one time; None if the frame has none.

        Raises:
            MissingDataError: The motion, or the time of the points, is unknown.
            KittiRos2Error: It cannot be read.
            OSError: It cannot be read.
        """
        if _is_planned(self.recording):
            raise MissingDataError(
                f'{self.name}: to-bag did not write it, so the time of the points is not known'
            )
        scans = self._samples.get(Stream.SCAN, {})
        return scan_at(self.recording, scans[number], stamp_ns) if number in scans else None

    def pixels(self, camera: int, number: int) -> Pixels | None:
        """Decode the image of a camera, (H, W, 3) uint8 BGR; None if the frame has none.

        Raises:
            KittiRos2Error: It cannot be decoded.
            OSError: It cannot be read.
        """
        if _is_planned(self.recording):
            return self.recording.pixels(camera, number)
        stream = IMAGE_STREAMS[camera]
        image = self.read(stream, number)
        if not isinstance(image, Image):
            return None
        try:
            return colour_pixels(decode_image(image))
        except ValueError as error:
            path = self.recording.path(stream, self._samples[stream][number])
            raise BadFileError(path, str(error), 'a whole PNG') from None

    def calibration(self, number: int) -> Calibration | None:
        """Return the calibration of a frame, None without any."""
        calibration = self.recording.calibration(number)
        return None if _is_empty(calibration) else calibration

    def close(self) -> None:
        """Release files; those of a folder are open only while they are read."""
        if not isinstance(self.recording, KittiRecording):
            self.recording.close()

    def _path(self, index: int, missing: dict[str, str]) -> Float64Array | None:
        """Return (N, 3) positions up to a frame, by its index; None without any."""
        with self._reading_poses:
            numbers, positions, failures = self._all_positions
        if not _is_planned(self.recording):
            poses = self._samples.get(Stream.POSE, {})
            number = int(self.numbers[index])
            last = max((pose for frame, pose in poses.items() if frame <= number), default=-1)
        else:
            last = int(self.stamps_ns[index])
        reason = next((why for failed, why in failures.items() if failed <= last), None)
        if reason is not None:
            missing[Stream.PATH.value] = f'poses are left out of the path; the first: {reason}'
        driven = positions[numbers <= last]
        return driven if len(driven) else None

    @cached_property
    def _all_positions(self) -> tuple[Int64Array, Float64Array, dict[int, str]]:
        """Numbers and (N, 3) positions of all poses; the reason by number of unreadable ones.

        In a bag not written by to-bag poses have no numbers, but stamps.
        """
        by_number: dict[int, Float64Array] = {}
        failures: dict[int, str] = {}
        if _is_planned(self.recording):
            track = self.recording.trajectory()
            positions = [pose.translation for pose in track.world_T_imu]
            by_number = dict(zip(track.stamps_ns.tolist(), positions, strict=True))
        index = self.recording.streams.get(Stream.POSE)
        for number in () if index is None else index.numbers.tolist():
            try:
                pose = self.recording.read(Stream.POSE, number)
            except (KittiRos2Error, OSError) as error:
                failures[number] = describe_error(error)
                continue
            if isinstance(pose, Pose):
                by_number[number] = pose_in_map(pose, self._map_t_world).world_T_imu.translation
        every = np.array([*by_number.values()], np.float64).reshape(-1, 3)
        return np.array([*by_number], np.int64), every, failures

    @cached_property
    def without_objects(self) -> frozenset[int]:
        """The frames of a labelled recording that have no label because they have no object."""
        labelled, layout = self._samples.get(Stream.LABELS), self.recording.layout
        if labelled is None or layout is None or not has_complete_labels(layout, self.losses):
            return frozenset()
        return frozenset(self.numbers.tolist()) - labelled.keys()


def _is_path_requested(streams: frozenset[str] | None) -> bool:
    return streams is not None and Stream.PATH.value in streams


def _is_requested(stream: Stream, streams: frozenset[str] | None) -> bool:
    return streams is None or stream.value in streams


def _same(numbers: Int64Array) -> dict[int, int]:
    return {number: number for number in numbers.tolist()}


def _nearest(recording: Readable, streams: Sequence[Stream]) -> dict[Stream, dict[int, int]]:
    """Map stream and frame to the number of the sample nearest to that of the first stream."""
    reference = recording.streams[streams[0]]
    matches = match_frames(
        reference.stamps_ns,
        {stream: recording.streams[stream].stamps_ns for stream in streams},
        default_tolerance_ns(reference.stamps_ns),
    )
    nearest = {}
    for stream, match in matches.items():
        frames = np.flatnonzero(match.indices != NONE)
        own = recording.streams[stream].numbers[match.indices[frames]]
        nearest[stream] = dict(zip(reference.numbers[frames].tolist(), own.tolist(), strict=True))
    return nearest


def _common(recording: Readable, streams: Sequence[Stream]) -> tuple[Int64Array, Int64Array]:
    """Return all numbers and their stamps, each of the first stream that has it."""
    index = recording.streams
    every = np.concatenate([index[stream].numbers for stream in streams])
    stamps = np.concatenate([index[stream].stamps_ns for stream in streams])
    numbers, first = np.unique(every, return_index=True)
    return numbers, stamps[first]


def _is_empty(calibration: Calibration) -> bool:
    return not calibration.cameras and calibration.cam0_T_velo is None


def _of(samples: Mapping[Stream, Sample], stream: Stream, kind: type[S]) -> S | None:
    sample = samples.get(stream)
    return sample if isinstance(sample, kind) else None


# Opening of the source of pictures: a KITTI folder or a bag.


def open_frames(path: Path, options: ReadOptions) -> RecordingFrames:
    """Open the frames of a KITTI folder or a bag.

    Raises:
        UsageError: The path does not exist.
        KittiRos2Error: The source cannot be read, or contains nothing to draw.
    """
    source = open_source(path, options)
    if isinstance(source, KittiRecording):
        return RecordingFrames(source)
    # Readers of bags take 0.1 s to import, and a folder needs none of it.
    from ..importer.survey import survey_bags  # noqa: PLC0415
    from ..own_bags.recording import open_own_recording  # noqa: PLC0415

    with source as bag:  # the frames keep its files open until they are closed
        survey = survey_bags([bag])
        own = open_own_recording(bag, survey)
        if own is not None:
            return RecordingFrames(own)
        from ..importer.planned_recording import PlannedRecording  # noqa: PLC0415 - as above

        return RecordingFrames(PlannedRecording(bag, survey))
