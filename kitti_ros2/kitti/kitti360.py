# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360: its folders, found, read and written; its calibration is in kitti360_calib.

    calibration/
    data_2d_raw/DRIVE/image_00 and image_01/{data_rect/%010d.png,timestamps.txt}
    data_2d_raw/DRIVE/image_02 and image_03/{data_rgb/%010d.png,timestamps.txt}
    data_3d_raw/DRIVE/{velodyne_points,sick_points}/{data/%010d.bin,timestamps.txt}
    data_poses/DRIVE/{poses.txt,cam0_to_world.txt}
    data_poses/DRIVE/oxts/{data/%010d.txt,timestamps.txt}
    data_3d_bboxes/{train,train_full}/DRIVE.xml
    data_2d_semantics/train/DRIVE/{image_00,image_01}/{semantic,instance,...}/%010d.png

A number is the same time in all streams but sick_points, at 9.57 Hz. Scans are as measured, not
compensated for motion; there are no files of the starts and ends of turns.

Poses are listed by frame number, and only for frames before which the car moved: never for frame 0,
and not for all others. poses.txt is the GPS/IMU (x forward, y right, z down) in a world of x east,
y north, z up; cam0_to_world.txt is the *rectified* camera 0, with fewer digits. Source: KITTI-360's
documentation, its authors' scripts, and the files of 11 drives; of boxes, packets, sick_points and
data_2d_semantics, of which no file was at hand, these texts alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise, starmap
from threading import Lock
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from ..model.boxes import cuboid_of
from ..model.errors import BadFileError, UsageError, describe_error, format_count, runs_of
from ..model.geometry import Transform
from ..model.samples import FrameLabels, Pose, TextFile, Trails
from ..model.streams import LABEL_STREAMS, Clock, GeoOrigin, Layout, Stream
from . import names
from .archives import describe_source
from .kitti360_boxes import (
    LEAST_POINTS,
    BoxIndex,
    WorldBox,
    describe_shapes,
    format_world_boxes,
    label_of,
    parse_world_boxes,
)
from .kitti360_calib import (
    SICK_TO_VELO,
    UPRIGHT,
    format_kitti360_calibration,
    parse_kitti360_calibration,
)
from .kitti_recording import KittiRecording, MercatorWorld, no_calibration, rect_from_imu
from .names import (
    KITTI_360_BOX_FOLDERS,
    KITTI_360_BOXES,
    KITTI_360_CALIB,
    KITTI_360_CALIBRATION,
    KITTI_360_IMAGES,
    KITTI_360_LABEL_IMAGES,
    KITTI_360_PARTS,
    KITTI_360_POSES,
    KITTI_360_SICK,
)
from .scan_file import format_scan, parse_line_scan
from .store import STORE, cached_listings
from .text_file import (
    Lines,
    NumberedPoses,
    format_packet,
    format_timestamps,
    parse_lines,
    parse_numbers,
    parse_packet,
    parse_timestamps,
)
from .writers import LayoutWriter, fill_stamps

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, LineScan, OxtsPacket, Scan
    from ..options.read import ReadOptions

DATA_2D, DATA_3D, DATA_POSES = KITTI_360_PARTS
POSES, CAM0_TO_WORLD = KITTI_360_POSES
_LARGEST_LEAN = np.cos(np.radians(60.0))
"""Of a vehicle that a pose can be of; the first pose of drive 0004 leans by 74 degrees."""
_SAME_M, _SAME_ROTATION = 5e-3, 1e-4
"""Limits for the two files of poses; in 11 drives they differ by 5e-4 m and 5e-7."""
_KEPT_SCANS = 4
_LAST_OF_0018 = 3750
"""The last frame with a pose of drive 0018; up to there drive 0002 lists the same poses."""
_NOT_READ = {
    'data_3d_semantics': '; its points are of windows of many frames, not of scans',
    **dict.fromkeys(
        (
            f'{KITTI_360_LABEL_IMAGES}/{{}}/{at}instanceDict.json'
            for at in ('', 'image_00/', 'image_01/')
        ),
        '; it lists what images of instances have',
    ),
    **dict.fromkeys(names.KITTI_360_TEST_SLAM, ''),
}

LEANING = 'poses lean by more than 60 degrees, or their z is not down'
"""Beginning of a loss, for validate."""

RENAMED = ('2013_05_28_drive_0002_sync', 4391)
"""The drive whose first images and scans are those of drive 0018, and its first frame with files.

Its time stamps and poses begin at frame 0. Source: kitti360Scripts, issues 92 and 138.
"""


def first_file(name: str) -> int:
    """Return the first frame of a drive that has files, whatever its time stamps list."""
    return RENAMED[1] if name == RENAMED[0] else 0


class _StreamFolder(NamedTuple):
    """The folder of a stream, its sub-folder of files, and their suffixes."""

    path: Path
    data: str
    suffixes: tuple[str, ...]


def drives_at(path: Path) -> tuple[Path, list[str]]:
    """Return the root of a set, and the drives at a path: the root, a part of it, or a drive."""
    is_drive = path.parent.name in KITTI_360_PARTS and names.RAW_DRIVE.fullmatch(path.name)
    if is_drive:
        return path.parent.parent, [path.name]
    root = path.parent if path.name in KITTI_360_PARTS else path
    drives = {name for part in KITTI_360_PARTS for name in STORE.names(root / part)}
    return root, sorted(filter(names.RAW_DRIVE.fullmatch, drives))


class Kitti360Recording(KittiRecording):
    """One drive of KITTI-360."""

    layout = Layout.KITTI_360

    @cached_listings()
    def __init__(self, root: Path, name: str, options: ReadOptions) -> None:
        super().__init__(root, name, options)
        images, scans = root / DATA_2D / name, root / DATA_3D / name
        self._folders = {
            Stream.SCAN: _StreamFolder(scans / names.RAW_SCANS, names.RAW_DATA, (names.BIN,))
        } | {
            Stream(f'image_{index}'): _StreamFolder(images / folder, data, names.IMAGE_SUFFIXES)
            for index, (folder, data) in enumerate(KITTI_360_IMAGES)
        }
        packets = _StreamFolder(self._drive / names.RAW_OXTS, names.RAW_DATA, (names.TXT,))
        if packets.path.is_dir():
            self._folders[Stream.OXTS] = packets
        for stream in LABEL_STREAMS:
            kind, camera = stream.label_image or ('', 0)
            path = root / KITTI_360_LABEL_IMAGES / name / KITTI_360_IMAGES[camera][0]
            if (path / kind).is_dir():
                self._folders[stream] = _StreamFolder(path, kind, names.IMAGE_SUFFIXES)
        data = {folder.path / folder.data: folder.suffixes for folder in self._folders.values()}
        self._name_frames(data, names.RAW_DIGITS)
        self._last_scans: dict[int, Scan] = {}
        self._scan_lock = Lock()
        self.clock = Clock.UTC if self._stamps else Clock.NOMINAL
        for stream in self._folders:
            self._add_folder(stream)
        self._require_common_names()
        self._add_poses()
        self._add_sick()
        self._add_boxes()
        self._add_turns()
        if self.clock is Clock.NOMINAL and self.streams:
            self._find_gaps(self._folders.keys() - LABEL_STREAMS)
            self.notes.append(f'{name}: no {names.TIMESTAMPS} in any stream; {self._nominal_time}')
        others = {root / part.format(name): why for part, why in _NOT_READ.items()}
        self.notes += [f'{p}: not converted{why}' for p, why in others.items() if p.exists()]
        self._find_misnamed()

    def _find_misnamed(self) -> None:
        """Report the folders that look like data of the drive, and are named differently."""
        streams = (Stream.IMAGE_0, Stream.SCAN, Stream.POSE)
        start = self.name.rpartition('_')[0]
        wanted = [
            (stream, self.root / part, self.name, start)
            for stream, part in zip(streams, KITTI_360_PARTS, strict=True)
        ] + [(stream, folder.path, folder.data, '') for stream, folder in self._folders.items()]
        for stream, parent, expected, start in wanted:
            for name in () if (parent / expected).is_dir() else STORE.names(parent):
                if name.startswith(start) and (parent / name).is_dir():
                    text = f'{parent / name}: not read; expected a folder {expected}'
                    self._lose_lines(stream, text)

    @cached_property
    def _stamps(self) -> dict[Stream, Lines[int]]:
        """The stamps of the streams that have a file of them."""
        paths = {stream: self._stamps_path(stream) for stream in self._folders}
        return {
            stream: self._parsed(path, stream, parse_timestamps)
            for stream, path in paths.items()
            if path.is_file()
        }

    @property
    def _stamped(self) -> Stream:
        """The stream whose stamps others take: the first one whose file has any."""
        return max(self._stamps, key=lambda stream: any(self._stamps[stream].values))

    def _stamps_path(self, stream: Stream) -> Path:
        return self._folders[stream].path / names.TIMESTAMPS

    @property
    def _drive(self) -> Path:
        return self.root / DATA_POSES / self.name

    def _add_folder(self, stream: Stream) -> None:
        folder, data, suffixes = self._folders[stream]
        if not folder.is_dir():
            if stream.camera in (None, *self.layout.traits.cameras):
                self.notes.append(f'{folder}: absent, {stream.value} is left out')
            return
        listing = self._list(folder / data, suffixes)
        if not len(listing.numbers) and not listing.strays:
            self.notes.append(f'{folder / data}: absent or empty, {stream.value} is left out')
            return
        if not self._stamps:
            self._add_nominal(stream, listing.numbers, listing)
            return
        labelled = stream.label_image and Stream(f'image_{stream.label_image[1]}')
        own = [stamped for stamped in (stream, labelled) if stamped in self._stamps]
        of = own[0] if own else self._stamped
        text = f'{folder}: no {names.TIMESTAMPS}; stamped as {of.value}'
        if not own and text not in self.notes:  # of several kinds of label images
            self.notes.append(text)
        lines, first = self._stamps[of], 0
        if of is stream and 0 < first_file(self.name) <= min(listing.numbers, default=0):
            first = first_file(self.name)
            self.notes.append(f'{folder}: files begin at {first}; drive 0018 is the drive before')
        if of is not stream:
            first = len(lines)  # of the stream itself no file lists frames
        self._add_stamped(stream, listing, lines, self._stamps_path(of), first)

    @cached_property
    def _poses_path(self) -> Path:
        """poses.txt, or else cam0_to_world.txt, which has fewer digits."""
        paths = (self._drive / POSES, self._drive / CAM0_TO_WORLD)
        return next((path for path in paths if path.is_file() and path.stat().st_size), paths[0])

    @cached_property
    def _listed_poses(self) -> dict[int, Float64Array]:
        """The (3, 4) matrices of the file by frame."""
        lines, numbers = self._parsed(self._poses_path, Stream.POSE, parse_kitti360_poses)
        for error in lines.errors.values():
            self._lose_lines(Stream.POSE, str(error))
        return {numbers[line]: matrix for line, matrix in lines.sound().items()}

    @cached_property
    def _poses(self) -> dict[int, Float64Array]:
        """The (3, 4) matrices that a vehicle can have, in the order of frames."""
        # y of camera 0 is down, as z of the GPS/IMU.
        down = 1 if self._poses_path.name == CAM0_TO_WORLD else 2
        poses = dict(sorted(self._listed_poses.items()))
        leaning = [n for n, matrix in poses.items() if -matrix[2, down] < _LARGEST_LEAN]
        self._lose(Stream.POSE, leaning, f'{self._poses_path}: {LEANING}; left out: frames {{}}')
        left_out = frozenset(leaning)
        return {number: poses[number] for number in poses if number not in left_out}

    def _add_poses(self) -> None:
        numbers, path = [*self._poses], self._poses_path
        if not numbers:
            is_there = path.is_file() and path.stat().st_size
            which = 'no valid pose' if is_there else 'absent or empty'
            self.notes.append(f'{path}: {which}, pose is left out')
            return
        if path.name == CAM0_TO_WORLD:
            self.notes.append(f'{path}: read without {POSES}, which has more digits')
            if self._calibration.nominal:
                self.notes.append(f'{path}: carried to imu_link by a nominal calibration')
        self.notes.append(f'{path}: {_describe_holes(numbers)}')
        if self.name == RENAMED[0] and numbers[0] <= _LAST_OF_0018:
            self.notes.append(f"{path}: poses to frame {_LAST_OF_0018} are drive 0018's, too")
        if not self._stamps:
            self._add_nominal(Stream.POSE, np.array(numbers, dtype=np.int64), None)
            return
        of = self._stamped
        for stream in list(self._stamps)[: list(self._stamps).index(of)]:
            path = self._stamps_path(stream)
            self._lose_lines(Stream.POSE, f'{path}: no stamp; poses are stamped as {of.value}')
        beyond = self._add_at(Stream.POSE, numbers, self._stamps[of].values)
        self._lose(
            Stream.POSE, beyond, f'{self._stamps_path(of)}: no stamp for the poses of frames {{}}'
        )

    def _add_sick(self) -> None:
        """Add the scans of the line scanner, with stamps of their own: several come in a frame."""
        if not self._sick.is_dir():
            return
        listing = STORE.list_numbered(self._sick / names.RAW_DATA, (names.BIN,), names.RAW_DIGITS)
        path = self._sick / names.TIMESTAMPS
        if self.streams and not self._stamps:
            self._lose_lines(Stream.SICK, f'{self._sick}: left out, as no other stream has stamps')
            return
        lines = self._parsed(path, Stream.SICK, parse_timestamps)
        self.clock = Clock.UTC
        first = min(listing.numbers, default=0) if first_file(self.name) else 0
        self._add_stamped(Stream.SICK, listing, lines, path, first)

    @property
    def _sick(self) -> Path:
        return self.root / DATA_3D / self.name / KITTI_360_SICK

    @cached_property
    def _boxes_path(self) -> Path:
        """The file of boxes, the first that exists."""
        folder = self.root / KITTI_360_BOXES
        paths = [folder / part / f'{self.name}.xml' for part in KITTI_360_BOX_FOLDERS]
        return next((path for path in paths if path.is_file()), paths[0])

    def _add_boxes(self) -> None:
        """Add the boxes of the frames with a pose and a scan, whose stamps they have."""
        path = self._boxes_path
        scans, poses = self.streams.get(Stream.SCAN), self.streams.get(Stream.POSE)
        if not path.is_file():
            return
        if scans is None or poses is None or self._calibration.nominal:
            needed = 'a frame needs a scan, a pose, and the calibration of both'
            self._lose_lines(Stream.LABELS, f'{path}: {needed}; labels are left out')
            return
        index = np.isin(scans.numbers, poses.numbers)
        index &= np.isin(scans.numbers, self._boxes.frames(scans.numbers))
        self._add(Stream.LABELS, scans.numbers[index], scans.stamps_ns[index], None)

    @cached_property
    def _boxes(self) -> BoxIndex:
        path, numbers = self._boxes_path, np.array([*self._poses], np.int64)
        positions = np.array([matrix[:, 3] for matrix in self._poses.values()]).reshape(-1, 3)
        try:
            boxes, errors, shapes = parse_world_boxes(self.common_files.read(path), path)
        except (BadFileError, OSError) as error:
            self._lose_lines(Stream.LABELS, describe_error(error))
            return BoxIndex([], numbers, positions)
        for invalid in errors:
            self._lose_lines(Stream.LABELS, str(invalid))
        moving = sum(box.frame is not None for box in boxes)
        self.notes.append(
            f'{path}: {format_count(len(boxes), "object")}, {moving} of them in motion; a frame has'
            f' those with {LEAST_POINTS} points or more of its scan in their box'
        )
        if shapes:
            self.notes.append(f'{path}: {describe_shapes(shapes)}; they are left out')
        return BoxIndex(boxes, numbers, positions)

    def _scan(self, number: int) -> Scan:
        """Return a scan; the last ones are kept for the boxes of their frames."""
        if Stream.LABELS not in self.streams:
            return super()._scan(number)
        with self._scan_lock:  # two threads ask for one scan: for itself, and for its boxes
            scan = self._last_scans.get(number) or super()._scan(number)
            self._last_scans = dict([*self._last_scans.items(), (number, scan)][-_KEPT_SCANS:])
        return scan

    def _labels(self, number: int) -> FrameLabels:
        velo_t_imu = self.calibration(number).velo_T_imu
        velo_t_world = velo_t_imu @ self._pose(number).world_T_imu.inverse()
        points = self._scan(number).points
        return FrameLabels(cuboids=self._boxes.of_frame(number, velo_t_world, points))

    @cached_property
    def _trails(self) -> Trails:
        """The paths of moving objects; those of a frame need no scans."""
        return Trails(self._boxes.moving(), lambda _: Transform.identity())

    @cached_property
    def _calibration(self) -> Calibration:
        folder = self.root / KITTI_360_CALIBRATION
        texts, missing = {}, {}
        try:
            present = [name for name in STORE.names(folder) if name in KITTI_360_CALIB]
        except OSError as error:
            self._lose_late(Stream.CALIBRATION, describe_error(error))
            return no_calibration(describe_error(error))
        for name in present:
            try:
                texts[name] = STORE.read_text(folder / name)
            except (BadFileError, OSError) as error:
                missing[name] = describe_error(error)
                self._lose_late(Stream.CALIBRATION, missing[name])
        source = describe_source(self.layout, folder)
        parsed = parse_kitti360_calibration(texts, folder, source=source)
        if self._sick.is_dir() and SICK_TO_VELO not in {*present, *missing}:
            missing[SICK_TO_VELO] = f'{folder / SICK_TO_VELO}: no such file; {source}'
        files = tuple(
            TextFile(f'{KITTI_360_CALIBRATION}/{file.name}', file.text) for file in parsed.files
        )
        return replace(parsed, files=files, missing={**parsed.missing, **missing})

    def text_paths(self) -> list[Path]:
        """List the time stamps, those of the poses first, the poses, and the boxes."""
        stamps = [self._stamps_path(stream) for stream in self._folders]
        stamps.append(self._sick / names.TIMESTAMPS)
        others = [self._drive / POSES, self._drive / CAM0_TO_WORLD, self._boxes_path]
        return [path for path in (*stamps, *others) if path.is_file()]

    def _pose(self, number: int) -> Pose:
        pose = Transform.from_matrix(self._poses[number])
        if self._poses_path.name == CAM0_TO_WORLD:
            return Pose(pose @ rect_from_imu(self._calibration))
        return Pose(pose @ UPRIGHT)

    def contradictions(self) -> Iterator[str]:
        """Yield the lines of cam0_to_world.txt that are not poses.txt times the calibration."""
        path, calibration = self._drive / CAM0_TO_WORLD, self._calibration
        if not path.is_file() or path == self._poses_path or calibration.nominal:
            return
        lines, numbers = self._parsed(path, Stream.POSE, parse_kitti360_poses)
        yield from map(str, lines.errors.values())
        imu_t_rect = rect_from_imu(calibration).inverse()
        for line, matrix in lines.sound().items():
            where, number = f'{path}:{line + 1}', numbers[line]
            if number not in self._listed_poses:
                yield f'{where}: frame {number} is not in {POSES}'
                continue
            pose = Transform.from_matrix(self._listed_poses[number]) @ UPRIGHT
            camera = pose @ imu_t_rect
            apart = np.abs(camera.matrix()[:3] - matrix)
            if not (apart[:, 3].max() < _SAME_M and apart[:, :3].max() < _SAME_ROTATION):
                turn = Transform.from_matrix(matrix).rotation.T @ camera.rotation
                degrees = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
                metres = np.linalg.norm(apart[:, 3])
                yield f'{where}: frame {number} is {metres:.3f} m, {degrees:.3f} deg from {POSES}'

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.CALIBRATION:
            return self.root / KITTI_360_CALIBRATION
        if stream is Stream.LABELS:
            return self._boxes_path
        return self._poses_path if stream is Stream.POSE else super().path(stream, number)

    def _line_scan(self, number: int) -> LineScan:
        path = self._listings[Stream.SICK].path(number)
        return parse_line_scan(STORE.read_array(path), path)

    def _packet(self, number: int) -> OxtsPacket:
        path = self._listings[Stream.OXTS].path(number)
        text = STORE.read_text(path)
        return parse_packet(text, path, 1, self._verbatim(path, text))


def _describe_holes(numbers: list[int]) -> str:
    """Describe the frames with a pose, of which not all are there."""
    runs = runs_of(numbers)
    without = numbers[-1] - numbers[0] + 1 - len(numbers)
    widest = max((after[0] - run[1] for run, after in pairwise(runs)), default=1)
    there = f'{format_count(len(numbers), "pose")} of frames {numbers[0]} to {numbers[-1]}'
    if not without:
        return there
    return f'{there}, {without} between them have none, up to {widest - 1} in a row'


def parse_kitti360_poses(text: str, path: Path) -> NumberedPoses:
    """Parse poses.txt (12 numbers after the frame) or cam0_to_world.txt (16, a (4, 4) matrix)."""
    count = 16 if path.name == CAM0_TO_WORLD else 12
    expected = f'a frame number and {count} numbers, a pose matrix'
    rows = parse_lines(text, path, expected, partial(_parse_pose, count=count))
    numbers: list[int] = []
    matrices: list[Float64Array | None] = []
    errors, seen = dict(rows.errors), set[int]()
    for line, row in enumerate(rows.values):
        number, matrix = (-1, None) if row is None else row
        if matrix is not None and number in seen:
            errors[line] = BadFileError(path, f'frame {number} again', expected, line=line + 1)
            matrix = None
        seen.add(number)
        numbers.append(number)
        matrices.append(matrix)
    return NumberedPoses(Lines(matrices, dict(sorted(errors.items()))), numbers)


def _parse_pose(line: str, count: int) -> tuple[int, Float64Array]:
    words = line.split()
    if len(words) != count + 1:
        raise ValueError(f'{len(words)} values')
    number = names.number_of(words[0])
    if number is None:
        raise ValueError(f'{words[0]!r} is no frame number')
    matrix = np.array(parse_numbers(words[1:], count)).reshape(-1, 4)
    if (matrix[3:] != (0, 0, 0, 1)).any():
        raise ValueError('the last row is not 0 0 0 1')
    return number, matrix[:3]


# Writer of a drive. Poses and boxes are in the world of the data set if there are packets, else in
# imu_link at frame 0.

_ORIGIN = GeoOrigin(48.9843445, 8.4295857, 0.0)
"""Of the world in Mercator's projection, with its scale (facts of 0000, 0003 and 0008)."""
_STANDS_M = 0.01
_SPARE_M = 1e-3


class Kitti360Writer(LayoutWriter):
    """Writes one drive.

    Args:
        root: The folder above calibration, data_2d_raw and others.
        name: The drive.
    """

    layout: ClassVar[Layout] = Layout.KITTI_360

    def __init__(self, root: Path, name: str) -> None:
        names.parse_drive(name)
        self.path = root
        self._name = name
        self._calibration: Calibration | None = None
        self._stamps: dict[Path, dict[int, int]] = {}
        self._poses: dict[int, Float64Array] = {}
        self._world_T_imu = Transform.identity()
        self._tracks: dict[int, dict[int, Box]] = {}

    @property
    def accepts(self) -> frozenset[Stream]:
        """The streams of the layout without the line scanner and label images."""
        return self.layout.traits.streams - {Stream.SICK, *LABEL_STREAMS}

    def write_calibration(self, number: int, calibration: Calibration) -> None:
        """Write the files of the calibration; the last is kept."""
        self._calibration = calibration
        self.write_calibration_text(number, format_kitti360_calibration(calibration))

    def write_calibration_text(self, number: int, texts: Mapping[str, str]) -> None:  # noqa: ARG002
        """Write calibration files verbatim, by file name."""
        for name, text in texts.items():
            STORE.write_text(self.path / KITTI_360_CALIBRATION / name, text)

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write a sweep; the layout has no place for its start and end."""
        folder = self.path / DATA_3D / self._name / names.RAW_SCANS
        file = names.file_name(number, names.RAW_DIGITS, names.BIN)
        STORE.write(folder / names.RAW_DATA / file, format_scan(scan.points))
        self._stamps.setdefault(folder, {})[number] = stamp_ns

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write an image."""
        self._check_camera(camera)
        image, data = KITTI_360_IMAGES[camera]
        folder = self.path / DATA_2D / self._name / image
        STORE.write(folder / data / names.file_name(number, names.RAW_DIGITS, names.PNG), png)
        self._stamps.setdefault(folder, {})[number] = stamp_ns

    def write_pose(self, number: int, stamp_ns: int, first_T_cam0: Float64Array) -> None:  # noqa: ARG002
        """Write a line of poses.txt."""
        self._poses[number] = first_T_cam0

    def write_oxts(self, number: int, stamp_ns: int, packet: OxtsPacket | str) -> None:
        """Write one packet; that of frame 0 places the drive in the world."""
        folder = self.path / DATA_POSES / self._name / names.RAW_OXTS
        file = names.file_name(number, names.RAW_DIGITS, names.TXT)
        text = packet if isinstance(packet, str) else f'{format_packet(packet)}\n'
        STORE.write_text(folder / names.RAW_DATA / file, text)
        self._stamps.setdefault(folder, {})[number] = stamp_ns
        if number == 0:
            first = parse_packet(text, file)
            self._world_T_imu = MercatorWorld.at(_ORIGIN).pose(first)

    def write_labels(self, number: int, labels: Iterable[Box] | str) -> None:
        """Write boxes of a frame that has a pose.

        Raises:
            UsageError: The labels are lines of text, which this layout does not support.
            ValueError: A box has no track id.
        """
        if isinstance(labels, str):
            raise UsageError('KITTI-360 keeps labels as boxes; hand over boxes, not lines')
        for box in labels:
            if box.track_id is None:
                raise ValueError('a box in the world needs a track id')
            self._tracks.setdefault(box.track_id, {})[number] = box

    def close(self) -> None:
        """Write the time stamps, both files of poses, and the boxes."""
        for folder, stamps in self._stamps.items():
            STORE.write_text(folder / names.TIMESTAMPS, format_timestamps(fill_stamps(stamps)))
        if not self._poses or self._calibration is None:
            return
        rect_t_imu = rect_from_imu(self._calibration)
        world_t_first = self._world_T_imu @ rect_t_imu.inverse()
        cameras = {
            number: world_t_first @ Transform.from_matrix(matrix)
            for number, matrix in sorted(self._poses.items())
        }
        poses = {number: camera @ rect_t_imu @ UPRIGHT for number, camera in cameras.items()}
        folder = self.path / DATA_POSES / self._name
        STORE.write_text(folder / POSES, ''.join(starmap(_format_pose, poses.items())))
        STORE.write_text(folder / CAM0_TO_WORLD, ''.join(starmap(_format_camera, cameras.items())))
        if self._tracks:
            boxes = [box for _, track in sorted(self._tracks.items())
                     for box in _place(track, cameras)]  # fmt: skip
            path = self.path / KITTI_360_BOXES / KITTI_360_BOX_FOLDERS[0] / f'{self._name}.xml'
            STORE.write_text(path, format_world_boxes(boxes))


def _format_pose(number: int, pose: Transform) -> str:
    """Format a line of poses.txt."""
    return f'{number} {" ".join(f"{value:.10g}" for value in pose.matrix()[:3].ravel())}\n'


def _format_camera(number: int, camera: Transform) -> str:
    """Format a line of cam0_to_world.txt: %f and MATLAB's %d, an exponent unless whole, in turn."""
    words = [f'{value:.6f}' for value in camera.matrix().ravel().tolist()]
    for index, value in enumerate(camera.matrix()[:, 1::2].ravel().tolist()):
        words[2 * index + 1] = f'{value:.0f}' if value.is_integer() else f'{value:.6e}'
    return f'{number} {" ".join(words)} \n'


def _place(track: Mapping[int, Box], cameras: Mapping[int, Transform]) -> Iterator[WorldBox]:
    """Yield the boxes of an object in the world: one if it stands, else one a frame.

    They are larger by a millimetre on each side, so that the points on their faces are inside.

    Args:
        track: Its labels, by frame.
        cameras: world_T_cam0, by frame.
    """
    window = min(track), max(track)
    places = {}
    for number, box in sorted(track.items()):
        cuboid = cuboid_of(box, '', Transform.identity())
        places[number] = cameras[number] @ cuboid.velo_T_box
    first = places[window[0]].translation
    moved = [np.linalg.norm(place.translation - first) for place in places.values()]
    stands = len(places) > 1 and max(moved) < _STANDS_M
    for number in [window[0]] if stands else places:
        box = track[number]
        height, width, length = (size + 2 * _SPARE_M for size in box.size_hwl)
        label, frame = label_of(box.class_name), None if stands else number
        yield WorldBox(
            box.class_name,
            label,
            box.track_id or 0,
            places[number],
            (length, width, height),
            window,
            frame,
        )
