# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the readers of all layouts, its poses, and the sizes of its images."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..files.image_files import JPEG_SIGNATURE, TRAILING_BYTES, jpeg_frame, parse_image
from ..model.errors import (
    BadFileError,
    KittiRos2Error,
    MissingDataError,
    MissingFileError,
    RemoteError,
    UsageError,
    describe_error,
    runs_of,
)
from ..model.geometry import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU, Transform, rotation_from_rpy
from ..model.recording import Start
from ..model.samples import (
    Calibration,
    Description,
    Image,
    Pose,
    Sample,
    Scan,
    TextFile,
    Trails,
    Trajectory,
    cuboids_of,
)
from ..model.streams import EARTH_RADIUS_M, Clock, Layout, Stream
from ..options.read import ScanStamp
from .archives import describe_source
from .calib_file import parse_calibration
from .names import FRAME_NAMES, JPEGS, TXT, describe_names
from .recording_index import RecordingIndex
from .scan_file import ScanFormat, detect_scan_format, parse_points
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import FrameLabels, LineScan, OxtsPacket
    from ..model.streams import GeoOrigin
    from ..options.read import ReadOptions


# Poses of the vehicle: from oxts packets by Mercator projection, or from odometry's poses.

_SCALE_ROUNDS = 12  # each adds a digit at least up to 500 km from the origin


@dataclass(frozen=True, eq=False)
class MercatorWorld:
    """The fixed frame of a recording with oxts: east, north, up from imu_link at its first packet.

    Source: latlonToMercator.m and convertOxtsToPose.m of the raw devkit: Mercator scaled by
    cos(lat0), rotation Rz Ry Rx. The devkit then makes all poses relative to the first one; here
    only the first position is subtracted, as pykitti does, so that the axes stay level.

    Attributes:
        scale: cos(lat0).
        origin: (3,) east, north, up of the first packet, metres.
    """

    scale: float
    origin: Float64Array

    @classmethod
    def at(cls, first: OxtsPacket | GeoOrigin) -> MercatorWorld:
        """Return the frame whose origin is a position, or imu_link in a packet."""
        scale = float(np.cos(np.radians(first.lat)))
        return cls(scale, _mercator(first, scale))

    def pose(self, packet: OxtsPacket) -> Transform:
        """Return world_T_imu of a packet."""
        return Transform(
            rotation_from_rpy(packet.roll, packet.pitch, packet.yaw),
            _mercator(packet, self.scale) - self.origin,
        )


def _mercator(packet: OxtsPacket | GeoOrigin, scale: float) -> Float64Array:
    """Return (3,) east, north, up of imu_link, metres."""
    east = scale * EARTH_RADIUS_M * np.radians(packet.lon)
    north = scale * EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + np.radians(packet.lat) / 2))
    return np.array([east, north, packet.alt])


def geographic_positions(positions: Float64Array, origin: GeoOrigin) -> Float64Array:
    """Return the geographic positions of local ones: those that MercatorWorld brings back to them.

    The readers' scale is that of the first packet, so the first position decides it; the plane is
    Mercator's, and distances in it are those of the positions.

    Args:
        positions: (N, 3) east, north, up, metres; the first is that of the first packet.
        origin: The position of (0, 0, 0).

    Returns:
        (N, 3) latitude and longitude, degrees, and altitude, metres.
    """
    north_0 = np.log(np.tan(np.pi / 4 + np.radians(origin.lat) / 2))
    scale = np.cos(np.radians(origin.lat))
    for _ in range(_SCALE_ROUNDS):
        scale = np.cos(_latitude(north_0 + positions[0, 1] / (scale * EARTH_RADIUS_M)))
    east, north, up = positions.T
    radius = scale * EARTH_RADIUS_M
    lat = np.degrees(_latitude(north_0 + north / radius))
    lon = origin.lon + np.degrees(east / radius)
    return np.column_stack([lat, lon, origin.alt + up])


def _latitude(mercator: Float64Array) -> Float64Array:
    """Return latitudes, radians, of Mercator's northings over the radius: the inverse."""
    latitudes: Float64Array = 2 * np.arctan(np.exp(mercator)) - np.pi / 2
    return latitudes


def pose_from_packet(packet: OxtsPacket, world: MercatorWorld) -> Pose:
    """Return the pose and motion of an oxts packet."""
    return Pose(
        world.pose(packet),
        velocity=packet.body_velocity(),
        angular_velocity=np.array([packet.wx, packet.wy, packet.wz]),
        position_sigma=packet.pos_accuracy,
        velocity_sigma=packet.vel_accuracy,
    )


def pose_from_odometry(first_cam0_t_cam0: Float64Array, calibration: Calibration) -> Pose:
    """Return the pose of imu_link from a (3, 4) pose of the rectified camera 0 in its first frame.

    The world is imu_link at the first frame, which is not level: odometry has no gravity.
    """
    rect0_t_imu = rect_from_imu(calibration)
    pose = Transform.from_matrix(first_cam0_t_cam0)
    return Pose(rect0_t_imu.inverse() @ pose @ rect0_t_imu)


def rect_from_imu(calibration: Calibration) -> Transform:
    """Return rect_T_imu, imu_link to the rectified camera 0; nominal without a calibration."""
    rect_r_cam0 = np.eye(3) if calibration.r0_rect is None else calibration.r0_rect
    cam0_t_velo = calibration.cam0_T_velo or NOMINAL_CAM0_T_VELO
    return Transform(rect_r_cam0, np.zeros(3)) @ cam0_t_velo @ calibration.velo_T_imu


# The poses of a recording, and what follows from them: its start, trajectories, trails.

T = TypeVar('T')

_KEPT_PACKETS = 8192  # of 2 kB; the path needs all before the first is due


class RecordingPoses(RecordingIndex):
    """A recording with poses, of its oxts packets unless a layout has them in a file."""

    level_poses = True

    def __init__(self, root: Path, options: ReadOptions) -> None:
        super().__init__(root, options)
        self._packet_cached = lru_cache(_KEPT_PACKETS)(self._packet)

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame; absent parts are listed in its missing."""
        raise NotImplementedError

    @cached_property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording; see model.recording."""
        pose = self._first(Stream.POSE, self._pose)
        return None if pose is None else Start(pose.world_T_imu, self.level_poses)

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """Return the poses of these numbers; unreadable ones are left out and become losses."""
        stamps: list[int] = []
        poses: list[Transform] = []
        index = self.streams.get(Stream.POSE)
        if index is not None:
            stamp_of = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
            for number, pose in self.readable_poses(numbers, Stream.PATH):
                stamps.append(stamp_of[number])
                poses.append(pose.world_T_imu)
        return Trajectory(np.array(stamps, dtype=np.int64), poses)

    def readable_poses(
        self, numbers: Iterable[int], needed_for: Stream
    ) -> Iterator[tuple[int, Pose]]:
        """Yield the poses of these numbers; unreadable ones become losses of a stream."""
        for number in numbers:
            try:
                yield number, self._pose(number)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                self._lose_late(needed_for, describe_error(error))

    def trails(self, number: int) -> dict[int, Float64Array]:
        """Return the path of each of a frame's tracks up to it; see model.recording."""
        has_tracks = Stream.LABELS in self.streams and Stream.POSE in self.streams
        return self._trails.up_to(number) if has_tracks else {}

    @cached_property
    def _trails(self) -> Trails:
        frames = {}
        for number in self.streams[Stream.LABELS].numbers.tolist():
            calibration = self.calibration(number)
            try:
                frames[number] = cuboids_of(self._labels(number), calibration)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                self._lose_late(Stream.LABELS, describe_error(error))
            except ValueError as error:
                reason = next(iter(calibration.missing.values()), str(error))
                self._lose_late(Stream.LABELS, f'{reason}; it is needed for the 3D boxes of labels')
        return Trails(frames, self._world_t_velo)

    def _world_t_velo(self, number: int) -> Transform | None:
        """Return the scanner's pose at a frame, None without a readable pose of this number."""
        if number not in self._posed:
            return None
        try:
            pose = self._pose(number)
        except RemoteError:
            raise
        except (KittiRos2Error, OSError) as error:
            self._lose_late(Stream.LABELS, describe_error(error))
            return None
        return pose.world_T_imu @ self.calibration(number).velo_T_imu.inverse()

    @cached_property
    def _posed(self) -> frozenset[int]:
        return frozenset(self.streams[Stream.POSE].numbers.tolist())

    def _first(self, stream: Stream, read: Callable[[int], T]) -> T | None:
        """Return the first readable sample of a stream, None without one.

        The poses begin there: if it is not the first, all differ, which is reported as a loss.
        """
        index = self.streams.get(stream)
        failure = ''
        for number in () if index is None else index.numbers.tolist():
            try:
                sample = read(number)
            except RemoteError:
                raise
            except (KittiRos2Error, OSError) as error:
                failure = failure or describe_error(error)
                continue
            if failure:
                self._lose_late(Stream.POSE, f'{failure}; map begins at frame {number} instead')
            return sample
        if failure:
            self._lose_late(Stream.POSE, failure)
        return None

    def _pose(self, number: int) -> Pose:
        return pose_from_packet(self._packet_cached(number), self._world)

    @cached_property
    def _world(self) -> MercatorWorld:
        """The fixed frame of the poses, at the first readable oxts packet."""
        packet = self._first(Stream.OXTS, self._packet_cached)
        if packet is None:
            needed_for = 'the origin of the map: not one oxts packet is readable'
            raise MissingFileError(self.root, needed_for)
        return MercatorWorld.at(packet)

    def _packet(self, number: int) -> OxtsPacket:
        raise NotImplementedError

    def _line_scan(self, number: int) -> LineScan:
        raise NotImplementedError

    def _labels(self, number: int) -> FrameLabels:
        raise NotImplementedError


# The common part of the readers of all layouts: samples, calibration and description.


class KittiRecording(RecordingPoses):
    """The common part of the readers of all layouts."""

    layout: Layout
    image_topic = 'image_rect'
    common_numbers = True
    clock = Clock.NOMINAL

    def __init__(self, root: Path, name: str, options: ReadOptions) -> None:
        super().__init__(root, options)
        self.name = name
        self._first_sizes: dict[Stream, tuple[int, int]] = {}
        self._expected_size = lru_cache(maxsize=None)(self._find_expected_size)

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps, and length of a turn that is not known."""
        return self.options.period_ns

    @property
    def cameras(self) -> dict[int, str]:
        """Camera index to name: those of the layout, or plain numbers on another rig."""
        present = [stream.camera for stream in self.streams if stream.camera is not None]
        if present and self.calibration(self._first_number).independent_cameras:
            return {index: str(index) for index in present}
        return {index: self.layout.traits.camera_names.get(index, str(index)) for index in present}

    def text_paths(self) -> list[Path]:
        """List the existing text files of the whole recording."""
        return []

    def contradictions(self) -> Iterator[str]:
        """Yield where its text files contradict each other, with file and line, for validate."""
        yield from ()

    def calibration(self, number: int) -> Calibration:  # noqa: ARG002 - one for all frames
        """Return the calibration of a frame; absent parts are listed in its missing."""
        return self._calibration

    @cached_property
    def _calibration(self) -> Calibration:
        """The calibration of layouts that have one for all frames."""
        raise NotImplementedError

    def describe(self) -> Description:
        """Describe the recording as a whole."""
        folders = {
            stream.value: {
                'folder': listing.folder.relative_to(self.root).as_posix(),
                **describe_names(listing.names),
                'numbers': runs_of(listing.numbers.tolist()),
            }
            for stream, listing in self._listings.items()
        }
        values: dict[str, object] = {
            'layout': self.layout.value,
            'name': self.name,
            'epoch_ns': self.options.epoch_ns,
            'period_ns': self.options.period_ns,
            'scan_stamp': self._scan_stamp.value,
            'files': folders,
        }
        if self.frames.stems:
            values[FRAME_NAMES] = [*self.frames.stems]
        if self.deskew is not None:
            values['deskew'] = self.deskew.value
        if self.extract is not None:
            values['imu_from'] = self.extract.describe()
        if self.stereo:
            values['stereo'] = True
        if self.options.columns is not None:
            values['columns'] = self.options.columns.text
        files: list[TextFile] = []
        missing: dict[str, str] = {}
        for path in self.text_paths():
            try:
                files.append(self._verbatim(path, self.common_files.take_text(path)))
            except (BadFileError, OSError) as error:
                missing[path.relative_to(self.root).as_posix()] = describe_error(error)
        return Description(values, files, missing)

    @cached_property
    def scan_format(self) -> ScanFormat:
        """The format of the scans, by the first ones."""
        return detect_scan_format(self, labelled=self.layout.traits.point_labels)

    @property
    def scan_error(self) -> BadFileError | None:
        """The error if its scans are not KITTI's and the options have no columns."""
        return self.scan_format.error if self.options.columns is None else None

    def check_scan(self, path: Path, data: npt.NDArray[np.uint8]) -> None:
        """Check that a scan has the columns of the others, if the options have none.

        Raises:
            BadFileError: It has others.
        """
        if self.options.columns is None:
            self.scan_format.check(path, data)

    def prepare_columns(self) -> None:
        """Note what the options leave out of scans; without columns, check that they are KITTI's.

        Raises:
            BadFileError: They are not.
            UsageError: Columns are given for text files, which have four.
        """
        listing, columns = self.listings.get(Stream.SCAN), self.options.columns
        if listing is None or columns is None:
            if self.scan_error is not None:
                raise self.scan_error
            return
        if any(listing.path(n).suffix.lower() == TXT for n in listing.numbers[:1].tolist()):
            raise UsageError(f'{listing.folder}: columns are for binary scans; these are text')
        if columns.skipped:
            self.notes.append(f'{listing.folder}: {columns.describe_skipped()} left out (-)')
        if columns.reflectance is None:
            self.notes.append(f'{listing.folder}: no column of intensity, which is 0 then')
        doubt = self.scan_format.doubt(columns)
        self.notes += [doubt] if doubt else []

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number; see model.recording."""
        if stream.camera is not None:
            return self._image(stream, number)
        if stream.label_image is not None:
            path = self._listings[stream].path(number)
            return parse_image(STORE.read(path), path)
        if stream is Stream.SCAN:
            return self.adjust_scan(number, self._scan(number))
        if stream is Stream.PREDICTIONS and self.results is not None:
            return self.results.read(number)
        if stream is Stream.OXTS_EXTRACT and self.extract is not None:
            return self.extract.packet(number)
        readers: dict[Stream, Callable[[int], Sample]] = {
            Stream.SICK: self._line_scan,
            Stream.OXTS: self._packet_cached,
            Stream.POSE: self._pose,
            Stream.LABELS: self._labels,
            Stream.CALIBRATION: self.calibration,
        }
        return readers[stream](number)

    def _scan(self, number: int) -> Scan:
        path = self._listings[Stream.SCAN].path(number)
        data = STORE.read_array(path)
        self.check_scan(path, data)
        scan = parse_points(data, path, self.options.columns)
        return replace(scan, turn=self.turns.get(number))

    @property
    def _first_number(self) -> int:
        """The lowest file number of any image stream."""
        return min(
            int(index.numbers[0])
            for stream, index in self.streams.items()
            if stream.camera is not None
        )

    def _image(self, stream: Stream, number: int) -> Image:
        path = self._listings[stream].path(number)
        image = parse_image(STORE.read(path), path)
        if number == self.streams[stream].numbers[0]:
            self._first_sizes[stream] = image.width, image.height
        expected = self._expected_size(stream)
        if expected is not None and (image.width, image.height) != expected:
            raise BadFileError(
                path,
                f'the image is {image.width}x{image.height}',
                f'{expected[0]}x{expected[1]}, as the rest of its camera',
                remedy='calibration holds for one size only',
            )
        return image

    def _find_expected_size(self, stream: Stream) -> tuple[int, int] | None:
        """Return the size of a camera's images: the calibration's, else the first valid image's."""
        camera = self.calibration(0).cameras.get(stream.camera or 0)
        if camera is not None and camera.size is not None:
            return camera.size
        if stream in self._first_sizes:
            return self._first_sizes[stream]
        for number in self.streams[stream].numbers.tolist():
            path = self._listings[stream].path(number)
            try:
                image = parse_image(STORE.read(path), path)
            except (BadFileError, OSError):
                continue
            return image.width, image.height
        return None

    @property
    def _scan_stamp(self) -> ScanStamp:
        """The time of a scan that is its stamp; a compensated scan has no start of a turn."""
        return self.options.scan_stamp if self.turns else ScanStamp.FORWARD

    def _verbatim(self, path: Path, text: str) -> TextFile:
        """Return a text of a file, or a part of it, under the file's name in the recording."""
        return TextFile(path.relative_to(self.root).as_posix(), text)

    def _text(self, path: Path, stream: Stream) -> str:
        """Read a text file; one that is absent is empty, an unreadable one also a loss."""
        if not path.is_file():
            return ''
        try:
            return self.common_files.read_text(path)
        except (BadFileError, OSError) as error:
            self._lose_lines(stream, describe_error(error))
            return ''

    def _parsed(self, path: Path, stream: Stream, parse: Callable[[str, Path], T]) -> T:
        """Parse a text file that _text reads; one that cannot be parsed is a loss, and empty."""
        text = self._text(path, stream)
        try:
            return parse(text, path)
        except BadFileError as error:
            self._lose_lines(stream, str(error))
            return parse('', path)

    def _load_calibration(self, path: Path) -> Calibration:
        """Read a calibration of a single file; an unreadable one is empty, with the reason."""
        files: tuple[TextFile, ...] = ()
        try:
            text = STORE.read_text(path)
            files = (self._verbatim(path, text),)
            return parse_calibration(text, path, files[0].name, self._scanner_source(path))
        except FileNotFoundError:
            reason = f'{path}: no such file; {describe_source(self.layout, path)}'
        except BadFileError as error:
            reason = str(error)
        except OSError as error:
            reason = describe_error(error)
            self._lose_late(Stream.CALIBRATION, reason)
        return no_calibration(reason, files)

    def _scanner_source(self, path: Path) -> str:
        """Describe the origin of a calibration with the scanner's pose, if it is known."""
        if self.layout is not Layout.ODOMETRY:
            return ''
        source = describe_source(self.layout, path)
        return f'{source}; the {path.name} of the image archives has none'


def no_calibration(reason: str, files: tuple[TextFile, ...] = ()) -> Calibration:
    """Return an empty calibration."""
    return Calibration(
        {},
        None,
        None,
        NOMINAL_VELO_T_IMU,
        nominal=('velo_T_imu',),
        missing={'file': reason},
        files=files,
    )


# The size of a camera's images, from the calibration or from an image.

_JPEG_BYTES = 1 << 16
"""The frame header of a JPEG comes after its tables and a thumbnail."""


def read_image_header(path: Path) -> Image:
    """Read an image from the two ends of its file; its data are incomplete.

    Raises:
        BadFileError: It is no image, or cut.
        OSError: It cannot be read.
    """
    length = _JPEG_BYTES if path.suffix.lower() in JPEGS else TRAILING_BYTES
    ends, size = STORE.read_ends(path, length)
    if ends.startswith(JPEG_SIGNATURE) and jpeg_frame(ends) is None:
        return parse_image(STORE.read(path), path)
    return parse_image(ends, path, size)


def image_size(
    recording: KittiRecording, camera: int, number: int, otherwise: str = ''
) -> tuple[int, int]:
    """Return (width, height) of the images of a camera at a frame.

    They are those of the frame's own image where sizes differ (object), else of the calibration,
    or else of the first valid image.

    Args:
        recording: The recording.
        camera: KITTI index.
        number: File number of the frame.
        otherwise: The remedy, the end of the error.

    Raises:
        MissingDataError: The size is not known.
    """
    stream = Stream(f'image_{camera}')
    if recording.layout.traits.calibration_per_frame:
        return _read_size(recording.path(stream, number), otherwise)
    seen_by = recording.calibration(number).cameras.get(camera)
    if seen_by is not None and seen_by.size is not None:
        return seen_by.size
    index = recording.streams.get(stream)
    for image_number in () if index is None else index.numbers.tolist():
        try:
            return _read_size(recording.path(stream, image_number), otherwise)
        except MissingDataError:
            continue
    raise MissingDataError(
        f'{recording.root}: {recording.name} has no image of camera {camera}, so its size is'
        f' unknown{otherwise and f"; give {otherwise}"}'
    )


def _read_size(path: Path, otherwise: str) -> tuple[int, int]:
    """Read the size of an image from its two ends.

    Raises:
        MissingDataError: There is no valid image.
    """
    try:
        image = read_image_header(path)
    except FileNotFoundError:
        raise MissingDataError(
            f'{path}: no such file; the size of the image is needed'
            f'{otherwise and f", or {otherwise}"}'
        ) from None
    except (BadFileError, OSError) as error:
        raise MissingDataError(describe_error(error)) from None
    return image.width, image.height
