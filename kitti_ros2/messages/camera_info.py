# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration -> sensor_msgs/CameraInfo.

One rule: P (after R) projects points given in header.frame_id, exactly as KITTI's own P does.

- Rectified images: K = P[:, :3], R = I, D = 0. A left camera's frame is its own. A right camera's
  is the *left* optical frame of its pair, with K t in P's fourth column, t the offset within the
  pair: the stereo convention of sensor_msgs/CameraInfo, so no baseline is counted twice.
- Unrectified images (extract): the camera's own unrectified frame, its K, D and R_rect, and
  K_rect in P. The cameras' R_0i, T_0i and P_rect differ by up to 0.3 mm in KITTI's files; the
  remainder is in P's fourth column.
- Cameras with extrinsics of their own (Waymo): their own frame, and P as it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform
from .header import make_header
from .ros_types import CameraInfo, RegionOfInterest

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, CameraCalibration

__all__ = [
    'CameraInfo',
    'decode_camera_info',
    'encode_camera_info',
    'image_frame_camera',
    'projection',
    'rectified_offset',
]

LEFT_OF = {1: 0, 3: 2}
"""The left camera of each right camera's stereo pair."""


def rectified_offset(camera: CameraCalibration) -> Float64Array:
    """Return (3,) metres t = K^-1 P[:, 3]: p of the rectified camera 0 is p + t in this camera."""
    return np.asarray(np.linalg.solve(camera.p_rect[:, :3], camera.p_rect[:, 3]), np.float64)


def image_frame_camera(calibration: Calibration, index: int) -> int:
    """Return the camera whose optical frame is the frame_id of a camera's images."""
    left = LEFT_OF.get(index)
    if left is None or not calibration.rectified or calibration.independent_cameras:
        return index
    return left if left in calibration.cameras else index


def projection(calibration: Calibration, index: int) -> Float64Array:
    """Return (3, 4) P of CameraInfo, which projects points of the image's frame after R."""
    camera = calibration.cameras[index]
    k = camera.p_rect[:, :3]
    if camera.cam_T_velo is not None:
        return camera.p_rect
    if not calibration.rectified:
        cam_t_cam0 = camera.cam_T_cam0 or Transform.identity()
        r_rect = np.eye(3) if camera.r_rect is None else camera.r_rect
        rest = rectified_offset(camera) - r_rect @ cam_t_cam0.translation
    else:
        frame = image_frame_camera(calibration, index)
        # Camera 0's frame is the rectified frame itself, wherever P0 puts its centre.
        origin = rectified_offset(calibration.cameras[frame]) if frame else np.zeros(3)
        rest = rectified_offset(camera) - origin if index != frame or not frame else np.zeros(3)
    return np.column_stack([k, k @ rest])


def encode_camera_info(
    calibration: Calibration, index: int, size: tuple[int, int], stamp_ns: int, frame_id: str
) -> CameraInfo:
    """Make the CameraInfo of a camera.

    Args:
        calibration: Contains the camera.
        index: KITTI camera index.
        size: (width, height) of its images.
        stamp_ns: The image's own.
        frame_id: The image's own.
    """
    camera = calibration.cameras[index]
    k, d, r = camera.p_rect[:, :3], np.zeros(5), np.eye(3)
    if not calibration.rectified:
        k = k if camera.k is None else camera.k
        d = d if camera.d is None else camera.d
        r = r if camera.r_rect is None else camera.r_rect
    return CameraInfo(
        header=make_header(stamp_ns, frame_id),
        height=size[1],
        width=size[0],
        distortion_model='plumb_bob',
        d=d,
        k=np.ascontiguousarray(k).ravel(),
        r=r.ravel(),
        p=projection(calibration, index).ravel(),
        binning_x=0,
        binning_y=0,
        roi=RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def decode_camera_info(
    message: CameraInfo,
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return K (3, 3), D (n,), R (3, 3) and P (3, 4) of a CameraInfo."""
    return message.k.reshape(3, 3), message.d, message.r.reshape(3, 3), message.p.reshape(3, 4)
