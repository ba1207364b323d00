# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of calibrations, in the form of each layout."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.calib_file import (
    format_object,
    format_odometry,
    format_raw,
    format_tracking,
    parse_calibration,
    parse_raw_calibration,
)
from ..kitti.store import STORE
from ..model.errors import BadFileError, UsageError
from ..model.layouts import Layout
from .calibration import CalibratedRig
from .paths import file_at

if TYPE_CHECKING:
    from .paths import AnyPath

_RAW_FILES = (names.CALIB_CAM_TO_CAM, names.CALIB_VELO_TO_CAM, names.CALIB_IMU_TO_VELO)
_FORMATS = {
    Layout.OBJECT: lambda model: {'': format_object(model)},
    Layout.TRACKING: lambda model: {'': format_tracking(model)},
    Layout.ODOMETRY: lambda model: {'': format_odometry(model)},
    Layout.RAW: format_raw,
}


def read_calibration(path: AnyPath) -> CalibratedRig:
    """Read a calibration in any of KITTI's forms.

    Args:
        path: calib/*.txt (object, tracking), calib.txt (odometry), or the date's folder of a raw
            drive with its three files.

    Raises:
        KittiRos2Error: A file is missing or invalid.
    """
    with file_at(path) as file:
        if file.is_dir():
            texts = {
                name: STORE.read_text(file / name) for name in _RAW_FILES if (file / name).is_file()
            }
            found = parse_raw_calibration(texts, file, rectified=True)
        else:
            found = parse_calibration(STORE.read_text(file), file, file.name)
        for reason in found.missing.values():
            raise BadFileError(file, reason, 'a whole calibration')
        return CalibratedRig(found)


def write_calibration(
    path: AnyPath, calibration: CalibratedRig, layout: str | Layout = Layout.OBJECT
) -> None:
    """Write a calibration in the form of a layout; the inverse of read_calibration.

    Args:
        path: The file; for raw the folder of the date, where three files are written.
        calibration: Has at least one camera, and the place of the scanner. Loaders read four
            cameras, so an absent one gets the projection of the first.
        layout: object, tracking, odometry or raw.

    Raises:
        KittiRos2Error: A part of the calibration is missing, or the file cannot be written.
    """
    try:
        files = _FORMATS[Layout(layout)](calibration.model)
    except ValueError as error:
        raise UsageError(f'{path}: {error}') from None
    with file_at(path) as file:
        for name, text in files.items():
            STORE.write_text(file / name if name else file, text)
