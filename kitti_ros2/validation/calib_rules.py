# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a calibration.

Limits, from KITTI's files (raw 2011_09_26, object 000000..2, odometry 00, tracking 0000): rotations
are orthonormal to 1e-7, both focal lengths are equal and there is no skew, right cameras are 0.53
to 0.54 m to the right of the left ones, P_rect and R, T differ by 0.3 mm, rectified cameras are
parallel to 1.4e-7, the scanner is 0.3 m from camera 0 and looks where it looks.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..model.cameras import LEFT_OF, rectified_offset
from ..model.geometry import Transform
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_in

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import Calibration

_ORTHONORMAL = 1e-5
_FOCAL_RATIO = 1.1
_BASELINES_M = (0.02, 3.0)
_SAME_PLACE_M = 0.005
_PARALLEL = 1e-3
_NEAR_M = 5.0
_FORWARD = 0.5
_CALIB_TIME = 'calib_time'


@dataclass(frozen=True, eq=False)
class CalibrationFile:
    """A parsed calibration.

    Attributes:
        calibration: The calibration.
        path: Its file, or the folder of several.
        cameras: The cameras that have images.
    """

    calibration: Calibration
    path: Path
    cameras: Collection[int] = ()


def _find_invalid_calibration(file: CalibrationFile) -> Iterator[Breach]:
    for breach, absent in _missing(file):
        if not absent:
            yield breach


def _find_absent(file: CalibrationFile) -> Iterator[Breach]:
    for breach, absent in _missing(file):
        if absent:
            yield breach
    found = file.calibration
    for camera in sorted(file.cameras):
        part = f'P{camera}'
        if found.cameras and camera not in found.cameras and part not in found.missing:
            yield Breach(f'no {part}, and camera {camera} has images', file.path)


def _find_placeholders(file: CalibrationFile) -> Iterator[Breach]:
    for note in file.calibration.notes:
        if _CALIB_TIME not in note:
            yield breach_in(note, file.path)


def _find_another_day(file: CalibrationFile) -> Iterator[Breach]:
    for note in file.calibration.notes:
        if _CALIB_TIME in note:
            yield breach_in(note, file.path)


def _missing(file: CalibrationFile) -> Iterator[tuple[Breach, bool]]:
    """Yield the missing parts, and whether they are absent instead of invalid."""
    for reason in dict.fromkeys(file.calibration.missing.values()):
        breach = breach_in(reason, file.path)
        no_key = breach.line is None and breach.text.startswith('no ')
        yield breach, no_key


def _find_not_orthonormal(file: CalibrationFile) -> Iterator[Breach]:
    found = file.calibration
    rotations: dict[str, Float64Array | None] = {
        'R0_rect': found.r0_rect,
        'Tr_velo_to_cam': None if found.cam0_T_velo is None else found.cam0_T_velo.rotation,
        'Tr_imu_to_velo': found.velo_T_imu.rotation,
    }
    for index, camera in found.cameras.items():
        rotations[f'R_rect_{index:02d}'] = camera.r_rect
        if camera.cam_T_cam0 is not None:
            rotations[f'R_{index:02d}'] = camera.cam_T_cam0.rotation
    for name, rotation in rotations.items():
        if rotation is not None:
            off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
            if off > _ORTHONORMAL:
                yield Breach(f'{name}: R R^T differs from the identity by {off:.1g}', file.path)


def _find_projection(file: CalibrationFile) -> Iterator[Breach]:
    for index, camera in file.calibration.cameras.items():
        p = camera.p_rect
        name = f'P{index}'
        if p[0, 0] <= 0 or p[1, 1] <= 0:
            yield Breach(f'{name}: focal lengths {p[0, 0]:g} and {p[1, 1]:g}', file.path)
        elif not 1 / _FOCAL_RATIO < p[0, 0] / p[1, 1] < _FOCAL_RATIO:
            yield Breach(f'{name}: focal lengths {p[0, 0]:g} and {p[1, 1]:g} differ', file.path)
        if (p[2, :3] != (0, 0, 1)).any():
            row = ' '.join(f'{value:g}' for value in p[2])
            yield Breach(f'{name}: the last row is {row}; expected 0 0 1 and a number', file.path)
        if camera.k is not None and (camera.k[0, 0] <= 0 or camera.k[1, 1] <= 0):
            text = f'K_{index:02d}: focal lengths {camera.k[0, 0]:g} and {camera.k[1, 1]:g}'
            yield Breach(text, file.path)


def _find_baseline(file: CalibrationFile) -> Iterator[Breach]:
    found = file.calibration
    for right, left in LEFT_OF.items():
        if not {left, right} <= {*found.cameras} & {*file.cameras} or found.independent_cameras:
            continue
        # The fourth column is negative where the camera is to the right.
        centres = [rectified_offset(found.cameras[index]) for index in (left, right)]
        x, y, z = (centres[0] - centres[1]).tolist()
        low, high = _BASELINES_M
        if not low < x < high or max(abs(y), abs(z)) > abs(x) / 2:
            text = f'camera {right} is {x:.3f} {y:.3f} {z:.3f} m right, below and before camera'
            yield Breach(f'{text} {left}', file.path)


def _find_contradiction(file: CalibrationFile) -> Iterator[Breach]:
    cameras = {
        index: camera
        for index, camera in file.calibration.cameras.items()
        if camera.r_rect is not None and camera.cam_T_cam0 is not None
    }
    turned: dict[int, Float64Array] = {}
    for index, camera in cameras.items():
        r_rect, cam_t_cam0 = camera.r_rect, camera.cam_T_cam0 or Transform.identity()
        if r_rect is None:
            continue
        turned[index] = r_rect @ cam_t_cam0.rotation
        apart = float(np.abs(rectified_offset(camera) - r_rect @ cam_t_cam0.translation).max())
        if apart > _SAME_PLACE_M:
            text = f'P_rect_{index:02d} and R_rect, T put camera {index} {apart:.3f} m apart'
            yield Breach(text, file.path)
    for one, other in combinations(turned, 2):
        off = float(np.abs(turned[one] @ turned[other].T - np.eye(3)).max())
        if off > _PARALLEL:
            text = f'R_rect and R of cameras {one} and {other} are not parallel, by {off:.2g} rad'
            yield Breach(text, file.path)


def _find_scanner(file: CalibrationFile) -> Iterator[Breach]:
    cam0_t_velo = file.calibration.cam0_T_velo
    if cam0_t_velo is None or file.calibration.independent_cameras:
        return
    # Column 0 is the scanner's x axis, forward; camera z is forward, y is down.
    if cam0_t_velo.rotation[2, 0] < _FORWARD or cam0_t_velo.rotation[1, 2] > -_FORWARD:
        text = 'Tr_velo_to_cam: camera 0 does not look along x of the scanner with z up'
        yield Breach(text, file.path)
    distance = float(np.linalg.norm(cam0_t_velo.translation))
    if distance > _NEAR_M:
        yield Breach(f'Tr_velo_to_cam: the scanner is {distance:.1f} m from camera 0', file.path)


_FILE = RuleScope.FILE
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING

CALIBRATION_RULES: tuple[Rule[CalibrationFile], ...] = (
    Rule(
        'calib-value',
        _ERROR,
        _FILE,
        'Calibrations are keys with finite numbers; R is a rotation to 1e-3, P invertible',
        'correct the line, or copy the file again',
        _find_invalid_calibration,
    ),
    Rule(
        'calib-missing',
        _WARNING,
        _FILE,
        'Calibration files and their usual keys exist',
        'without it there are no camera models, projections or 3D boxes of labels',
        _find_absent,
    ),
    Rule(
        'calib-placeholder',
        RuleSeverity.NOTE,
        _FILE,
        'Calibration keys have values',
        'empty values and zeros count as absent: nothing to do for sensors that do not exist',
        _find_placeholders,
    ),
    Rule(
        'calib-day',
        _WARNING,
        _FILE,
        'The calibration is of the day of the drive, by its calib_time (raw)',
        'give the calibration of the day in the name of the drive',
        _find_another_day,
    ),
    Rule(
        'calib-rotation',
        _WARNING,
        _FILE,
        'R R^T is the identity to 1e-5',
        'write rotations with seven digits or more',
        _find_not_orthonormal,
    ),
    Rule(
        'calib-projection',
        _ERROR,
        _FILE,
        'P has positive, equal focal lengths (to 10 %) and the last row 0 0 1',
        'P is 3x4, row by row: check the order and the units',
        _find_projection,
    ),
    Rule(
        'calib-baseline',
        _WARNING,
        _FILE,
        'Right cameras are 2 cm to 3 m to the right of the left ones, by P1 and P0, P3 and P2',
        'the fourth column of P is -fx times the place in metres: check sign and unit',
        _find_baseline,
    ),
    Rule(
        'calib-contradiction',
        _WARNING,
        _FILE,
        'P_rect agrees with R_rect, R and T (raw): places to 5 mm, rectified axes to 1 mrad',
        'give the three files of one calibration',
        _find_contradiction,
    ),
    Rule(
        'calib-scanner',
        _WARNING,
        _FILE,
        'Camera 0 looks along x of the scanner, less than 5 m away',
        'Tr_velo_to_cam maps the scanner to the camera: check that it is not the inverse',
        _find_scanner,
    ),
)
