# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Nominal camera mounts, so that every frame_id of a message is in the static tree.

They are used for the tree only. Boxes and CameraInfo require the real calibration.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform
from ..model.nominal import NOMINAL_CAM0_T_VELO, NOMINAL_CAM0_X_M
from ..model.samples import CameraCalibration
from .camera_info import image_frame_camera

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..model.samples import Calibration


def with_nominal_mounts(
    calibration: Calibration, cameras: Collection[int], *, own: bool = False
) -> Calibration:
    """Add nominal values to a calibration where the mount of a camera is missing.

    Args:
        calibration: Of a frame.
        cameras: Those whose images or labels are in messages.
        own: Whether each names its own frame.

    Returns:
        A calibration with the frame of each of them; nominal lists the added parts.
    """
    named = sorted({image_frame_camera(calibration, index, own=own) for index in cameras})
    if not named:
        return calibration
    if calibration.independent_cameras:
        return _with_cameras(calibration, [i for i in named if not _has_own_mount(calibration, i)])
    nominal = []
    if calibration.cam0_T_velo is None:
        nominal.append('cam0_T_velo')
    if calibration.rectified and calibration.r0_rect is None:
        nominal.append('r0_rect')
    filled = replace(
        calibration,
        cam0_T_velo=calibration.cam0_T_velo or NOMINAL_CAM0_T_VELO,
        r0_rect=np.eye(3) if calibration.r0_rect is None else calibration.r0_rect,
        nominal=(*calibration.nominal, *nominal),
    )
    # Camera 0's frame is placed by cam0_T_velo alone.
    return _with_cameras(filled, [i for i in named if i and not _is_placed(calibration, i)])


def _has_own_mount(calibration: Calibration, index: int) -> bool:
    camera = calibration.cameras.get(index)
    return camera is not None and camera.cam_T_velo is not None


def _is_placed(calibration: Calibration, index: int) -> bool:
    camera = calibration.cameras.get(index)
    return camera is not None and (calibration.rectified or camera.cam_T_cam0 is not None)


def _with_cameras(calibration: Calibration, missing: list[int]) -> Calibration:
    own = NOMINAL_CAM0_T_VELO if calibration.independent_cameras else None
    cameras = dict(calibration.cameras)
    for index in missing:
        offset = np.array([-NOMINAL_CAM0_X_M.get(index, 0.0), 0.0, 0.0])
        cameras[index] = CameraCalibration(
            np.column_stack([np.eye(3), offset]),
            cam_T_cam0=Transform.from_translation(offset),
            cam_T_velo=own,
        )
    names = tuple(f'the mount of camera {index}' for index in missing)
    return replace(calibration, cameras=cameras, nominal=(*calibration.nominal, *names))
