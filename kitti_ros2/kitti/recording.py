# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the readers of all layouts: samples, poses, trails and calibration."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..files.png.header import parse_image
from ..model.errors import (
    BadFileError,
    KittiRos2Error,
    MissingFileError,
    RemoteError,
    describe_error,
)
from ..model.labels import Trails, cuboids_of
from ..model.losses import runs_of
from ..model.nominal import NOMINAL_VELO_T_IMU
from ..model.recording import Start
from ..model.samples import (
    Calibration,
    Description,
    FrameLabels,
    Image,
    OxtsPacket,
    Pose,
    Sample,
    Scan,
    TextFile,
    Trajectory,
)
from ..model.streams import CAMERA_NAMES, Clock, Stream
from ..options.read import ScanStamp
from .calib_archives import describe_source
from .calib_file import parse_calibration
from .poses import MercatorWorld, pose_from_packet
from .recording_index import RecordingIndex
from .scan_file import parse_scan
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from ..model.geometry import Float64Array, Transform
    from ..model.layouts import Layout
    from ..options.read import ReadOptions

T = TypeVar('T')


class KittiRecording(RecordingIndex):
    """The common part of the readers of all layouts."""

    layout: Layout
    image_topic = 'image_rect'
    common_numbers = True
    level_poses = True
    clock = Clock.NOMINAL

    def __init__(self, root: Path, name: str, options: ReadOptions) -> None:
        super().__init__(root, options)
        self.name = name
        self._packet_cached = lru_cache(maxsize=64)(self._packet)
        self._expected_size = lru_cache(maxsize=None)(self._find_expected_size)

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps, and length of a turn that is not known."""
        return self.options.period_ns

    @property
    def cameras(self) -> dict[int, str]:
        """Camera index to name: KITTI's four, or plain numbers on another rig."""
        present = [stream.camera for stream in self.streams if stream.camera is not None]
        if present and self.calibration(self._first_number).independent_cameras:
            return {index: str(index) for index in present}
        return {index: CAMERA_NAMES.get(index, str(index)) for index in present}

    def text_paths(self) -> list[Path]:
        """List the existing text files of the whole recording."""
        return []

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
                'digits': listing.digits,
                'suffix': listing.suffix,
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
        if self.deskew is not None:
            values['deskew'] = self.deskew.value
        if self.extract is not None:
            values['imu_from'] = self.extract.describe()
        if self.stereo:
            values['stereo'] = True
        files: list[TextFile] = []
        missing: dict[str, str] = {}
        for path in self.text_paths():
            try:
                files.append(self._verbatim(path, STORE.read_text(path)))
            except (BadFileError, OSError) as error:
                missing[path.relative_to(self.root).as_posix()] = str(error)
        return Description(values, files, missing)

    @cached_property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording; see model.recording."""
        pose = self._first(Stream.POSE, self._pose)
        return None if pose is None else Start(pose.world_T_imu, self.level_poses)

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
        return None

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

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number; see model.recording."""
        if stream.camera is not None:
            return self._image(stream, number)
        if stream is Stream.SCAN:
            return self.adjust_scan(number, self._scan(number))
        if stream is Stream.PREDICTIONS and self.results is not None:
            return self.results.read(number)
        if stream is Stream.OXTS_EXTRACT and self.extract is not None:
            return self.extract.packet(number)
        readers: dict[Stream, Callable[[int], Sample]] = {
            Stream.OXTS: self._packet_cached,
            Stream.POSE: self._pose,
            Stream.LABELS: self._labels,
            Stream.CALIBRATION: self.calibration,
        }
        return readers[stream](number)

    def trails(self, number: int) -> dict[int, Float64Array]:
        """Return the path of each of a frame's tracks up to it; see model.recording."""
        known = Stream.LABELS in self.streams and Stream.POSE in self.streams
        return self._trails.up_to(number) if known else {}

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

    def _scan(self, number: int) -> Scan:
        path = self._listings[Stream.SCAN].path(number)
        return Scan(parse_scan(STORE.read_array(path), path), turn=self.turns.get(number))

    def _packet(self, number: int) -> OxtsPacket:
        raise NotImplementedError

    def _labels(self, number: int) -> FrameLabels:
        raise NotImplementedError

    def _pose(self, number: int) -> Pose:
        return pose_from_packet(self._packet_cached(number), self._world)

    @cached_property
    def _world(self) -> MercatorWorld:
        """The fixed frame of the poses, at the first readable oxts packet."""
        packet = self._first(Stream.OXTS, self._packet)
        if packet is None:
            needed_for = 'the origin of the map: not one oxts packet is readable'
            raise MissingFileError(self.root, needed_for)
        return MercatorWorld.at(packet)

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
        """The moment of a scan that is its stamp; a compensated scan has no start of a turn."""
        return self.options.scan_stamp if self.turns else ScanStamp.FORWARD

    def _verbatim(self, path: Path, text: str) -> TextFile:
        """Return a text of a file, or a part of it, under the file's name in the recording."""
        return TextFile(path.relative_to(self.root).as_posix(), text)

    def _text(self, path: Path, stream: Stream) -> str:
        """Read a text file; one that is absent is empty, an unreadable one also a loss."""
        if not path.is_file():
            return ''
        try:
            return STORE.read_text(path)
        except (BadFileError, OSError) as error:
            self._lose_lines(stream, str(error))
            return ''

    def _load_calibration(self, path: Path) -> Calibration:
        """Read a calibration of a single file; an unreadable one is empty, with the reason."""
        files: tuple[TextFile, ...] = ()
        try:
            text = STORE.read_text(path)
            files = (self._verbatim(path, text),)
            return parse_calibration(text, path, files[0].name)
        except FileNotFoundError:
            reason = f'{path}: no such file; {describe_source(self.layout, path)}'
        except BadFileError as error:
            reason = str(error)
        except OSError as error:
            reason = describe_error(error)
            self._lose_late(Stream.CALIBRATION, reason)
        return no_calibration(reason, files)


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
