# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360's calibration: rectified cameras 0 and 1, fisheyes 2 and 3 of the MEI model.

Files in calibration/ (KITTI-360's documentation and the authors' scripts):

- calib_cam_to_pose.txt: `image_00:` to `image_03:` and 12 numbers, the camera in the frame of the
  GPS/IMU, which is x forward, **y right, z down**. imu_link is y left, z up, as KITTI's.
- calib_cam_to_velo.txt: 12 numbers without a key, the *unrectified* camera 0 in velo_link.
- perspective.txt: keys as in calib_cam_to_cam.txt of raw drives; K_00 and K_01 end in 0, not 1.
- image_02.yaml, image_03.yaml: OpenCV's FileStorage, `%YAML:1.0` without `---`, which is no YAML.
- calib_sick_to_velo.txt: 12 numbers without a key, the line scanner in velo_link.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError
from ..model.geometry import NOMINAL_CAM_T_VELO_360, NOMINAL_VELO_T_IMU, Transform
from ..model.lenses import MeiLens
from ..model.samples import Calibration, CameraCalibration, TextFile, rectified_offset
from .calib_file import CalibTable, FolderParts, parse_raw_camera
from .names import KITTI_360_CALIB
from .names import KITTI_360_FISHEYES as FISHEYES

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.geometry import Float64Array

PERSPECTIVE, CAM_TO_POSE, CAM_TO_VELO = KITTI_360_CALIB[:3]
SICK_TO_VELO = KITTI_360_CALIB[-1]
RECTIFIED = (0, 1)

UPRIGHT = Transform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""KITTI-360's frame of the GPS/IMU (y right, z down) to imu_link (y left, z up), and back."""


def parse_kitti360_calibration(
    texts: Mapping[str, str], folder: Path, *, source: str = 'it comes with the calibration'
) -> Calibration:
    """Parse the files of a calibration; absent or invalid parts are listed in its missing.

    Args:
        texts: File name to content, for the files that exist.
        folder: Their folder, for the errors.
        source: Origin of absent files, for the errors.
    """
    files = _Files(texts, folder, source)
    perspective, cam_to_pose = files.table(PERSPECTIVE), files.table(CAM_TO_POSE)
    velo_t_cam0 = files.bare_transform(CAM_TO_VELO)
    velo_t_sick = files.bare_transform(SICK_TO_VELO) if SICK_TO_VELO in texts else None
    imu_t_cams = {}
    for index in (0, *FISHEYES):
        key = f'image_{index:02d}'
        # Neither a mount nor a model: there is no such camera.
        is_there = index not in FISHEYES or FISHEYES[index] in texts
        absent = files.missing.get(CAM_TO_POSE, cam_to_pose.absence(key)) if is_there else ''
        read_pose = partial(cam_to_pose.transform, key)
        # P2 is missing where camera 2 has images only, as on KITTI's rig.
        imu_t_cams[index] = files.read(f'P{index}' if index else key, read_pose, absent)
    cameras: dict[int, CameraCalibration] = {}
    for index in RECTIFIED:
        read = partial(_parse_rectified, perspective, index)
        absent = files.missing.get(PERSPECTIVE, perspective.absence(f'P_rect_{index:02d}'))
        camera = files.read(f'P{index}', read, absent)
        if camera is not None:
            cameras[index] = camera
    imu_t_cam0 = imu_t_cams[0]
    mounts = {}
    for index in filter(FISHEYES.get, imu_t_cams):
        imu_t_cam = imu_t_cams[index]
        if imu_t_cam and not (imu_t_cam0 and velo_t_cam0):
            files.missing[f'P{index}'] = files.missing.get(CAM_TO_VELO) or files.missing['image_00']
        elif imu_t_cam and imu_t_cam0 and velo_t_cam0:
            cam_t_velo = imu_t_cam.inverse() @ imu_t_cam0 @ velo_t_cam0.inverse()
            camera = files.read(f'P{index}', partial(files.fisheye, index, cam_t_velo), '')
            if camera is None:
                mounts[index] = cam_t_velo
            else:
                cameras[index] = camera
    velo_t_imu = (
        velo_t_cam0 @ imu_t_cam0.inverse() @ UPRIGHT if velo_t_cam0 and imu_t_cam0 else None
    )
    no_rotation = files.missing.get(PERSPECTIVE, perspective.absence('R_rect_00'))
    r0_rect = files.read('R0_rect', partial(perspective.rotation, 'R_rect_00'), no_rotation)
    return Calibration(
        cameras,
        r0_rect=r0_rect,
        cam0_T_velo=velo_t_cam0.inverse() if velo_t_cam0 else None,
        velo_T_imu=velo_t_imu or NOMINAL_VELO_T_IMU,
        nominal=() if velo_t_imu else ('velo_T_imu',),
        missing={part: reason for part, reason in files.missing.items() if reason},
        files=tuple(TextFile(name, text) for name, text in texts.items()),
        velo_T_sick=velo_t_sick,
        mounts=mounts,
        nominal_mounts=NOMINAL_CAM_T_VELO_360,
    )


def _parse_rectified(table: CalibTable, index: int) -> CameraCalibration | None:
    key = f'K_{index:02d}'
    line, value = table.entries.get(key, (0, ''))
    words = value.split()
    if words and words[-1].strip('0.') == '':  # as in the data set
        table = CalibTable(table.path, {**table.entries, key: (line, ' '.join([*words[:-1], '1']))})
    return parse_raw_camera(table, index, rectified=True)


class _Files(FolderParts):
    """Reads the parts of the files of a calibration."""

    def bare_transform(self, name: str) -> Transform | None:
        """Parse a file of the 12 numbers of a transform alone."""
        path = self._folder / name
        if not self._is_there(name):
            return None
        table = CalibTable(path, {'the transform': (1, self._texts[name])})
        return self.read(name, partial(table.transform, 'the transform'), '')

    def fisheye(self, index: int, cam_t_velo: Transform) -> CameraCalibration | None:
        """Parse the file of a fisheye.

        Raises:
            BadFileError: It is absent or invalid, or of another model.
        """
        path = self._folder / FISHEYES[index]
        text = self._texts.get(path.name)
        if text is None:
            raise BadFileError(path, 'no such file', 'a model of the fisheye', remedy=self._source)
        values = _parse_storage(text, path)
        line, model = values.entries.get('model_type', (None, 'missing'))
        if model != 'MEI':
            raise BadFileError(path, f'model_type is {model}', 'MEI', line=line)
        gamma1, gamma2, u0, v0 = (_number(values, key) for key in ('gamma1', 'gamma2', 'u0', 'v0'))
        xi, *d = (_number(values, key) for key in ('xi', 'k1', 'k2', 'p1', 'p2'))
        if not (xi > 0 and gamma1 > 0 and gamma2 > 0):
            raise BadFileError(path, f'xi {xi:g}, gamma {gamma1:g} {gamma2:g}', 'positive numbers')
        width, height = (_number(values, f'image_{side}') for side in ('width', 'height'))
        if not (min(width, height) >= 1 and width.is_integer() and height.is_integer()):
            raise BadFileError(path, f'images of {width:g}x{height:g}', 'whole pixels')
        line, name = values.entries.get('camera_name', (None, path.stem))
        if name != path.stem:
            raise BadFileError(path, f'camera_name is {name}', path.stem, line=line)
        return CameraCalibration(
            np.array([[gamma1, 0, u0, 0], [0, gamma2, v0, 0], [0, 0, 1, 0]]),
            size=(int(width), int(height)),
            cam_T_velo=cam_t_velo,
            lens=MeiLens(xi, np.array(d)),
        )


def _parse_storage(text: str, path: Path) -> CalibTable:
    """Parse the keys of OpenCV's FileStorage, whatever their level.

    Raises:
        BadFileError: A line has no key.
    """
    entries = {}
    for number, line in enumerate(text.splitlines(), 1):
        key, colon, value = line.partition(':')
        if line.strip() and not line.startswith(('%', '---', '#')):
            if not colon:
                raise BadFileError(path, f'{line[:40]!r}', 'a line like "xi: 2.2"', line=number)
            entries[key.strip()] = (number, value.strip())
    return CalibTable(path, entries)


def _number(table: CalibTable, key: str) -> float:
    values = table.numbers(1, key)
    if values is None:
        raise BadFileError(table.path, f'no {key}', 'the keys of a MEI model')
    return float(values[0])


# The files of a calibration, as in the data set: the numbers with more digits.


def format_kitti360_calibration(calibration: Calibration) -> dict[str, str]:
    """Format the files of a calibration: file name to text; the inverse of the parser.

    Raises:
        ValueError: The calibration has no camera 0 or no cam0_T_velo.
    """
    if 0 not in calibration.cameras or calibration.cam0_T_velo is None:
        raise ValueError('a calibration of KITTI-360 needs camera 0 and cam0_T_velo')
    r0_rect = np.eye(3) if calibration.r0_rect is None else calibration.r0_rect
    velo_t_cam0 = calibration.cam0_T_velo.inverse()
    imu_t_velo = UPRIGHT @ calibration.velo_T_imu.inverse()
    to_pose, perspective, files = [], [], {}
    for index, camera in sorted(calibration.cameras.items()):
        if index in RECTIFIED:
            cam_t_cam0, r_rect = _unrectified(camera, r0_rect)
            imu_t_cam = imu_t_velo @ velo_t_cam0 @ cam_t_cam0.inverse()
            perspective += _format_perspective(index, camera, cam_t_cam0, r_rect)
        elif isinstance(camera.lens, MeiLens) and camera.cam_T_velo is not None:
            imu_t_cam = imu_t_velo @ camera.cam_T_velo.inverse()
            files[FISHEYES[index]] = _format_fisheye(index, camera, camera.lens)
        else:
            continue
        to_pose.append(f'image_{index:02d}: {_numbers(imu_t_cam.matrix()[:3])} \n')
    if calibration.velo_T_sick is not None:
        files[SICK_TO_VELO] = f'{_numbers(calibration.velo_T_sick.matrix()[:3])}\n'
    return {
        CAM_TO_POSE: ''.join(to_pose),
        CAM_TO_VELO: f'{_numbers(velo_t_cam0.matrix()[:3])}\n',
        PERSPECTIVE: ''.join(perspective),
        **files,
    }


def _unrectified(
    camera: CameraCalibration, r0_rect: Float64Array
) -> tuple[Transform, Float64Array]:
    """Return cam_T_cam0 and R_rect of a rectified camera; parallel to camera 0 if unknown."""
    if camera.cam_T_cam0 is not None and camera.r_rect is not None:
        return camera.cam_T_cam0, camera.r_rect
    return Transform(np.eye(3), r0_rect.T @ rectified_offset(camera)), r0_rect


def _format_perspective(
    index: int, camera: CameraCalibration, cam_t_cam0: Transform, r_rect: Float64Array
) -> list[str]:
    size = np.array(camera.size or (0, 0), np.float64)
    k = np.array(camera.p_rect[:, :3] if camera.k is None else camera.k)
    k[2, 2] = 0.0  # as in the data set
    values = {
        'S': size,
        'K': k,
        'D': np.zeros(5) if camera.d is None else camera.d,
        'R': cam_t_cam0.rotation,
        'T': cam_t_cam0.translation,
        'S_rect': size,
        'R_rect': r_rect,
        'P_rect': camera.p_rect,
    }
    return [f'{key}_{index:02d}: {_numbers(value)}\n' for key, value in values.items()]


def _format_fisheye(index: int, camera: CameraCalibration, lens: MeiLens) -> str:
    width, height = camera.size or (0, 0)
    k1, k2, p1, p2 = lens.d.tolist()
    (gamma1, _, u0, _), (_, gamma2, v0, _) = camera.p_rect[:2].tolist()
    head = f'model_type: MEI\ncamera_name: image_{index:02d}\n'
    parts: dict[str, dict[str, float]] = {
        'mirror': {'xi': lens.xi},
        'distortion': {'k1': k1, 'k2': k2, 'p1': p1, 'p2': p2},
        'projection': {'gamma1': gamma1, 'gamma2': gamma2, 'u0': u0, 'v0': v0},
    }
    text = f'%YAML:1.0\n{head}image_width: {width}\nimage_height: {height}\n'
    for part, values in parts.items():
        text += f'{part}_parameters:\n'
        text += ''.join(f'   {key}: {value:.16e}\n' for key, value in values.items())
    return text


def _numbers(values: Float64Array) -> str:
    return ' '.join(f'{value:.12g}' for value in values.ravel())
