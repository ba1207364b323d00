# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 - one signature for all layouts, of which each uses its part
"""The writers of the four layouts: raw, object, odometry, tracking; a method a stream."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..kitti import names
from ..model.boxes import box_to_velo
from ..model.errors import UsageError, format_count, runs_of
from ..model.samples import rect_from_velo
from ..model.streams import Layout, Stream
from .calib_file import format_object, format_odometry, format_raw, format_tracking
from .label_file import fitting_decimals, format_object_labels, format_tracking_labels
from .scan_file import format_point_labels, format_scan
from .store import STORE
from .text_file import format_packet, format_poses, format_times, format_timestamps
from .tracklet_file import (
    TRUNCATION_CUT,
    TRUNCATION_IN_IMAGE,
    Tracklet,
    TrackletPose,
    format_tracklets,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Self

    from ..model.boxes import Box
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, OxtsPacket, Scan


# The base class of the writers of all layouts: a method a stream, called in time order.
#
# A writer gets samples as a recording yields them and keeps only the small tables that KITTI has in
# one file (time stamps, poses, tracks); close() writes these.


class LayoutWriter:
    """Writes one drive, sequence or set of frames.

    Leaving the ``with`` block closes the writer. After an exception the tables are not written, and
    the caller removes the files.

    Attributes:
        layout: The layout that it writes.
        path: The folder of the drive, sequence or split.
    """

    layout: ClassVar[Layout]
    path: Path
    _images: ClassVar[tuple[str, ...]] = names.OBJECT_IMAGES

    @property
    def accepts(self) -> frozenset[Stream]:
        """The streams of the layout; a sample of another is a UsageError."""
        return self.layout.traits.streams

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.close()

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write the calibration valid from a frame on; object sets need one for each frame."""
        STORE.write_text(self._calibration_path(number), self._format_calibration(calibration))

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:
        """Write calibration files verbatim, by file name."""
        for text in texts.values():
            STORE.write_text(self._calibration_path(number), text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write one sweep."""
        STORE.write(self._file(names.SCANS, number, names.BIN), format_scan(scan.points))

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write one image, as the bytes of its PNG file."""
        self._check_camera(camera)
        STORE.write(self._file(self._images[camera], number, names.PNG), png)

    def depth_folder(self, camera: int) -> str:
        """Return the folder of depth maps of a camera, empty where the layout has none."""
        return ''

    def write_depth(self, camera: int, number: int, png: bytes) -> None:
        """Write a depth map of a camera with a depth_folder.

        Args:
            camera: KITTI index.
            number: The frame's.
            png: 16 bits grey: depth in metres times 256, 0 without one (readme.txt of the depth
                devkit).
        """
        STORE.write(self._file(self.depth_folder(camera), number, names.PNG), png)

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write one packet of the GPS/IMU, or its line verbatim."""
        raise self._not_accepted(Stream.OXTS)

    def write_pose(self, number: int, stamp_ns: int, first_T_cam0: Float64Array) -> None:
        """Write the (3, 4) pose of the rectified camera 0 in its own first frame."""
        raise self._not_accepted(Stream.POSE)

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write the labelled objects of a frame, or its label lines verbatim."""
        raise self._not_accepted(Stream.LABELS)

    def set_label_frame(self, rect_T_velo: Transform) -> None:
        """Take boxes in another frame than that of the rectified camera 0.

        Only for a layout that stores them in the scanner's frame, which boxes that are upright on
        the ground may be upright in while the camera leans.
        """
        raise NotImplementedError

    def leave_out(self, number: int) -> None:
        """Keep an incomplete frame out of lists of frames; other layouts have none."""

    def notes(self) -> list[str]:
        """Return notes on what the files cannot hold, once they are written."""
        return []

    def close(self) -> None:
        """Write the files that KITTI has once for the whole recording."""

    def _check_camera(self, camera: int) -> None:
        """Raise UsageError if the layout has no images of a camera."""
        stream = Stream(f'image_{camera}')
        if stream not in self.accepts:
            raise self._not_accepted(stream)

    def _calibration_path(self, number: int) -> Path:
        """Return the calibration file of a frame, or that of all frames, where the last is kept."""
        raise NotImplementedError

    def _format_calibration(self, calibration: Calibration) -> str:
        raise NotImplementedError

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        """Return the file of a frame in a folder of the layout."""
        return self.path / folder / names.file_name(number, names.FRAME_DIGITS, suffix)

    def _not_accepted(self, stream: Stream) -> UsageError:
        return UsageError(
            f'the {self.layout.value} layout has no place for {stream.value};'
            f' it holds {", ".join(sorted(accepted.value for accepted in self.accepts))}'
        )


def require_next(path: Path, noun: str, expected: int, number: int) -> None:
    """Require the next number, in a file whose line n is frame n.

    Args:
        path: The file.
        noun: The content of a line.
        expected: The number of lines so far.
        number: The frame's.

    Raises:
        UsageError: The number is not the next one.
    """
    if number != expected:
        raise UsageError(
            f'{path}: line n is frame n, so the {noun} of frame {expected} must come before that of'
            f' frame {number}; number the frames from 0 without a gap'
        )


# Writer of the raw layout: DATE/DATE_drive_NNNN_sync (or extract), calibration in DATE.

KINDS = ('sync', 'extract')
_MOST_OCCLUDED = 2
_COLOUR_CAMERAS = (2, 3)
_UNKNOWN = -1
_RESIZED = 0.1
_REPORTED_OFF_M = 0.01
_WHOLE = 2  # ends of a run that is not cut
DATAFORMAT = """\
lat: degrees north
lon: degrees east
alt: metres
roll: radians, about the forward axis, left side up is positive
pitch: radians, about the left axis, front down is positive
yaw: radians, 0 is east, counter-clockwise is positive
vn: m/s, to the north
ve: m/s, to the east
vf: m/s, forward, along the ground
vl: m/s, sideways along the ground; positive to the right in the data set
vu: m/s, up
ax: m/s^2, body axis forward, gravity included
ay: m/s^2, body axis left, gravity included
az: m/s^2, body axis up, gravity included
af: m/s^2, forward, along the ground
al: m/s^2, to the left, along the ground
au: m/s^2, up, gravity included
wx: rad/s, about the body axis forward
wy: rad/s, about the body axis left
wz: rad/s, about the body axis up
wf: rad/s, about the levelled forward axis
wl: rad/s, about the levelled left axis
wu: rad/s, about the vertical
pos_accuracy: metres, one standard deviation of the position
vel_accuracy: m/s, one standard deviation of the velocity
navstat: navigation status code
numsats: satellites in use
posmode: position mode code
velmode: velocity mode code
orimode: orientation mode code
"""


class RawWriter(LayoutWriter):
    """Writes one drive.

    Args:
        root: The folder above DATE.
        date: The drive's date, YYYY_MM_DD.
        drive: Its number.
        kind: sync or extract.
    """

    layout: ClassVar[Layout] = Layout.RAW

    def __init__(
        self,
        root: Path,
        date: str = '2011_09_26',
        drive: int = 1,
        kind: str = KINDS[0],
    ) -> None:
        name = f'{date}_drive_{drive:04d}_{kind}'
        if names.RAW_DATE.fullmatch(date) is None or names.RAW_DRIVE.fullmatch(name) is None:
            raise UsageError(
                f'{name} is no drive; expected a date such as 2011_09_26, a number up to 9999,'
                f' and {" or ".join(KINDS)}'
            )
        self.path = root / date / name
        self._stamps: dict[Path, dict[int, int]] = {}
        self._tracks: dict[int, dict[int, Box]] = {}
        self._labelled = False
        self._cut = 0
        self._size_off_m = 0.0
        self._rect_T_velo: Transform | None = None
        self._labels_T_velo: Transform | None = None

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write the three calibration files of DATE; the last ones are kept."""
        self._rect_T_velo = rect_from_velo(calibration)
        self.write_calibration_text(0, format_raw(calibration))

    def set_label_frame(self, rect_T_velo: Transform) -> None:
        """Take boxes in another frame; tracklets are in the scanner's."""
        self._labels_T_velo = rect_T_velo

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:
        """Write calibration files of DATE, verbatim."""
        for name, text in texts.items():
            STORE.write_text(self.path.parent / name, text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write velodyne_points/data; a sweep without start and end gets its own stamp for both."""
        folder = self.path / names.RAW_SCANS
        self._write_data(folder, number, names.BIN, format_scan(scan.points))
        start = stamp_ns if scan.start_ns is None else scan.start_ns
        end = stamp_ns if scan.end_ns is None else scan.end_ns
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)
        self._stamp(folder / names.TIMESTAMPS_START, number, start)
        self._stamp(folder / names.TIMESTAMPS_END, number, end)

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write image_0C/data."""
        self._check_camera(camera)
        folder = self.path / names.RAW_IMAGES[camera]
        self._write_data(folder, number, names.PNG, png)
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)

    def depth_folder(self, camera: int) -> str:
        """Return proj_depth/velodyne_raw/image_0C of a colour camera."""
        return f'{names.RAW_DEPTH}/{names.RAW_IMAGES[camera]}' if camera in _COLOUR_CAMERAS else ''

    def write_depth(self, camera: int, number: int, png: bytes) -> None:
        """Write a depth map; see LayoutWriter."""
        name = names.file_name(number, names.RAW_DIGITS, names.PNG)
        STORE.write(self.path / self.depth_folder(camera) / name, png)

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write oxts/data."""
        folder = self.path / names.RAW_OXTS
        text = packet if isinstance(packet, str) else f'{format_packet(packet)}\n'
        self._write_data(folder, number, names.TXT, text.encode())
        self._stamp(folder / names.TIMESTAMPS, number, stamp_ns)

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write a frame of tracklet_labels.xml; boxes without a 3D box are left out.

        Raises:
            UsageError: The labels are lines of text, which this layout does not support.
            ValueError: A box has no track id, or that of another one.
        """
        if isinstance(labels, str):
            raise UsageError('the raw layout keeps labels as tracklets; hand over boxes, not lines')
        self._labelled = True
        for box in labels:
            if box.size_hwl[0] <= 0:
                continue
            if box.track_id is None:
                raise ValueError('a tracklet needs a track id')
            boxes = self._tracks.setdefault(box.track_id, {})
            if number in boxes:
                raise ValueError(f'two boxes of track {box.track_id} in a frame')
            boxes[number] = box

    def close(self) -> None:
        """Write the time stamp files, dataformat.txt and tracklet_labels.xml.

        Raises:
            UsageError: There are labels but no calibration to transform them to velo_link.
        """
        for path, stamps in self._stamps.items():
            STORE.write_text(path, format_timestamps(fill_stamps(stamps)))
        if self.path / names.RAW_OXTS / names.TIMESTAMPS in self._stamps:
            STORE.write_text(self.path / names.RAW_OXTS / names.DATAFORMAT, DATAFORMAT)
        if self._labelled:
            STORE.write_text(self.path / names.RAW_TRACKLETS, format_tracklets(self._tracklets()))

    def notes(self) -> list[str]:
        """Return notes on tracklets, each of which has one class and size."""
        notes = []
        if self._cut:
            notes.append(
                f'tracklets have one class and size: {format_count(self._cut, "track")} became'
                f' several, each from where the class changes, or the size by more than 10 %'
            )
        if self._size_off_m > _REPORTED_OFF_M:
            notes.append(
                f'tracklets have one size, the median of their boxes, which differ from it by up to'
                f' {self._size_off_m:.2f} m'
            )
        return notes

    def _write_data(self, folder: Path, number: int, suffix: str, data: bytes) -> None:
        name = names.file_name(number, names.RAW_DIGITS, suffix)
        STORE.write(folder / names.RAW_DATA / name, data)

    def _stamp(self, path: Path, number: int, stamp_ns: int) -> None:
        self._stamps.setdefault(path, {})[number] = stamp_ns

    def _tracklets(self) -> list[Tracklet]:
        """Return a tracklet for each run of consecutive frames of each track, by track id.

        A tracklet has one class and one size: a run ends where they change.
        """
        tracklets = []
        for _, boxes in sorted(self._tracks.items()):
            for first, last in runs_of(sorted(boxes)):
                run = [boxes[n] for n in range(first, last + 1)]
                starts = [0, *_changes(run), len(run)]
                self._cut += len(starts) > _WHOLE
                for start, end in pairwise(starts):
                    tracklets.append(self._tracklet(first + start, run[start:end]))
        return tracklets

    def _tracklet(self, first: int, boxes: list[Box]) -> Tracklet:
        """Return the tracklet of boxes of a class and of almost the same size."""
        sizes = np.array([box.size_hwl for box in boxes])
        height, width, length = np.median(sizes, axis=0).tolist()
        off_m = float(np.abs(sizes - (height, width, length)).max())
        self._size_off_m = max(self._size_off_m, off_m)
        poses = [self._tracklet_pose(box) for box in boxes]
        return Tracklet(boxes[0].class_name, (height, width, length), first, poses)

    def _tracklet_pose(self, box: Box) -> TrackletPose:
        labels_t_velo = self._labels_T_velo or self._rect_T_velo
        if labels_t_velo is None:
            raise UsageError('tracklets are in the scanner frame: write_calibration comes first')
        # Tracklets are upright in the scanner's frame, labels in the camera's: the middle agrees.
        half = box.size_hwl[0] / 2
        middle = np.array(box.location) - [0.0, half, 0.0]
        (x, y, z), yaw = box_to_velo(middle, box.rotation_y, labels_t_velo)
        truncation = TRUNCATION_CUT if box.truncated > 0 else TRUNCATION_IN_IMAGE
        occlusion = box.occluded if box.occluded <= _MOST_OCCLUDED else _UNKNOWN
        return TrackletPose((x, y, z - half), yaw, occlusion, truncation)


def _changes(boxes: Sequence[Box]) -> Iterator[int]:
    """Yield the indices in a run at which its class changes, or its size by more than a tenth."""
    first = boxes[0]
    for index, box in enumerate(boxes):
        sizes = zip(box.size_hwl, first.size_hwl, strict=True)
        resized = any(abs(size - before) > _RESIZED * before for size, before in sizes)
        if resized or box.class_name != first.class_name:
            yield index
            first = box


def fill_stamps(stamps: Mapping[int, int]) -> list[int]:
    """Return stamps by line for file numbers 0 to the last; missing ones are interpolated.

    KITTI's own files contain a stamp for a missing file. Line n stays file number n; stamps before
    the first file are extrapolated by the mean period.
    """
    numbers = sorted(stamps)
    first, last = numbers[0], numbers[-1]
    period = (stamps[last] - stamps[first]) // max(last - first, 1)
    filled = [stamps[first] - period * (first - number) for number in range(first)]
    for left, right in pairwise(numbers):
        step = stamps[right] - stamps[left]
        filled += [stamps[left] + step * k // (right - left) for k in range(right - left)]
    return [*filled, stamps[last]]


# Writer of the object layout: training (or testing) with a calibration a frame, and ImageSets.
#
# Files of a frame: calib/NNNNNN.txt, velodyne/NNNNNN.bin, image_C/NNNNNN.png, label_2/NNNNNN.txt.

_COLOUR_CAMERA = 2


@dataclass(frozen=True)
class WriteOptions:
    """Options of a written set.

    Attributes:
        label_decimals: Digits behind the point in labels; KITTI's own have 2, a centimetre, as
            have those that lie on it.
        train_fraction: The part of the frames for training, 0 to 1; the rest is for validation.
    """

    label_decimals: int = 2
    train_fraction: float = 0.5


class ObjectWriter(LayoutWriter):
    """Writes a set of frames. The layout has no time: stamps are not written.

    Args:
        root: The dataset folder, above training and ImageSets.
        split: training or testing.
        options: Decimals of labels, parts of the set.
    """

    layout: ClassVar[Layout] = Layout.OBJECT

    def __init__(
        self,
        root: Path,
        split: str = names.SPLITS[0],
        options: WriteOptions | None = None,
    ) -> None:
        names.check_split(split)
        self.path = root / split
        self._sets_path = root / names.IMAGE_SETS
        self._split = split
        self._options = options or WriteOptions()
        self._numbers: set[int] = set()
        self._unlisted: set[int] = set()
        self._formatted: tuple[Calibration, str] | None = None

    def depth_folder(self, camera: int) -> str:
        """Return depth_2 for camera 2."""
        return names.OBJECT_DEPTH if camera == _COLOUR_CAMERA else ''

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write label_2/NNNNNN.txt."""
        if not isinstance(labels, str):
            most = self._options.label_decimals
            labels = ''.join(
                format_object_labels([box], fitting_decimals(box, most)) for box in labels
            )
        STORE.write_text(self._file(names.OBJECT_LABELS, number, names.TXT), labels)

    def leave_out(self, number: int) -> None:
        """Keep an incomplete frame out of ImageSets: loaders read the frames listed there."""
        self._unlisted.add(number)

    def close(self) -> None:
        """Write ImageSets: test.txt, trainval.txt and its parts train.txt and val.txt.

        The first frames train: neighbours in time must not be in both. Loaders open all of the
        lists: those of the other split are written empty, unless they exist.
        """
        numbers = sorted(self._numbers - self._unlisted)
        part = ceil(len(numbers) * self._options.train_fraction)
        sets = {'test': numbers}
        if self._split == names.SPLITS[0]:
            sets = {'trainval': numbers, 'train': numbers[:part], 'val': numbers[part:]}
        for name in ('trainval', 'train', 'val', 'test'):
            path = self._sets_path / f'{name}{names.TXT}'
            if name in sets or not path.is_file():
                members = sets.get(name, [])
                text = ''.join(f'{number:0{names.FRAME_DIGITS}d}\n' for number in members)
                STORE.write_text(path, text)

    def _calibration_path(self, number: int) -> Path:
        return self._file(names.CALIB, number, names.TXT)

    def _format_calibration(self, calibration: Calibration) -> str:
        # Frames share their calibration, and formatting it takes longer than writing it.
        if self._formatted is None or self._formatted[0] is not calibration:
            self._formatted = calibration, format_object(calibration)
        return self._formatted[1]

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        self._numbers.add(number)
        return super()._file(folder, number, suffix)


# Writer of the odometry layout: sequences/NN and poses/NN.txt.


class OdometryWriter(LayoutWriter):
    """Writes one sequence. File numbers run from 0 without a gap: times and poses are by line.

    Args:
        root: The dataset folder, above sequences and poses.
        sequence: The sequence's number.
    """

    layout: ClassVar[Layout] = Layout.ODOMETRY

    def __init__(self, root: Path, sequence: int = 0) -> None:
        name = f'{sequence:02d}'
        self.path = root / names.SEQUENCES / name
        self._poses_path = root / names.POSES / f'{name}{names.TXT}'
        self._poses: list[Float64Array] = []
        self._stamps: dict[int, int] = {}

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write velodyne/NNNNNN.bin, and labels/NNNNNN.label if its points have labels."""
        self._stamps.setdefault(number, stamp_ns)
        super().write_scan(number, stamp_ns, scan)
        if scan.labels is not None:
            path = self._file(names.POINT_LABELS, number, names.LABEL)
            STORE.write(path, format_point_labels(scan.labels))

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write image_C/NNNNNN.png; the benchmark's times are those of camera 0."""
        super().write_image(camera, number, stamp_ns, png)
        if camera == 0:
            self._stamps[number] = stamp_ns
        self._stamps.setdefault(number, stamp_ns)

    def write_pose(self, number: int, stamp_ns: int, first_T_cam0: Float64Array) -> None:
        """Write a line of poses/NN.txt.

        Raises:
            UsageError: The number is not the next one.
        """
        require_next(self._poses_path, 'pose', len(self._poses), number)
        self._stamps.setdefault(number, stamp_ns)
        self._poses.append(first_T_cam0)

    def close(self) -> None:
        """Write times.txt and poses/NN.txt.

        Raises:
            UsageError: A frame number is missing.
        """
        missing = next((n for n in range(len(self._stamps)) if n not in self._stamps), None)
        if missing is not None:
            raise UsageError(
                f'{self.path / names.TIMES}: line n is frame n, and there is no frame {missing};'
                f' number the frames from 0 without a gap'
            )
        offsets = [self._stamps[number] - self._stamps[0] for number in sorted(self._stamps)]
        STORE.write_text(self.path / names.TIMES, format_times(offsets))
        if self._poses:
            STORE.write_text(self._poses_path, format_poses(self._poses))

    def _calibration_path(self, number: int) -> Path:
        return self.path / names.ODOMETRY_CALIB

    def _format_calibration(self, calibration: Calibration) -> str:
        return format_odometry(calibration)


# Writer of the tracking layout: training (or testing), one folder or file a sequence.
#
# Files of a sequence: calib/SSSS.txt, oxts/SSSS.txt, label_02/SSSS.txt, velodyne/SSSS/NNNNNN.bin
# and image_0C/SSSS/NNNNNN.png.

PARTLY_TRUNCATED = 0.15
LARGELY_TRUNCATED = 0.5


class TrackingWriter(LayoutWriter):
    """Writes one sequence. The layout has no time: stamps are not written.

    Args:
        root: The dataset folder, above training.
        sequence: The sequence's number.
        split: training or testing.
    """

    layout: ClassVar[Layout] = Layout.TRACKING
    _images = names.TRACKING_IMAGES

    def __init__(self, root: Path, sequence: int = 0, split: str = names.SPLITS[0]) -> None:
        names.check_split(split)
        self.path = root / split
        self._sequence = f'{sequence:0{names.SEQUENCE_DIGITS}d}'
        self._packets: list[str] = []
        self._labels: list[str] = []
        self._labelled = False

    def write_oxts(
        self,
        number: int,
        stamp_ns: int,
        packet: OxtsPacket | str,
    ) -> None:
        """Write a line of oxts/SSSS.txt, which ends in a blank in KITTI's.

        Raises:
            UsageError: The number is not the next one.
        """
        require_next(self._table(names.OXTS), 'packet', len(self._packets), number)
        text = packet if isinstance(packet, str) else f'{format_packet(packet)} '
        self._packets.append(text.rstrip('\r\n'))

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write lines of label_02/SSSS.txt; a truncated fraction becomes a level 0, 1 or 2.

        Raises:
            ValueError: A box has no track id.
        """
        self._labelled = True
        if not isinstance(labels, str):
            boxes = (
                replace(box, frame=number, truncated=truncation_level(box.truncated))
                for box in labels
            )
            labels = format_tracking_labels(boxes)
        if labels:
            self._labels.append(labels if labels.endswith('\n') else f'{labels}\n')

    def close(self) -> None:
        """Write oxts/SSSS.txt and label_02/SSSS.txt."""
        if self._packets:
            lines = ''.join(f'{packet}\n' for packet in self._packets)
            STORE.write_text(self._table(names.OXTS), lines)
        if self._labelled:
            STORE.write_text(self._table(names.TRACKING_LABELS), ''.join(self._labels))

    def _calibration_path(self, number: int) -> Path:
        return self._table(names.CALIB)

    def _format_calibration(self, calibration: Calibration) -> str:
        return format_tracking(calibration)

    def _file(self, folder: str, number: int, suffix: str) -> Path:
        return super()._file(f'{folder}/{self._sequence}', number, suffix)

    def _table(self, folder: str) -> Path:
        return self.path / folder / f'{self._sequence}{names.TXT}'


def truncation_level(truncated: float) -> float:
    """Return the level 0, 1 or 2 of a fraction, by the object benchmark's two limits.

    Whole numbers are levels already and are kept.
    """
    if truncated.is_integer():
        return truncated
    return float((truncated > PARTLY_TRUNCATED) + (truncated > LARGELY_TRUNCATED))
