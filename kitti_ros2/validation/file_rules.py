# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about one file: readable content, labels, calibrations."""

from __future__ import annotations

import math
import os
import stat
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.remote import is_remote
from ..kitti import names
from ..kitti.label_file import parse_labels
from ..kitti.scan_file import POINT_BYTES
from ..kitti.store import MOST_BYTES
from ..model.boxes import DONT_CARE, has_cuboid, is_absurd
from ..model.errors import BadFileError, format_bytes
from ..model.geometry import Transform
from ..model.samples import LEFT_OF, rectified_offset
from ..model.streams import IMAGE_STREAMS, LABEL_STREAMS, Stream
from .rule import ERROR, NOTE, WARNING, Breach, RuleScope, RuleTable, breach_in, breach_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration


# Rules about one file: readable, of a possible size, parsable.

_MOST_TEXT = 16 << 20  # the largest text file of KITTI has 1 MB
_COPY = 'copy or download the file again'
_CORRECT = 'correct the line, or label the object again'


@dataclass(frozen=True)
class DataFile:
    """A file of a stream.

    Attributes:
        stream: Stream.
        path: The file.
        size: Bytes; 0 if it cannot be opened.
        error: Error of opening or parsing it.
        regular: True for a regular file, not a pipe or a folder.
        point_bytes: Bytes of a point of a scan.
    """

    stream: Stream
    path: Path
    size: int
    error: Exception | None = None
    regular: bool = True
    point_bytes: int = POINT_BYTES

    @classmethod
    def from_path(cls, stream: Stream, path: Path, point_bytes: int = POINT_BYTES) -> DataFile:
        """Return a file with its size, or the error of the file system."""
        try:
            status = path.stat() if is_remote(path) else os.stat(path)  # noqa: PTH116 - a tenth of the time of Path.stat
        except OSError as error:
            return cls(stream, path, 0, error)
        regular = stat.S_ISREG(status.st_mode)
        return cls(stream, path, status.st_size, regular=regular, point_bytes=point_bytes)

    @property
    def most_bytes(self) -> int:
        """The largest size that is read."""
        return _MOST_TEXT if self.path.suffix == names.TXT else MOST_BYTES

    @property
    def is_worth_reading(self) -> bool:
        """True if no rule about sizes is broken."""
        return not (
            self.error
            or not self.regular
            or self.size > self.most_bytes
            or _is_empty(self)
            or _is_cut(self)
        )


def _is_empty(file: DataFile) -> bool:
    # A frame without objects may have an empty label file.
    return file.regular and not file.error and not file.size and file.stream is not Stream.LABELS


def _is_cut(file: DataFile) -> bool:
    return file.path.suffix.lower() == names.BIN and file.size % file.point_bytes != 0


FILE_RULES = RuleTable[DataFile](RuleScope.FILE)


@FILE_RULES.add(
    'file-readable',
    ERROR,
    'Files can be opened, and are regular files',
    'check permissions, links and the disk',
)
def _find_unreadable(file: DataFile) -> Iterator[Breach]:
    if isinstance(file.error, OSError):
        yield breach_of(file.error, file.path)
    elif not file.regular:
        yield Breach('is a pipe, a device or a folder', file.path)


@FILE_RULES.add('file-empty', ERROR, 'Files are not empty', _COPY)
def _find_empty(file: DataFile) -> Iterator[Breach]:
    if _is_empty(file):
        yield Breach('the file is empty', file.path)


@FILE_RULES.add(
    'file-huge',
    ERROR,
    'Binary files have at most 268 MB, text files 17 MB',
    f'{_COPY}; check which program wrote it',
)
def _find_huge(file: DataFile) -> Iterator[Breach]:
    if file.regular and file.size > file.most_bytes:
        limit = format_bytes(file.most_bytes)
        text = f'{format_bytes(file.size)}; files of more than {limit} are not read'
        yield Breach(text, file.path)


@FILE_RULES.add(
    'scan-size', ERROR, 'Scans have 16 bytes a point, or those of --columns; line scans 8', _COPY
)
def _find_cut(file: DataFile) -> Iterator[Breach]:
    if _is_cut(file):
        text = f'{file.size} bytes, which is no multiple of {file.point_bytes}'
        yield Breach(text, file.path)


def _failed(*streams: Stream) -> Callable[[DataFile], Iterator[Breach]]:
    """Return a function that finds unparsable files of some streams."""

    def find(file: DataFile) -> Iterator[Breach]:
        if file.stream in streams and isinstance(file.error, BadFileError):
            yield breach_of(file.error, file.path)

    return find


FILE_RULES.add('scan-file', ERROR, 'Scans can be parsed', _COPY)(_failed(Stream.SCAN, Stream.SICK))
FILE_RULES.add(
    'image-file',
    ERROR,
    'Images are whole PNGs, and the checksum of each chunk is right; label images have their bits',
    _COPY,
)(_failed(*IMAGE_STREAMS, *LABEL_STREAMS))
FILE_RULES.add('oxts-packet', ERROR, 'GPS/IMU packets have 30 finite numbers, on earth', _COPY)(
    _failed(Stream.OXTS)
)
FILE_RULES.add('text-file', ERROR, 'Text files are UTF-8; tracklets are whole XML', _COPY)(
    _failed(Stream.LABELS, Stream.CALIBRATION, Stream.RECORDING)
)


# Rules about a label file: values that the devkits' readme.txt allow, contradictions.
#
# Limits, from tracking 0000 (1089 rows) and object 000000..2: objects are up to 13 m long, tracks
# move at most 0.9 m a frame relative to the car, so 15 m is far beyond oncoming traffic.

CLASSES = frozenset(
    {'Car', 'Van', 'Truck', 'Pedestrian', 'Person_sitting', 'Cyclist', 'Tram', 'Misc', DONT_CARE}
)
"""The classes of KITTI (source: readme.txt of the object devkit)."""
_ALSO = {'Person': 'Person_sitting'}  # the name in tracking
_ANGLE = math.pi + 0.01  # two decimals round pi up
_FARTHEST_M = 10_000.0
_LONGEST_M = 100.0
_JUMP_M = 15.0
_OCCLUDED = range(-1, 4)
_TRUNCATED_LEVELS = (-1, 0, 1, 2)


class LabelLine(NamedTuple):
    """A labelled object with its line in the file, from 1."""

    line: int
    box: Box


@dataclass(frozen=True)
class LabelFile:
    """A parsed label file.

    Attributes:
        path: The file.
        lines: The valid lines.
        errors: Errors of the invalid lines.
        tracking: True for a tracking file, of many frames.
    """

    path: Path
    lines: Sequence[LabelLine]
    errors: Sequence[BadFileError] = ()
    tracking: bool = False
    by_frame: dict[int | None, list[LabelLine]] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str, path: Path, *, tracking: bool = False) -> LabelFile:
        """Parse the text of a file."""
        parsed = parse_labels(text, path)
        lines = [LabelLine(line + 1, box) for line, box in parsed.sound().items()]
        by_frame: dict[int | None, list[LabelLine]] = {}
        for label_line in lines:
            by_frame.setdefault(label_line.box.frame, []).append(label_line)
        return cls(path, lines, tuple(parsed.errors.values()), tracking, by_frame)


LABEL_RULES = RuleTable[LabelFile](RuleScope.FILE)


@LABEL_RULES.add(
    'label-line',
    ERROR,
    'Lines of labels have 15 or 16 columns (tracking 17 or 18) of finite numbers',
    _CORRECT,
)
def _find_invalid_labels(file: LabelFile) -> Iterator[Breach]:
    for error in file.errors:
        yield breach_of(error, file.path)


@LABEL_RULES.add(
    'label-columns',
    ERROR,
    'Object files have lines of objects, tracking files lines with frame and track',
    'give the label file of the same benchmark',
)
def _find_columns(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if (box.frame is not None) != file.tracking:
            kinds = ('an object', 'a tracking') if file.tracking else ('a tracking', 'an object')
            text = f'a line of {kinds[0]} file; expected {kinds[1]} file'
            yield Breach(text, file.path, line)


@LABEL_RULES.add(
    'label-level',
    ERROR,
    'occluded is -1 to 3; truncated is 0 to 1 or -1, in tracking -1 to 2',
    _CORRECT,
)
def _find_levels(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if box.occluded not in _OCCLUDED:
            yield Breach(f'{box.class_name}: occluded is {box.occluded}', file.path, line)
        levels = box.truncated in _TRUNCATED_LEVELS
        if not (levels if file.tracking else 0 <= box.truncated <= 1 or box.truncated == -1):
            yield Breach(f'{box.class_name}: truncated is {box.truncated:g}', file.path, line)


@LABEL_RULES.add(
    'label-angle',
    WARNING,
    'alpha and rotation_y are within -pi to pi, or -10 if unknown',
    'wrap the angle; radians, not degrees',
)
def _find_angles(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        for name, angle in (('alpha', box.alpha), ('rotation_y', box.rotation_y)):
            if abs(angle) > _ANGLE and angle != -10:
                yield Breach(f'{box.class_name}: {name} is {angle:g}', file.path, line)


@LABEL_RULES.add(
    'label-box',
    ERROR,
    '2D boxes are left, top, right, bottom',
    'check the order; KITTI has corners, not width and height',
)
def _find_box_2d(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        left, top, right, bottom = box.box_2d
        if right < left or bottom < top:
            numbers = ' '.join(f'{value:g}' for value in box.box_2d)
            yield Breach(f'{box.class_name}: the 2D box is {numbers}', file.path, line)


@LABEL_RULES.add(
    'label-size',
    ERROR,
    'Height, width and length are positive, below 100 m',
    'check the order (height, width, length) and the unit (metres)',
)
def _find_sizes(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if is_absurd(box) or max(box.size_hwl) > _LONGEST_M:
            numbers = ' '.join(f'{value:g}' for value in box.size_hwl)
            yield Breach(f'{box.class_name}: height, width, length are {numbers}', file.path, line)


@LABEL_RULES.add(
    'label-location',
    ERROR,
    'Locations are within 10 km',
    'check the unit (metres) and the frame (rectified camera 0)',
)
def _find_far(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if max(map(abs, box.location)) > _FARTHEST_M:
            numbers = ' '.join(f'{value:g}' for value in box.location)
            yield Breach(f'{box.class_name}: the location is {numbers}', file.path, line)


@LABEL_RULES.add(
    'label-class',
    WARNING,
    'Class names that resemble those of KITTI are spelled as there',
    'evaluations compare names exactly: rename the class',
)
def _find_classes(file: LabelFile) -> Iterator[Breach]:
    for line, box in file.lines:
        if box.class_name in CLASSES:
            continue
        class_name = _BY_PLAIN.get(_plain(box.class_name), box.class_name)
        if class_name != box.class_name:
            yield Breach(f'{box.class_name}: did you mean {class_name}?', file.path, line)


def _plain(name: str) -> str:
    return ''.join(filter(str.isalnum, name)).lower()


_BY_PLAIN = {_plain(name): name for name in (*CLASSES, *_ALSO)}
"""The class names by their plain spelling."""


@LABEL_RULES.add(
    'label-repeated', WARNING, 'No object is listed twice in a frame', 'remove one of the lines'
)
def _find_repeated(file: LabelFile) -> Iterator[Breach]:
    seen: dict[Box, int] = {}
    for line, box in file.lines:
        first = seen.setdefault(box, line)
        if first != line:
            yield Breach(f'{box.class_name}: the same object as in line {first}', file.path, line)


@LABEL_RULES.add(
    'track-repeated',
    ERROR,
    'No track is twice in a frame',
    'give one of the objects a track id of its own',
)
def _find_repeated_tracks(file: LabelFile) -> Iterator[Breach]:
    seen: dict[tuple[int | None, int | None], int] = {}
    for line, box in file.lines:
        if box.track_id is None or box.track_id < 0:
            continue
        first = seen.setdefault((box.frame, box.track_id), line)
        if first != line:
            text = f'{box.class_name}: track {box.track_id} is in frame {box.frame} twice'
            yield Breach(f'{text}, first in line {first}', file.path, line)


@LABEL_RULES.add(
    'track-class',
    WARNING,
    'Tracks keep their class',
    'correct the class, or give the second object a track id of its own',
)
def _find_changing_tracks(file: LabelFile) -> Iterator[Breach]:
    for before, (line, box) in _successors(file):
        if before.class_name != box.class_name:
            text = f'track {box.track_id} changes from {before.class_name} to {box.class_name}'
            yield Breach(text, file.path, line)


@LABEL_RULES.add(
    'track-jump',
    WARNING,
    'Tracks move at most 15 m a frame',
    'correct the location, or the frame number',
)
def _find_jumps(file: LabelFile) -> Iterator[Breach]:
    for before, (line, box) in _successors(file):
        frames = (box.frame or 0) - (before.frame or 0)
        if frames > 0 and has_cuboid(box) and has_cuboid(before):
            step = math.dist(before.location, box.location)
            if step > _JUMP_M * frames:
                text = (
                    f'{box.class_name}: track {box.track_id} moves {step:.0f} m in {frames} frame'
                )
                yield Breach(text + ('s' if frames > 1 else ''), file.path, line)


def _successors(file: LabelFile) -> Iterator[tuple[Box, LabelLine]]:
    """Yield each line of a track with the previous box of the track."""
    tracks: dict[int, list[LabelLine]] = {}
    for label_line in file.lines if file.tracking else ():
        if label_line.box.track_id is not None and label_line.box.track_id >= 0:
            tracks.setdefault(label_line.box.track_id, []).append(label_line)
    for lines in tracks.values():
        ordered = sorted(lines, key=lambda label_line: label_line.box.frame or 0)
        for before, after in pairwise(ordered):
            yield before.box, after


# Rules about a calibration.
#
# Limits, from KITTI's files (raw 2011_09_26, object 000000..2, odometry 00, tracking 0000):
# rotations are orthonormal to 1e-7, both focal lengths are equal and there is no skew, right
# cameras are 0.53 to 0.54 m to the right of the left ones, P_rect and R, T differ by 0.3 mm,
# rectified cameras are parallel to 1.4e-7, the scanner is 0.3 m from camera 0 and faces the same
# way.

_ORTHONORMAL = 1e-5
_FOCAL_RATIO = 1.1
_BASELINES_M = (0.02, 3.0)
_SAME_POSITION_M = 0.005
_PARALLEL = 1e-3
_NEAR_M = 5.0
_FORWARD = 0.5
_NARROWEST, _WIDEST = 60.0, 120.0  # KITTI-360's see to 99 and 100 degrees
_CALIB_TIME = 'calib_time'


@dataclass(frozen=True, eq=False)
class CalibrationFile:
    """A parsed calibration.

    Attributes:
        calibration: The calibration.
        path: File, or the folder of several.
        cameras: The cameras with images.
    """

    calibration: Calibration
    path: Path
    cameras: Collection[int] = ()

    def breach(self, text: str, *keys: str) -> Breach:
        """Return a breach at the line of the first of keys, or the file of this name."""
        for key in keys:
            for file in self.calibration.files:
                path = self.path / PurePosixPath(file.name).name
                path = self.path if path.name == self.path.name else path
                if path.name == key:
                    return Breach(text, path)
                for line, words in enumerate(file.text.splitlines(), 1):
                    if words.replace(':', ' ').split()[:1] == [key]:
                        return Breach(text, path, line)
        return Breach(text, self.path)

    def projection_breach(self, text: str, camera: int) -> Breach:
        """Return a breach at the projection of a camera."""
        keys = (f'P{camera}', f'P_rect_{camera:02d}', f'image_{camera:02d}.yaml')
        return self.breach(text, *keys)


CALIBRATION_RULES = RuleTable[CalibrationFile](RuleScope.FILE)


_ROTATIONS = {
    'R0_rect': ('R0_rect', 'R_rect', 'R_rect_00'),
    'Tr_velo_to_cam': (
        *('Tr_velo_to_cam', 'Tr_velo_cam', 'Tr', names.CALIB_VELO_TO_CAM),
        names.KITTI_360_CALIB[2],
    ),
    'Tr_imu_to_velo': (
        *('Tr_imu_to_velo', 'Tr_imu_velo', names.CALIB_IMU_TO_VELO),
        names.KITTI_360_CALIB[1],
    ),
}
"""The keys and files of a rotation, of all layouts."""


@CALIBRATION_RULES.add(
    'calib-value',
    ERROR,
    'Calibrations are keys with finite numbers; R is a rotation to 1e-3, P invertible',
    'correct the line, or copy the file again',
)
def _find_invalid_calibration(file: CalibrationFile) -> Iterator[Breach]:
    for breach, absent in _missing(file):
        if not absent:
            yield breach


@CALIBRATION_RULES.add(
    'calib-missing',
    WARNING,
    'Calibration files and their usual keys exist',
    'without it there are no camera models, projections or 3D boxes of labels',
)
def _find_absent(file: CalibrationFile) -> Iterator[Breach]:
    for breach, absent in _missing(file):
        if absent:
            yield breach
    calib = file.calibration
    for camera in sorted(file.cameras):
        part = f'P{camera}'
        if calib.cameras and camera not in calib.cameras and part not in calib.missing:
            yield Breach(f'no {part}, and camera {camera} has images', file.path)


@CALIBRATION_RULES.add(
    'calib-placeholder',
    NOTE,
    'Calibration keys have values',
    'empty values and zeros count as absent: nothing to do for sensors that do not exist',
)
def _find_placeholders(file: CalibrationFile) -> Iterator[Breach]:
    for note in file.calibration.notes:
        if _CALIB_TIME not in note:
            yield breach_in(note, file.path)


@CALIBRATION_RULES.add(
    'calib-day',
    WARNING,
    'The calibration is of the day of the drive, by its calib_time (raw)',
    'give the calibration of the day in the name of the drive',
)
def _find_another_day(file: CalibrationFile) -> Iterator[Breach]:
    for note in file.calibration.notes:
        if _CALIB_TIME in note:
            yield breach_in(note, file.path)


def _missing(file: CalibrationFile) -> Iterator[tuple[Breach, bool]]:
    """Yield the missing parts, each with True if absent, False if invalid."""
    for reason in dict.fromkeys(file.calibration.missing.values()):
        breach = breach_in(reason, file.path)
        no_key = breach.line is None and breach.text.startswith('no ')
        yield breach, no_key


@CALIBRATION_RULES.add(
    'calib-rotation',
    WARNING,
    'R R^T is the identity to 1e-5',
    'write rotations with seven digits or more',
)
def _find_not_orthonormal(file: CalibrationFile) -> Iterator[Breach]:
    calib = file.calibration
    rotations: dict[str, Float64Array | None] = {
        'R0_rect': calib.r0_rect,
        'Tr_velo_to_cam': None if calib.cam0_T_velo is None else calib.cam0_T_velo.rotation,
        'Tr_imu_to_velo': calib.velo_T_imu.rotation,
    }
    for index, camera in calib.cameras.items():
        rotations[f'R_rect_{index:02d}'] = camera.r_rect
        if camera.cam_T_cam0 is not None:
            rotations[f'R_{index:02d}'] = camera.cam_T_cam0.rotation
    for name, rotation in rotations.items():
        if rotation is not None:
            error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
            if error > _ORTHONORMAL:
                text = f'{name}: R R^T differs from the identity by {error:.1g}'
                yield file.breach(text, name, *_ROTATIONS.get(name, ()))


@CALIBRATION_RULES.add(
    'calib-projection',
    ERROR,
    'P has positive, equal focal lengths (to 10 %) and the last row 0 0 1',
    'P is 3x4, row by row: check the order and the units',
)
def _find_projection(file: CalibrationFile) -> Iterator[Breach]:
    for index, camera in file.calibration.cameras.items():
        p = camera.p_rect
        name = f'P{index}'
        if p[0, 0] <= 0 or p[1, 1] <= 0:
            text = f'{name}: focal lengths {p[0, 0]:g} and {p[1, 1]:g}'
            yield file.projection_breach(text, index)
        elif not 1 / _FOCAL_RATIO < p[0, 0] / p[1, 1] < _FOCAL_RATIO:
            text = f'{name}: focal lengths {p[0, 0]:g} and {p[1, 1]:g} differ'
            yield file.projection_breach(text, index)
        if (p[2, :3] != (0, 0, 1)).any():
            row = ' '.join(f'{value:g}' for value in p[2])
            text = f'{name}: the last row is {row}; expected 0 0 1 and a number'
            yield file.projection_breach(text, index)
        if camera.k is not None and (camera.k[0, 0] <= 0 or camera.k[1, 1] <= 0):
            text = f'K_{index:02d}: focal lengths {camera.k[0, 0]:g} and {camera.k[1, 1]:g}'
            yield file.breach(text, f'K_{index:02d}')
        if camera.k is not None and (camera.k[2] != (0, 0, 1)).any():
            row = ' '.join(f'{value:g}' for value in camera.k[2])
            yield file.breach(f'K_{index:02d}: the last row is {row}', f'K_{index:02d}')


@CALIBRATION_RULES.add(
    'calib-baseline',
    WARNING,
    'Right cameras are 2 cm to 3 m to the right of the left ones, by P1 and P0, P3 and P2',
    'the fourth column of P is -fx times the place in metres: check sign and unit',
)
def _find_baseline(file: CalibrationFile) -> Iterator[Breach]:
    calib = file.calibration
    for right, left in LEFT_OF.items():
        if not {left, right} <= {*calib.cameras} & {*file.cameras} or calib.is_independent(right):
            continue
        # The fourth column is negative where the camera is to the right.
        centres = [rectified_offset(calib.cameras[index]) for index in (left, right)]
        x, y, z = (centres[0] - centres[1]).tolist()
        low, high = _BASELINES_M
        if not low < x < high or max(abs(y), abs(z)) > abs(x) / 2:
            text = f'camera {right} is {x:.3f} {y:.3f} {z:.3f} m right, below and before camera'
            yield file.projection_breach(f'{text} {left}', right)


@CALIBRATION_RULES.add(
    'calib-contradiction',
    WARNING,
    'P_rect agrees with R_rect, R and T (raw): places to 5 mm, rectified axes to 1 mrad',
    'give the three files of one calibration',
)
def _find_contradiction(file: CalibrationFile) -> Iterator[Breach]:
    cameras = {
        index: camera
        for index, camera in file.calibration.cameras.items()
        if camera.r_rect is not None and camera.cam_T_cam0 is not None
    }
    rotations: dict[int, Float64Array] = {}
    for index, camera in cameras.items():
        r_rect, cam_t_cam0 = camera.r_rect, camera.cam_T_cam0 or Transform.identity()
        if r_rect is None:
            continue
        rotations[index] = r_rect @ cam_t_cam0.rotation
        apart = float(np.abs(rectified_offset(camera) - r_rect @ cam_t_cam0.translation).max())
        if apart > _SAME_POSITION_M:
            text = f'P_rect_{index:02d} and R_rect, T put camera {index} {apart:.3f} m apart'
            yield file.projection_breach(text, index)
    for one, other in combinations(rotations, 2):
        angle = float(np.abs(rotations[one] @ rotations[other].T - np.eye(3)).max())
        if angle > _PARALLEL:
            text = f'R_rect and R of cameras {one} and {other} are not parallel, by {angle:.2g} rad'
            yield file.breach(text, f'R_rect_{other:02d}')


@CALIBRATION_RULES.add(
    'calib-scanner',
    WARNING,
    'Camera 0 looks along x of the scanner, less than 5 m away',
    'Tr_velo_to_cam maps the scanner to the camera: check that it is not the inverse',
)
def _find_scanner(file: CalibrationFile) -> Iterator[Breach]:
    cam0_t_velo = file.calibration.cam0_T_velo
    if cam0_t_velo is None or file.calibration.is_independent(0):
        return
    # Column 0 is the scanner's x axis, forward; camera z is forward, y is down.
    if cam0_t_velo.rotation[2, 0] < _FORWARD or cam0_t_velo.rotation[1, 2] > -_FORWARD:
        text = 'Tr_velo_to_cam: camera 0 does not look along x of the scanner with z up'
        yield file.breach(text, *_ROTATIONS['Tr_velo_to_cam'])
    distance = float(np.linalg.norm(cam0_t_velo.translation))
    if distance > _NEAR_M:
        text = f'Tr_velo_to_cam: the scanner is {distance:.1f} m from camera 0'
        yield file.breach(text, *_ROTATIONS['Tr_velo_to_cam'])


@CALIBRATION_RULES.add(
    'calib-mounts',
    WARNING,
    'The GPS/IMU faces as the scanner; fisheyes look to the left (2) and right (3) (KITTI-360)',
    'calib_cam_to_pose.txt maps cameras to the GPS/IMU: check its keys, and that none is inverted',
)
def _find_mounts(file: CalibrationFile) -> Iterator[Breach]:
    mounts = names.KITTI_360_CALIB[1]
    calib = file.calibration
    if calib.nominal or not any(text.name.endswith(mounts) for text in calib.files):
        return
    velo_t_imu = calib.velo_T_imu
    # The first column is the axis forward, the third the one up.
    if min(velo_t_imu.rotation[0, 0], velo_t_imu.rotation[2, 2]) < _FORWARD:
        yield file.breach('image_00: the GPS/IMU does not face as the scanner, z down', 'image_00')
    distance = float(np.linalg.norm(velo_t_imu.translation))
    if distance > _NEAR_M:
        yield file.breach(f'image_00: the GPS/IMU is {distance:.1f} m from the scanner', 'image_00')
    for index in names.KITTI_360_FISHEYES:
        camera, sign = calib.cameras.get(index), 1 if index % 2 == 0 else -1
        if camera is None or camera.cam_T_velo is None:
            continue
        # The third row is the optical axis in the scanner's frame, whose y is to the left.
        if sign * camera.cam_T_velo.rotation[2, 1] < _FORWARD:
            side, key = 'left' if sign > 0 else 'right', f'image_{index:02d}'
            yield file.breach(f'{key}: camera {index} does not look to the {side}', key)


@CALIBRATION_RULES.add(
    'calib-fisheye',
    WARNING,
    'Fisheyes see 60 to 120 degrees off their axis at the edges of the image (KITTI-360)',
    'give the file of this camera; scale it if images were resized',
)
def _find_fisheyes(file: CalibrationFile) -> Iterator[Breach]:
    for index, camera in file.calibration.cameras.items():
        if camera.lens is None or not camera.lens.is_wide or camera.size is None:
            continue
        (width, height), p = camera.size, camera.p_rect
        edges = np.array(
            [(0, height / 2), (width, height / 2), (width / 2, 0), (width / 2, height)]
        )
        rays = camera.lens.rays((edges - p[:2, 2]) / (p[0, 0], p[1, 1]))
        angles = np.degrees(np.arccos(rays[:, 2] / np.linalg.norm(rays, axis=1)))
        if not ((angles > _NARROWEST) & (angles < _WIDEST)).all():
            shown = ', '.join('no ray' if np.isnan(angle) else f'{angle:.0f}' for angle in angles)
            text = f'left, right, top and bottom edge are {shown} degrees off the axis'
            yield file.projection_breach(text, index)
