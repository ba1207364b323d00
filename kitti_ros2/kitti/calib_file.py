# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration files in all of KITTI's dialects, to and from samples.Calibration.

- object, tracking, and other data sets in the same format: P0..P3, R0_rect (tracking
  R_rect), Tr_velo_to_cam (Tr_velo_cam), Tr_imu_to_velo (Tr_imu_velo).
- odometry: P0..P3 and Tr, velo_link to the *rectified* camera 0.
- Waymo in KITTI's format: P0..P4 and Tr_velo_to_cam_0..4, independent cameras.
- raw: calib_cam_to_cam, calib_velo_to_cam, calib_imu_to_velo, with the unrectified cameras too.

Sources: readme.txt of the four devkits; mmdetection3d's Waymo converter for the Waymo keys.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..kitti import archives as calib_archives
from ..kitti import names
from ..model.errors import BadFileError, format_count
from ..model.geometry import NOMINAL_VELO_T_IMU, Transform
from ..model.samples import Calibration, CameraCalibration, TextFile
from ..model.streams import CAMERA_COUNT
from .text_file import parse_numbers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..model.geometry import Float64Array


# The common format of KITTI's calibration files: lines of a key, then numbers or words.
#
# ``P0: 7.2e+02 ...``, in tracking partly without the colon (``R_rect 9.9e-01 ...``). Some values
# are words (``calib_time: 09-Jan-2012 13:57:47``); numbers are only parsed on request.
#
# Exporters of other data sets write placeholders for absent sensors: an empty value (View
# of Delft's Tr_imu_to_velo) or a matrix of zeros (P0, P1, P3 of nuScenes' export_kitti.py). Their
# keys count as absent.

_MATRIX_SIZES = frozenset({0, 1, 9, 12})
"""Numbers of zeros that make a placeholder; vectors (T, D, S of 3, 5 and 2 numbers) may be zero."""

_LINE = re.compile(r'(?P<key>[A-Za-z]\w*)(?::|\s)\s*(?P<value>.*)')


@dataclass(frozen=True)
class CalibTable:
    """The keys of one calibration file, with their line numbers.

    Attributes:
        path: The file.
        entries: Key to line number and value.
        placeholders: Keys without a value, with their line numbers; not among the entries.
    """

    path: Path
    entries: Mapping[str, tuple[int, str]]
    placeholders: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str, path: Path) -> CalibTable:
        """Split a file's text by key.

        Raises:
            BadFileError: A line has no key, or the file has no line.
        """
        entries: dict[str, tuple[int, str]] = {}
        placeholders: dict[str, int] = {}
        for number, line in enumerate(text.splitlines(), 1):
            if not line.strip():
                continue
            match = _LINE.fullmatch(line.strip())
            if match is None:
                raise BadFileError(
                    path, f'{line[:40]!r}', 'a line like "P0: 7.2e+02 ..."', line=number
                )
            if _is_placeholder(match['value'].split()):
                placeholders[match['key']] = number
            else:
                entries[match['key']] = (number, match['value'])
        if not entries and not placeholders:
            raise BadFileError(path, 'the file is empty', 'calibration lines such as "P0: ..."')
        return cls(path, entries, placeholders)

    def absence(self, *keys: str) -> str:
        """Return the reason why none of keys has a value, with the line of a placeholder."""
        for key in keys:
            if key in self.placeholders:
                line = self.placeholders[key]
                return f'{self.path}: no {key} (line {line} is empty or zeros)'
        return f'{self.path}: no {keys[0]}'

    def numbers(self, count: int, *keys: str) -> Float64Array | None:
        """Return the numbers of the first of keys that exists, None without any.

        Raises:
            BadFileError: Their count is not count, or one is no finite number.
        """
        for key in keys:
            if key in self.entries:
                line, value = self.entries[key]
                try:
                    return np.array(parse_numbers(value.split(), count))
                except ValueError as error:
                    raise BadFileError(
                        self.path, f'{key}: {error}', format_count(count, 'number'), line=line
                    ) from None
        return None

    def projection(self, *keys: str) -> Float64Array | None:
        """Return a (3, 4) projection whose left (3, 3) is invertible, None without the key.

        Raises:
            BadFileError: As numbers, or the matrix is singular.
        """
        values = self.numbers(12, *keys)
        if values is None:
            return None
        matrix = values.reshape(3, 4)
        if abs(np.linalg.det(matrix[:, :3])) < 1e-9:
            line = next(self.entries[key][0] for key in keys if key in self.entries)
            raise BadFileError(
                self.path, f'{keys[0]} is singular', 'a projection matrix', line=line
            )
        return matrix

    def rotation(self, *keys: str) -> Float64Array | None:
        """Return a (3, 3) rotation, None without the key.

        Raises:
            BadFileError: As numbers, or the matrix is no rotation to 1e-3.
        """
        values = self.numbers(9, *keys)
        return None if values is None else self._checked_rotation(values.reshape(3, 3), keys)

    def transform(self, *keys: str) -> Transform | None:
        """Return the transform of a (3, 4) matrix [R | t], None without the key.

        Raises:
            BadFileError: As numbers, or R is no rotation to 1e-3.
        """
        values = self.numbers(12, *keys)
        if values is None:
            return None
        matrix = values.reshape(3, 4)
        return Transform(self._checked_rotation(matrix[:, :3].copy(), keys), matrix[:, 3].copy())

    def transform_parts(self, rotation_key: str, translation_key: str) -> Transform | None:
        """Return the transform of a rotation and a translation under two keys."""
        rotation = self.rotation(rotation_key)
        translation = self.numbers(3, translation_key)
        if rotation is None or translation is None:
            return None
        return Transform(rotation, translation)

    def _checked_rotation(self, matrix: Float64Array, keys: tuple[str, ...]) -> Float64Array:
        with np.errstate(over='ignore', invalid='ignore'):  # no rotation where the result is NaN
            error = np.abs(matrix @ matrix.T - np.eye(3)).max()
        if not error <= 1e-3 or np.linalg.det(matrix) < 0:
            key, line = next((key, self.entries[key][0]) for key in keys if key in self.entries)
            raise BadFileError(
                self.path, f'{key} holds no rotation', 'an orthonormal matrix', line=line
            )
        return matrix


def _is_placeholder(words: list[str]) -> bool:
    """Return whether a value is empty, or a matrix of zeros or NaN."""
    if len(words) not in _MATRIX_SIZES:
        return False
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return False
    return all(number == 0 or math.isnan(number) for number in numbers)


T = TypeVar('T')

_KITTI_CAMERAS = 4


class CalibParts:
    """Reads parts of calibration tables; an invalid or absent part is recorded, not fatal."""

    def __init__(self) -> None:
        self.missing: dict[str, str] = {}

    def read(self, part: str, parse: Callable[[], T | None], absent: str) -> T | None:
        """Return the result of parse; on a bad file or None the reason goes to missing."""
        try:
            value = parse()
        except BadFileError as error:
            self.missing[part] = str(error)
            return None
        if value is None:
            self.missing[part] = absent
        return value


def parse_calibration(text: str, path: Path, name: str, source: str = '') -> Calibration:
    """Parse a calibration of a single file (object, tracking, odometry, Waymo).

    Args:
        text: The file's content.
        path: For the errors.
        name: The file's name relative to the recording's root.
        source: Origin of a calibration with the scanner, for the errors.

    Raises:
        BadFileError: A line has no key, or the file is empty; an invalid number only makes its part
            missing.
    """
    table = CalibTable.parse(text, path)
    parts = CalibParts()
    cameras = {}
    for index in range(CAMERA_COUNT):
        key = f'P{index}'
        usual = index < _KITTI_CAMERAS and key not in table.placeholders
        absent = table.absence(key) if usual else ''  # a placeholder: there is no such camera
        camera = parts.read(f'P{index}', partial(_parse_camera, table, index), absent)
        if camera is not None:
            cameras[index] = camera
    odometry = 'Tr' in table.entries or path.name == names.ODOMETRY_CALIB
    velo_keys = _velo_keys(table, odometry=odometry)
    imu_keys = ('Tr_imu_to_velo', 'Tr_imu_velo')
    extrinsics = partial(table.transform, *velo_keys)
    absent = table.absence(*velo_keys) + (f'; {source}' if source else '')
    cam0_t_velo = parts.read('Tr_velo_to_cam', extrinsics, absent)
    r0_rect = parts.read('R0_rect', partial(table.rotation, 'R0_rect', 'R_rect'), '')
    velo_t_imu = parts.read('Tr_imu_to_velo', partial(table.transform, *imu_keys), '')
    own_rotation = odometry or 'Tr_velo_to_cam_0' in table.entries
    nominal = {'velo_T_imu': velo_t_imu, 'r0_rect': np.eye(3) if own_rotation else r0_rect}
    return Calibration(
        cameras,
        r0_rect=np.eye(3) if r0_rect is None else r0_rect,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu or NOMINAL_VELO_T_IMU,
        nominal=tuple(part for part, value in nominal.items() if value is None),
        missing={part: reason for part, reason in parts.missing.items() if reason},
        files=(TextFile(name, text),),
        notes=_on_placeholders(table),
    )


def _velo_keys(table: CalibTable, *, odometry: bool) -> list[str]:
    """Return the keys of the scanner's pose, the one of the file's own layout first."""
    keys = ['Tr_velo_to_cam', 'Tr_velo_cam', 'Tr', 'Tr_velo_to_cam_0']
    tracking = 'R_rect' in table.entries
    own = 'Tr' if odometry else 'Tr_velo_cam' if tracking else keys[0]
    return sorted(keys, key=lambda key: key != own)


def _on_placeholders(*tables: CalibTable) -> tuple[str, ...]:
    keys = [key for table in tables for key in table.placeholders]
    text = f'{", ".join(keys)}: empty or zeros in the calibration, taken as absent'
    return (text,) if keys else ()


def _parse_camera(table: CalibTable, index: int) -> CameraCalibration | None:
    p_rect = table.projection(f'P{index}')
    own = table.transform(f'Tr_velo_to_cam_{index}')
    return None if p_rect is None else CameraCalibration(p_rect, cam_T_velo=own)


class FolderParts(CalibParts):
    """Reads parts of a calibration of several files, by file name."""

    def __init__(self, texts: Mapping[str, str], folder: Path, source: str) -> None:
        super().__init__()
        self._texts = texts
        self._folder = folder
        self._source = source
        self.tables: list[CalibTable] = []

    def table(self, name: str) -> CalibTable:
        """Parse a file; an absent or invalid one has no keys."""
        path = self._folder / name
        table = None
        if self._is_there(name):
            table = self.read(name, partial(CalibTable.parse, self._texts[name], path), '')
        self.tables.append(table or CalibTable(path, {}))
        return self.tables[-1]

    def _is_there(self, name: str) -> bool:
        """Return whether a file is; an absent one is recorded."""
        if name not in self._texts:
            self.missing[name] = f'{self._folder / name}: no such file; {self._source}'
        return name in self._texts


class _RawParts(FolderParts):
    """Reads parts of the three raw files."""

    def extrinsics(self, name: str, *, optional: bool = False) -> Transform | None:
        """Read the transform of a file; an optional one may be a placeholder."""
        table = self.table(name)
        absent = f'{table.path}: no R and T'
        if table.placeholders:
            absent = '' if optional else table.absence('R', 'T')
        read = partial(table.transform_parts, 'R', 'T')
        return self.read(name, read, self.missing.get(name, absent))


def parse_raw_calibration(
    texts: Mapping[str, str],
    folder: Path,
    *,
    rectified: bool,
    source: str = 'it comes with the calibration of the date',
    day: str = '',
) -> Calibration:
    """Parse the calibration of a raw date folder; absent or invalid parts are listed in missing.

    Args:
        texts: File name to content, for the files that exist.
        folder: Their folder, for the errors.
        rectified: False for extract drives.
        source: Origin of absent files, for the errors.
        day: The drive's, such as 2011_10_03; a note says if KITTI's calibration is of another.
    """
    parts = _RawParts(texts, folder, source)
    cam_to_cam = parts.table(names.CALIB_CAM_TO_CAM)
    cameras = {}
    for index in range(len(names.RAW_IMAGES)):
        read = partial(parse_raw_camera, cam_to_cam, index, rectified=rectified)
        key = f'P_rect_{index:02d}'
        absent = parts.missing.get(names.CALIB_CAM_TO_CAM, cam_to_cam.absence(key))
        absent = '' if key in cam_to_cam.placeholders else absent
        camera = parts.read(f'P{index}', read, absent)
        if camera is not None:
            cameras[index] = camera
    velo_t_imu = parts.extrinsics(names.CALIB_IMU_TO_VELO, optional=True)
    no_rotation = parts.missing.get(names.CALIB_CAM_TO_CAM, cam_to_cam.absence('R_rect_00'))
    r0_rect = parts.read('R0_rect', partial(cam_to_cam.rotation, 'R_rect_00'), no_rotation)
    cam0_t_velo = parts.extrinsics(names.CALIB_VELO_TO_CAM)
    return Calibration(
        cameras,
        r0_rect=r0_rect,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu or NOMINAL_VELO_T_IMU,
        rectified=rectified,
        nominal=() if velo_t_imu else ('velo_T_imu',),
        missing={part: reason for part, reason in parts.missing.items() if reason},
        files=tuple(TextFile(name, text) for name, text in texts.items()),
        notes=(*_on_placeholders(*parts.tables), *_on_another_day(cam_to_cam, day)),
    )


def _on_another_day(cam_to_cam: CalibTable, day: str) -> tuple[str, ...]:
    """Return a note if a file of KITTI's is of another day than the drive."""
    _, time = cam_to_cam.entries.get('calib_time', (0, ''))
    archive_day = calib_archives.CALIB_TIMES.get(time)
    if not day or archive_day is None or archive_day == day:
        return ()
    which = f"KITTI's calibration of {archive_day} (calib_time: {time})"
    return (f'{cam_to_cam.path}: {which}, the drive is of {day}',)


def parse_raw_camera(table: CalibTable, index: int, *, rectified: bool) -> CameraCalibration | None:
    """Parse a camera of calib_cam_to_cam.txt, None without a projection.

    Raises:
        BadFileError: A value is invalid, or one that images as measured need is absent.
    """
    p_rect = table.projection(f'P_rect_{index:02d}')
    if p_rect is None:
        return None
    size = table.numbers(2, f'S_rect_{index:02d}' if rectified else f'S_{index:02d}')
    k = table.numbers(9, f'K_{index:02d}')
    camera = CameraCalibration(
        p_rect,
        size=(int(size[0]), int(size[1])) if size is not None and size.all() else None,
        k=None if k is None else k.reshape(3, 3),
        d=table.numbers(5, f'D_{index:02d}'),
        r_rect=table.rotation(f'R_rect_{index:02d}'),
        cam_T_cam0=table.transform_parts(f'R_{index:02d}', f'T_{index:02d}'),
    )
    parts = {'K': k, 'D': camera.d, 'R_rect': camera.r_rect, 'R, T': camera.cam_T_cam0}
    missing = [name for name, part in parts.items() if part is None]
    if missing and not rectified:
        raise BadFileError(
            table.path, f'no {" and ".join(missing)} of camera {index:02d}', 'an unrectified camera'
        )
    return camera


def format_object(calibration: Calibration) -> str:
    """Format an object calib file: its seven lines in KITTI's order, then an empty one.

    Loaders read by line number, so an absent camera gets the projection of camera 0.

    Raises:
        ValueError: The calibration has no camera or no cam0_T_velo.
    """
    return _format_lines(calibration, ('R0_rect:', 'Tr_velo_to_cam:', 'Tr_imu_to_velo:')) + '\n'


def format_tracking(calibration: Calibration) -> str:
    """Format a tracking calib file: the last three keys have no colon, lines end in two blanks."""
    lines = _format_lines(calibration, ('R_rect', 'Tr_velo_cam', 'Tr_imu_velo'))
    return lines.replace('\n', '  \n')


def format_odometry(calibration: Calibration) -> str:
    """Format an odometry calib.txt: P0..P3 and Tr, velo_link to the rectified camera 0."""
    r0_rect, cam0_t_velo, _ = _extrinsics(calibration)
    tr = Transform(r0_rect, np.zeros(3)) @ cam0_t_velo
    return _format_projections(calibration) + f'Tr: {_numbers(tr.matrix()[:3])}\n'


def format_raw(calibration: Calibration) -> dict[str, str]:
    """Format the three raw calibration files: file name to text.

    Loaders read all four cameras, so an absent one gets the numbers of the first.

    Raises:
        ValueError: The calibration has no camera or no cam0_T_velo.
    """
    r0_rect, cam0_t_velo, velo_t_imu = _extrinsics(calibration)
    lines = []
    for index, camera in enumerate(_four_cameras(calibration)):
        size = camera.size or (0, 0)
        cam_t_cam0 = camera.cam_T_cam0 or Transform.identity()
        values = {
            'S': np.array(size, dtype=np.float64),
            'K': camera.p_rect[:, :3] if camera.k is None else camera.k,
            'D': np.zeros(5) if camera.d is None else camera.d,
            'R': cam_t_cam0.rotation,
            'T': cam_t_cam0.translation,
            'S_rect': np.array(size, dtype=np.float64),
            'R_rect': r0_rect if camera.r_rect is None else camera.r_rect,
            'P_rect': camera.p_rect,
        }
        lines += [f'{key}_{index:02d}: {_numbers(value, 6)}\n' for key, value in values.items()]
    return {
        names.CALIB_CAM_TO_CAM: ''.join(lines),
        names.CALIB_VELO_TO_CAM: _format_parts(cam0_t_velo),
        names.CALIB_IMU_TO_VELO: _format_parts(velo_t_imu),
    }


def _format_lines(calibration: Calibration, keys: tuple[str, str, str]) -> str:
    r0_rect, cam0_t_velo, velo_t_imu = _extrinsics(calibration)
    rows = (r0_rect, cam0_t_velo.matrix()[:3], velo_t_imu.matrix()[:3])
    return _format_projections(calibration) + ''.join(
        f'{key} {_numbers(row)}\n' for key, row in zip(keys, rows, strict=True)
    )


def _format_projections(calibration: Calibration) -> str:
    cameras = _four_cameras(calibration)
    return ''.join(f'P{i}: {_numbers(camera.p_rect)}\n' for i, camera in enumerate(cameras))


def _four_cameras(calibration: Calibration) -> list[CameraCalibration]:
    """Return KITTI's four cameras, with the first one in place of absent ones."""
    if not calibration.cameras:
        raise ValueError('a calibration file needs at least one camera')
    first = calibration.cameras[min(calibration.cameras)]
    return [calibration.cameras.get(index, first) for index in range(_KITTI_CAMERAS)]


def _format_parts(transform: Transform) -> str:
    return f'R: {_numbers(transform.rotation, 6)}\nT: {_numbers(transform.translation, 6)}\n'


def _extrinsics(calibration: Calibration) -> tuple[Float64Array, Transform, Transform]:
    if calibration.cam0_T_velo is None:
        raise ValueError('a calibration file needs cam0_T_velo')
    r0_rect = np.eye(3) if calibration.r0_rect is None else calibration.r0_rect
    return r0_rect, calibration.cam0_T_velo, calibration.velo_T_imu


def _numbers(values: Float64Array, digits: int = 12) -> str:
    return ' '.join(f'{value:.{digits}e}' for value in values.ravel())
