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

from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..model.errors import BadFileError
from ..model.geometry import Transform
from ..model.nominal import NOMINAL_VELO_T_IMU
from ..model.samples import Calibration, CameraCalibration, TextFile
from ..model.streams import CAMERA_COUNT
from . import names
from .calib_table import CalibTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..model.geometry import Float64Array

T = TypeVar('T')

_KITTI_CAMERAS = 4


class _Parts:
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


def parse_calibration(text: str, path: Path, name: str) -> Calibration:
    """Parse a calibration of a single file (object, tracking, odometry, Waymo).

    Args:
        text: The file's content.
        path: For the errors.
        name: The file's name relative to the recording's root.

    Raises:
        BadFileError: A line has no key, or the file is empty; an invalid number only makes its part
            missing.
    """
    table = CalibTable.parse(text, path)
    parts = _Parts()
    cameras = {}
    for index in range(CAMERA_COUNT):
        absent = f'{path}: no P{index}' if index < _KITTI_CAMERAS else ''
        camera = parts.read(f'P{index}', partial(_parse_camera, table, index), absent)
        if camera is not None:
            cameras[index] = camera
    velo_keys = ('Tr_velo_to_cam', 'Tr_velo_cam', 'Tr', 'Tr_velo_to_cam_0')
    imu_keys = ('Tr_imu_to_velo', 'Tr_imu_velo')
    extrinsics = partial(table.transform, *velo_keys)
    cam0_t_velo = parts.read('Tr_velo_to_cam', extrinsics, f'{path}: no Tr_velo_to_cam')
    r0_rect = parts.read('R0_rect', partial(table.rotation, 'R0_rect', 'R_rect'), '')
    velo_t_imu = parts.read('Tr_imu_to_velo', partial(table.transform, *imu_keys), '')
    own_rotation = 'Tr' in table.entries or 'Tr_velo_to_cam_0' in table.entries
    nominal = {'velo_T_imu': velo_t_imu, 'r0_rect': np.eye(3) if own_rotation else r0_rect}
    return Calibration(
        cameras,
        r0_rect=np.eye(3) if r0_rect is None else r0_rect,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu or NOMINAL_VELO_T_IMU,
        nominal=tuple(part for part, value in nominal.items() if value is None),
        missing={part: reason for part, reason in parts.missing.items() if reason},
        files=(TextFile(name, text),),
    )


def _parse_camera(table: CalibTable, index: int) -> CameraCalibration | None:
    p_rect = table.projection(f'P{index}')
    own = table.transform(f'Tr_velo_to_cam_{index}')
    return None if p_rect is None else CameraCalibration(p_rect, cam_T_velo=own)


class _RawParts(_Parts):
    """Reads parts of the three raw files, by file name."""

    def __init__(self, texts: Mapping[str, str], folder: Path, source: str) -> None:
        super().__init__()
        self._texts = texts
        self._folder = folder
        self._source = source

    def table(self, name: str) -> CalibTable:
        """Parse a file; an absent or invalid one has no keys."""
        path = self._folder / name
        absent = f'{path}: no such file; {self._source}'
        if name not in self._texts:
            self.missing[name] = absent
            return CalibTable(path, {})
        parsed = self.read(name, partial(CalibTable.parse, self._texts[name], path), absent)
        return parsed or CalibTable(path, {})

    def extrinsics(self, name: str) -> Transform | None:
        """Read the transform of a file."""
        read = partial(self.table(name).transform_parts, 'R', 'T')
        return self.read(name, read, self.missing.get(name, f'{self._folder / name}: no R and T'))


def parse_raw_calibration(
    texts: Mapping[str, str],
    folder: Path,
    *,
    rectified: bool,
    source: str = 'it comes with the calibration of the date',
) -> Calibration:
    """Parse the calibration of a raw date folder; absent or invalid parts are listed in missing.

    Args:
        texts: File name to content, for the files that exist.
        folder: Where they are, for the errors.
        rectified: False for extract drives.
        source: Where absent files can be had, for the errors.
    """
    parts = _RawParts(texts, folder, source)
    cam_to_cam = parts.table(names.CALIB_CAM_TO_CAM)
    cameras = {}
    for index in range(len(names.RAW_IMAGES)):
        read = partial(_parse_raw_camera, cam_to_cam, index, rectified=rectified)
        absent = parts.missing.get(
            names.CALIB_CAM_TO_CAM, f'{cam_to_cam.path}: no P_rect_{index:02d}'
        )
        camera = parts.read(f'P{index}', read, absent)
        if camera is not None:
            cameras[index] = camera
    velo_t_imu = parts.extrinsics(names.CALIB_IMU_TO_VELO)
    rotation = partial(cam_to_cam.rotation, 'R_rect_00')
    return Calibration(
        cameras,
        r0_rect=parts.read(
            'R0_rect',
            rotation,
            parts.missing.get(names.CALIB_CAM_TO_CAM, f'{cam_to_cam.path}: no R_rect_00'),
        ),
        cam0_T_velo=parts.extrinsics(names.CALIB_VELO_TO_CAM),
        velo_T_imu=velo_t_imu or NOMINAL_VELO_T_IMU,
        rectified=rectified,
        nominal=() if velo_t_imu else ('velo_T_imu',),
        missing=parts.missing,
        files=tuple(TextFile(name, text) for name, text in texts.items()),
    )


def _parse_raw_camera(
    table: CalibTable, index: int, *, rectified: bool
) -> CameraCalibration | None:
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
    """Format a tracking calib file, whose last three keys have no colon."""
    return _format_lines(calibration, ('R_rect', 'Tr_velo_cam', 'Tr_imu_velo'))


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
