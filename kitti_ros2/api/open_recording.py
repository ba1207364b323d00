# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording opened for reading in Python: frames by number, lazily, and their objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np

from ..drawing.labelled_objects import objects_of
from ..files.image_files import decode_image, encode_png
from ..files.remote import as_path, is_remote
from ..model.boxes import cuboid_corners
from ..model.errors import (
    KittiRos2Error,
    MissingDataError,
    UsageError,
    describe_error,
    format_numbers,
)
from ..model.geometry import rotation_to_rpy
from ..model.samples import PNG, FrameLabels, Image, OxtsPacket, Pose, Scan
from ..model.streams import CAMERA_COUNT, IMAGE_STREAMS, LABEL_IMAGES, LABEL_STREAMS, Stream
from .arguments import OpenSource, warn

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy.typing as npt
    from typing_extensions import Self, Unpack

    from ..drawing.labelled_objects import LabelledObject, Pixels
    from ..model.boxes import Box, Cuboid
    from ..model.errors import Loss
    from ..model.geometry import Float64Array
    from ..model.recording import FrameOrigin
    from ..model.samples import Float32Array, Int64Array, LineScan, Sample
    from ..options.keywords import ReadKeywords
    from .calibration import CalibratedRig


# A labelled object of a frame, in any coordinate frame.


class FrameObject:
    """One labelled object.

    Attributes:
        class_name: Car, Van, Truck, Pedestrian, Person_sitting, Cyclist, Tram, Misc, DontCare, or
            a word of the data set's own.
        box_2d: left, top, right, bottom in pixels of camera 2; None without one (tracklets).
        alpha: Observation angle, radians; None without one.
        truncated: 0..1 (tracking: 0, 1, 2), None if unknown.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown; None without a value.
        track: Identity across frames, None without one.
        score: Score of a detection; None for ground truth.
        label: The line of the label file, None for tracklets and objects of other bags.
    """

    def __init__(
        self,
        labelled: LabelledObject,
        label: Box | None,
        transform: Callable[[str | int, str | int], Float64Array],
    ) -> None:
        self._cuboid = labelled.cuboid
        self._transform = transform
        self.class_name = labelled.class_name
        self.box_2d = labelled.box_2d
        self.alpha = None if label is None or label.alpha < -np.pi - 1 else label.alpha
        self.truncated = labelled.truncated
        self.occluded = labelled.occluded
        if labelled.cuboid is not None and labelled.occluded is None:
            self.occluded = labelled.cuboid.occluded
        self.track = labelled.track_id
        self.score = labelled.score
        self.label = label

    @property
    def has_box(self) -> bool:
        """True if it has a 3D box; DontCare regions and 2D detections have none."""
        return self._cuboid is not None

    @property
    def box(self) -> Float64Array:
        """(7,) float64 in velo_link: centre x y z, length, width, height in metres, yaw in radians.

        The form of OpenPCDet and mmdetection3d: the centre is the middle of the box, and the yaw is
        about z, 0 along x. The box may be tilted against velo_link by about a degree, see pose.

        Raises:
            MissingDataError: It has no 3D box.
        """
        cuboid = self._need()
        _, _, yaw = rotation_to_rpy(cuboid.velo_T_box.rotation)
        return np.array([*cuboid.velo_T_box.translation, *cuboid.size_lwh, yaw])

    def pose(self, frame: str | int = 'velo_link') -> Float64Array:
        """Return frame_T_box, (4, 4): the middle of the box, x along its heading, y left, z up.

        Args:
            frame: Coordinate frame, as in Frame.transform.

        Raises:
            MissingDataError: It has no 3D box, or the transform is missing.
        """
        box = self._need().velo_T_box.matrix()
        if frame == 'velo_link':
            return box
        frame_T_box: Float64Array = self._transform(frame, 'velo_link') @ box
        return frame_T_box

    def corners(self, frame: str | int = 'velo_link') -> Float64Array:
        """Return the corners of the 3D box, (8, 3) metres.

        The bottom face first, then the top face; each from front left, front right, rear right to
        rear left, seen along the heading.

        Args:
            frame: Coordinate frame, as in Frame.transform.

        Raises:
            MissingDataError: It has no 3D box, or the transform is missing.
        """
        corners: Float64Array = cuboid_corners([self._need()])[0]
        if frame == 'velo_link':
            return corners
        matrix = self._transform(frame, 'velo_link')
        frame_corners: Float64Array = corners @ matrix[:3, :3].T + matrix[:3, 3]
        return frame_corners

    def _need(self) -> Cuboid:
        if self._cuboid is None:
            raise MissingDataError(
                f'{self.class_name}: no 3D box: it is a 2D region, or the calibration is missing'
            )
        return self._cuboid

    def __repr__(self) -> str:
        track = '' if self.track is None else f' {self.track}'
        return f'<kitti_ros2.FrameObject {self.class_name}{track}>'


# One frame of a recording: each part is read when first used.


class Frame:
    """The data of one frame; each part is read when first used.

    Attributes:
        number: KITTI's file number; in bags of others the position, from 0.
        source: The open files of its recording.
    """

    def __init__(self, source: OpenSource, number: int) -> None:
        self.source = source
        self.number = number

    @cached_property
    def stamp_ns(self) -> int:
        """Nanoseconds since 1970 UTC of the scan, or of the first stream that has the frame.

        Nominal in layouts without time (object, tracking): frames at an assumed period. Object sets
        opened with real_time=True have the stamps of their raw drives.
        """
        frames = self.source.frames
        return int(frames.stamps_ns[np.searchsorted(frames.numbers, self.number)])

    @property
    def streams(self) -> tuple[str, ...]:
        """The streams with this frame: scan, image_2, oxts, pose, labels, ..."""
        streams = self.source.frames.streams.items()
        return tuple(name for name, numbers in streams if self.number in numbers)

    @property
    def origin(self) -> FrameOrigin | None:
        """The original frame of the raw drive: drive, number and stamp_ns.

        For object sets opened with real_time=True, and their bags; else None.
        """
        return self.source.frames.origins.get(self.number)

    @cached_property
    def points(self) -> Float32Array:
        """The scan: (N, 4) float32, x y z in metres in velo_link, and reflectance 0..1.

        velo_link: x forward, y left, z up. The array is writable and owns its data, so
        torch.from_numpy and open3d.core.Tensor.from_numpy take it without a copy.

        Raises:
            MissingDataError: The frame has no scan.
            KittiRos2Error: The file is truncated.
        """
        points = self._scan.points
        return points if points.flags.writeable else points.copy()

    @property
    def extra(self) -> dict[str, npt.NDArray[np.floating[Any]]]:
        """Additional columns of the scan by name, (N,) float32 or float64, such as ring.

        For recordings opened with columns='x y z intensity ring', and their bags; else empty.

        Raises:
            MissingDataError, KittiRos2Error: As points.
        """
        return dict(self._scan.extra)

    def points_at(self, stamp_ns: int) -> Float32Array:
        """Return the points as if measured at one time: motion compensation.

        Each point is moved by the motion of the car between its own time, which follows from its
        azimuth, and that time. The surroundings are assumed to be static.

        Args:
            stamp_ns: Nanoseconds since 1970 UTC, such as `stamp_ns` of the frame, at which the
                scanner faces forward, or the stamp of an image.

        Returns:
            (N, 4) float32, x y z in velo_link at that time and reflectance, in the order of
            `points`.

        Raises:
            MissingDataError: The frame has no scan, or no oxts packets or poses near it, as in the
                object layout; or the source is a bag of others.

        Examples:
            >>> points = frame.points_at(frame.stamp_ns)
        """
        scan = self.source.frames.scan_at(self.number, stamp_ns)
        if scan is None:
            raise self._no('scan', Stream.SCAN.value)
        return scan.points

    @cached_property
    def point_labels(self) -> npt.NDArray[np.uint32]:
        """SemanticKITTI's label of each point, (N,) uint32: low 16 bits class, high 16 instance.

        Raises:
            MissingDataError: The recording was not opened with semantic=True, or has no labels.
        """
        labels = self._scan.labels
        if labels is None:
            reason = next(iter(self._scan.missing.values()), 'open it with semantic=True')
            raise MissingDataError(f'{self._name}: no labels of points: {reason}')
        return labels

    def image(self, camera: int = 2) -> Pixels:
        """Decode the image of a camera.

        Args:
            camera: KITTI's number: 0 and 1 are grey, 2 (left) and 3 (right) colour.

        Returns:
            (H, W, 3) uint8, RGB; of grey cameras all three channels are equal.

        Raises:
            MissingDataError: The image is missing.
            KittiRos2Error: The image is damaged.
        """
        _check_camera(camera)
        pixels = self.source.frames.pixels(camera, self.number)
        if pixels is None:
            raise self._no(f'image of camera {camera}', f'image_{camera}')
        return np.ascontiguousarray(pixels[..., ::-1])

    def png(self, camera: int = 2) -> bytes:
        """Return the PNG file of an image; the file's own bytes if the image is a PNG.

        Raises:
            MissingDataError: The frame has no image of it.
        """
        _check_camera(camera)
        image = cast('Image', self._need(IMAGE_STREAMS[camera], f'image of camera {camera}'))
        return image.data if image.format == PNG else encode_png(decode_image(image))

    def label_image(
        self, kind: str = 'semantic', camera: int = 0
    ) -> npt.NDArray[np.uint8 | np.uint16]:
        """Decode a label image of KITTI-360.

        Args:
            kind: semantic (the id of the class), semantic_rgb, instance (id * 1000 + instance), or
                confidence.
            camera: KITTI's number, 0 or 1.

        Returns:
            (H, W), or (H, W, 3) RGB, with the bits of the file.

        Raises:
            MissingDataError: The frame has none.
            KittiRos2Error: The image is damaged.
        """
        streams = {stream.label_image: stream for stream in LABEL_STREAMS}
        stream = streams.get((kind, camera))
        if stream is None:
            kinds = ', '.join(LABEL_IMAGES)
            raise UsageError(f'no label image {kind} of camera {camera}; there are {kinds} of 0, 1')
        recording = self.source.frames.recording
        index = recording.streams.get(stream)
        if index is None or self.number not in index.numbers:
            have = f'{0 if index is None else len(index)} other frames do'
            raise MissingDataError(f'{self._name}: no {kind} image of camera {camera} ({have})')
        pixels = decode_image(cast('Image', recording.read(stream, self.number)))
        return np.ascontiguousarray(pixels[..., ::-1] if pixels.ndim == 3 else pixels)

    @cached_property
    def calibration(self) -> CalibratedRig | None:
        """The calibration of this frame, None if the recording has none."""
        frames = self.source.frames
        calibration = frames.calibration(self.number)
        if calibration is None:
            return None
        from .calibration import CalibratedRig  # noqa: PLC0415 - 0.1 s, of ROS messages

        return CalibratedRig(calibration, base_t_imu=frames.base_t_imu, camera_names=frames.cameras)

    @cached_property
    def pose(self) -> Float64Array | None:
        """map_T_base, (4, 4) float64: the pose of base_link in map, metres; None without one.

        map is x east, y north, z up, its origin the first base_link position of the recording;
        without gravity (odometry) it is base_link at the first pose.
        """
        pose = self.source.frames.read(Stream.POSE, self.number)
        if not isinstance(pose, Pose):
            return None
        map_t_base = pose.world_T_imu @ self.source.frames.base_t_imu.inverse()
        return map_t_base.matrix()

    @cached_property
    def oxts(self) -> OxtsPacket | None:
        """The packet of the GPS/IMU, KITTI's 30 values by name; None without one."""
        packet = self.source.frames.read(Stream.OXTS, self.number)
        return packet if isinstance(packet, OxtsPacket) else None

    @cached_property
    def objects(self) -> list[FrameObject]:
        """The labelled objects, in the order of the file; DontCare regions have a 2D box only.

        Invalid lines are skipped with a KittiRos2Warning.
        """
        labels = self.source.frames.read(Stream.LABELS, self.number)
        if not isinstance(labels, FrameLabels):
            return []
        for reason in labels.missing.values():
            warn(reason)
        rig = self.calibration
        labelled = objects_of(labels, None if rig is None else rig.model)
        lines: list[Box | None] = [box for box in labels.boxes if box is not None]
        pairs = zip(labelled, lines or [None] * len(labelled), strict=True)
        return [FrameObject(*pair, self.transform) for pair in pairs]

    def transform(self, target: str | int, source: str | int) -> Float64Array:
        """Return target_T_source, (4, 4) float64: maps points given in source to target.

        Args:
            target: map, base_link, imu_link, velo_link, sick_link, or KITTI's number of a camera
                for its optical frame (x right, y down, z forward).
            source: A coordinate frame, as target.

        Raises:
            MissingDataError: A frame is unknown, or calibration or pose is missing.

        Examples:
            >>> map_T_velo = frame.transform('map', 'velo_link')
        """
        rig = self.calibration
        if rig is None:
            raise self._no('calibration', 'calibration')
        return rig.transform(target, source, map_T_base=self.pose)

    @cached_property
    def _scan(self) -> Scan:
        return cast('Scan', self._need(Stream.SCAN, 'scan'))

    def _need(self, stream: Stream, what: str) -> Sample:
        sample = self.source.frames.read(stream, self.number)
        if sample is None:
            raise self._no(what, stream.value)
        return sample

    def _no(self, what: str, stream: str) -> MissingDataError:
        numbers = self.source.frames.streams.get(stream)
        there = 'the recording has none' if numbers is None else f'{len(numbers)} other frames do'
        return MissingDataError(f'{self._name}: no {what} ({there})')

    @property
    def _name(self) -> str:
        return f'{self.source.path}: frame {self.number}'

    def __repr__(self) -> str:
        return f'<kitti_ros2.Frame {self.number} of {self.source.frames.name}>'


def _check_camera(camera: int) -> None:
    if camera not in range(CAMERA_COUNT):
        raise UsageError(f'camera {camera}; expected one of KITTI: 0 to {CAMERA_COUNT - 1}')


# A recording opened for reading in Python: frames by number, lazily.


@dataclass(frozen=True, eq=False)
class PoseSeries:
    """The poses of a recording.

    Attributes:
        numbers: (N,) int64, the frames that have a pose.
        stamps_ns: (N,) int64, nanoseconds since 1970 UTC.
        map_T_base: (N, 4, 4) float64, poses of base_link in map, metres.
    """

    numbers: Int64Array
    stamps_ns: Int64Array
    map_T_base: Float64Array


def open(path: str | os.PathLike[str], **options: Unpack[ReadKeywords]) -> Recording:  # noqa: A001
    """Open a KITTI folder (all layouts, KITTI-360 too) or a bag (MCAP, sqlite3, ROS 1).

    Frames of a folder, and of a bag written by to-bag, have KITTI's file numbers. Frames of other
    bags are numbered by position, from 0; topics and calibration are detected as by to-kitti.

    Args:
        path: A folder or a bag. `sequence` chooses from several drives or sequences.
        options: Reading options of the command line: layout, sequence, columns, epoch,
            semantic, period, scan_stamp, real_time, mapping, raw, deskew, undo_deskew.

    Raises:
        FileNotFoundError: The path does not exist; it is a KittiRos2Error as well.
        KittiRos2Error: The path is no KITTI folder or bag, or an option is invalid.

    Examples:
        >>> recording = kitti_ros2.open('2011_09_26/2011_09_26_drive_0005_sync')
        >>> recording[0].number, recording[0].points.shape
        (0, (..., 4))
    """
    source_path = as_path(path)
    if is_remote(source_path):
        from ..files.remote_reads import forget  # noqa: PLC0415 - for URLs only

        forget(source_path)  # possibly changed since an earlier call
    source = OpenSource(source_path, options)
    recording = Recording(source, source.frames.numbers)
    if recording.losses:
        count = len(recording.losses)
        warn(f'{recording.losses[0].text()} (1 of {count}; see losses of the recording)')
    return recording


class Recording(Sequence[Frame]):
    """The frames of a recording, in the order of their numbers; opened by kitti_ros2.open.

    Indices are positions, as in any sequence; `frame(8)` takes KITTI's file number. A slice is a
    recording of fewer frames. Frames are read when used and not cached: iterating holds one in
    memory. Recordings can be pickled, and used in worker processes.
    """

    def __init__(self, source: OpenSource, numbers: Int64Array) -> None:
        self._source = source
        self._numbers = numbers

    @property
    def path(self) -> Path:
        """The folder or bag."""
        return self._source.path

    @property
    def name(self) -> str:
        """Layout and name of the drive, split or sequence, or the file name of a bag."""
        return self._source.frames.name

    @property
    def numbers(self) -> Int64Array:
        """(N,) int64 KITTI file numbers of the frames, ascending, possibly with gaps."""
        return np.array(self._numbers)

    @property
    def stamps_ns(self) -> Int64Array:
        """(N,) int64 nanoseconds since 1970 UTC; nominal in layouts without time."""
        frames = self._source.frames
        stamps: Int64Array = frames.stamps_ns[np.searchsorted(frames.numbers, self._numbers)]
        return stamps

    @property
    def streams(self) -> dict[str, Int64Array]:
        """The frames of each stream by name: scan, image_2, oxts, pose, labels, ..."""
        streams = self._source.frames.streams.items()
        return {name: np.intersect1d(numbers, self._numbers) for name, numbers in streams}

    @property
    def cameras(self) -> dict[int, str]:
        """KITTI's numbers of cameras with images, to their names, such as color_left."""
        return dict(self._source.frames.cameras)

    @property
    def losses(self) -> tuple[Loss, ...]:
        """Missing or damaged data, found when it was opened."""
        return tuple(self._source.frames.losses)

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines that cost no data, such as guesses about bags of others."""
        frames = self._source.frames
        return (*frames.guess_notes, *frames.notes)

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[Frame]:
        for number in self._numbers.tolist():
            yield Frame(self._source, number)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> Recording: ...

    def __getitem__(self, index: int | slice) -> Frame | Recording:
        if isinstance(index, slice):
            return Recording(self._source, np.sort(self._numbers[index]))
        if not -len(self) <= index < len(self):
            numbered = f'; frame({index}) takes file numbers' if index in self._numbers else ''
            raise IndexError(f'{index}: {self.name} has {len(self)} frames{numbered}')
        return Frame(self._source, int(self._numbers[index]))

    def frame(self, number: int) -> Frame:
        """Return the frame with a KITTI file number.

        Raises:
            KittiRos2Error: There is none.
        """
        if number not in self._numbers:
            have = format_numbers(self._numbers.tolist())
            raise UsageError(f'{self.name} has no frame {number}; it has {have}')
        return Frame(self._source, number)

    def calibration(self) -> CalibratedRig | None:
        """Return the calibration of the first frame, None without any; see Frame.calibration."""
        return self[0].calibration if len(self) else None

    def trajectory(self) -> PoseSeries:
        """Read the poses of all frames; a KittiRos2Warning names those that cannot be read.

        map is east-north-up with its origin at the first base_link position of the whole recording
        (REP-103, REP-105); without gravity (odometry) it is base_link at the first pose.
        """
        numbers, stamps, poses = [], [], []
        for frame in self:
            try:
                pose = frame.pose
            except (KittiRos2Error, OSError) as error:
                warn(describe_error(error))
                continue
            if pose is not None:
                numbers.append(frame.number)
                stamps.append(frame.stamp_ns)
                poses.append(pose)
        return PoseSeries(
            np.array(numbers, np.int64),
            np.array(stamps, np.int64),
            np.array(poses, np.float64).reshape(-1, 4, 4),
        )

    def line_scans(
        self, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[int, Float32Array]]:
        """Yield the scans of KITTI-360's SICK, of which several come in a frame, in order of time.

        Args:
            start_ns: The first stamp, such as that of a frame; None begins with the first scan.
            end_ns: The stamp to end before; None ends with the last scan.

        Yields:
            Stamp, nanoseconds since 1970 UTC, and points, (N, 3) float32, x y z in metres in
            sick_link, whose mount is `transform('velo_link', 'sick_link')` of the calibration.

        Raises:
            MissingDataError: The recording has none.
            KittiRos2Error: A file is truncated.
        """
        recording = self._source.frames.recording
        index = recording.streams.get(Stream.SICK)
        if index is None:
            raise MissingDataError(f'{self.path}: {self.name} has no scans of a SICK')
        samples = zip(index.stamps_ns.tolist(), index.numbers.tolist(), strict=True)
        for stamp_ns, number in sorted(samples):
            is_early = start_ns is not None and stamp_ns < start_ns
            if not is_early and (end_ns is None or stamp_ns < end_ns):
                scan = cast('LineScan', recording.read(Stream.SICK, number))
                yield stamp_ns, np.array(scan.points)

    def close(self) -> None:
        """Close the files of a bag; reading a frame opens them again."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f'<kitti_ros2.Recording {self.name}: {len(self)} frames, {", ".join(self.streams)}>'
