# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CameraInfo and static transforms -> a calibration as KITTI's files have it.

KITTI's frame is the rectified frame of the lowest-numbered camera: its optical frame, turned by the
R of its CameraInfo. P_i projects points of that frame to camera i's rectified pixels.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.camera_info import PLUMB_BOB, RATIONAL
from ..model.errors import MissingDataError
from ..model.geometry import Transform
from ..model.nominal import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU
from ..model.samples import Calibration, CameraCalibration
from ..rig.stereo import angle_of, viewpoints

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..model.geometry import Float64Array
    from ..rig.stereo import Viewpoint
    from ..rig.tf_tree import FrameTree

# R of seven digits, as KITTI's files have it, makes turns of up to 2e-7 of cameras that have none.
_PARALLEL_RAD = 1e-6
_REPORTED_TURN_RAD = np.radians(0.01)
_PLUMB_BOB_NUMBERS = 5


def make_calibration(
    tree: FrameTree,
    lidar_frame: str | None,
    cameras: Mapping[int, CameraModel],
    imu_frame: str | None,
    *,
    rectified: bool,
    straightened: Collection[int] = (),
    others: Sequence[CameraModel] = (),
) -> tuple[Calibration, tuple[str, ...]]:
    """Make the calibration of a rig; also return remarks for the user, a line each.

    Args:
        tree: The static transforms.
        lidar_frame: KITTI's velodyne frame; None for a rig without scanner.
        cameras: By KITTI index.
        imu_frame: KITTI's imu frame; None for a rig without one.
        rectified: Whether the images are; if not, KITTI's files must support their distortion.
        straightened: Cameras whose images are rectified among others that are not: KITTI's
            unrectified camera is then the rectified one, with its K and without distortion.
        others: As viewpoints.

    Raises:
        MissingDataError: There is no camera; the tree does not connect the frames; KITTI's files do
            not support a distortion.
    """
    if not cameras:
        raise MissingDataError(
            'no camera has a CameraInfo, so there is no calibration; set calibration: none in the'
            ' plan, or give --calib'
        )
    views, notes = viewpoints(tree, cameras, others)
    first = min(cameras)
    cam0_t_velo, velo_t_imu, nominal = _mountings(tree, views[first], lidar_frame, imu_frame)
    found = {}
    for index, model in sorted(cameras.items()):
        cam_t_cam0 = Transform.identity()
        if index != first:
            cam_t_cam0 = _between(tree, views[index], views[first])
        turn = model.r @ cam_t_cam0.rotation @ cameras[first].r.T
        p_rect = _projection(views[index].p, Transform(turn, model.r @ cam_t_cam0.translation))
        k, d = _distorted(index, model, rectified=rectified or index in straightened)
        found[index] = CameraCalibration(p_rect, model.size, k, d, model.r, cam_t_cam0)
        if angle_of(turn) > _REPORTED_TURN_RAD:
            notes.append(
                f'camera {index} is turned by {np.degrees(angle_of(turn)):.3g} degrees against'
                f' camera {first}: P{index} holds the turn, so its left part is no plain K'
            )
    calibration = Calibration(
        found,
        r0_rect=cameras[first].r,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu,
        rectified=rectified,
        nominal=nominal,
    )
    if straightened:
        calibration = _straightened(calibration, cameras, straightened)
    return calibration, tuple(notes)


def _straightened(
    rig: Calibration, models: Mapping[int, CameraModel], which: Collection[int]
) -> Calibration:
    """Return the rig with some unrectified cameras replaced by the rectified ones."""
    image_t_cam = {
        index: Transform(model.r if index in which else np.eye(3), np.zeros(3))
        for index, model in models.items()
    }
    first = image_t_cam[min(models)]
    cameras = {}
    for index, camera in rig.cameras.items():
        place = None if camera.cam_T_cam0 is None else camera.cam_T_cam0 @ first.inverse()
        cameras[index] = replace(
            camera,
            cam_T_cam0=None if place is None else image_t_cam[index] @ place,
            r_rect=models[index].r @ image_t_cam[index].rotation.T,
        )
        if index in which:
            k, d = models[index].p[:, :3], np.zeros(_PLUMB_BOB_NUMBERS)
            cameras[index] = replace(cameras[index], k=k, d=d)
    cam0_t_velo = None if rig.cam0_T_velo is None else first @ rig.cam0_T_velo
    r0_rect = cameras[min(models)].r_rect
    return replace(rig, cameras=cameras, r0_rect=r0_rect, cam0_T_velo=cam0_t_velo)


def rect_in_frame(
    tree: FrameTree, cameras: Mapping[int, CameraModel], others: Sequence[CameraModel] = ()
) -> tuple[str, Transform]:
    """Return a frame of the tree, and KITTI's rectified camera 0 in it (frame_T_rect).

    Others are as of viewpoints.
    """
    first = min(cameras)
    view = viewpoints(tree, cameras, others)[0][first]
    cam_t_rect = Transform(cameras[first].r.T.copy(), np.zeros(3))
    return view.frame, view.cam_T_frame.inverse() @ cam_t_rect


def _mountings(
    tree: FrameTree, view: Viewpoint, lidar_frame: str | None, imu_frame: str | None
) -> tuple[Transform, Transform, tuple[str, ...]]:
    """Return cam0_T_velo, velo_T_imu, and which of them are nominal.

    Without a scanner its nominal place is used, and the imu is placed relative to that.
    """
    nominal = []
    cam0_t_velo, velo_t_imu = NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU
    if lidar_frame is not None:
        cam0_t_velo = view.cam_T_frame @ tree.transform(view.frame, lidar_frame)
    else:
        nominal.append('cam0_T_velo')
    if imu_frame is None:
        nominal.append('velo_T_imu')
    elif lidar_frame is not None:
        velo_t_imu = tree.transform(lidar_frame, imu_frame)
    else:
        cam0_t_imu = view.cam_T_frame @ tree.transform(view.frame, imu_frame)
        velo_t_imu = cam0_t_velo.inverse() @ cam0_t_imu
    return cam0_t_velo, velo_t_imu, tuple(nominal)


def _between(tree: FrameTree, view: Viewpoint, first: Viewpoint) -> Transform:
    """Return cam_T_cam0 of two viewpoints."""
    frame_t_first = tree.transform(view.frame, first.frame)
    return view.cam_T_frame @ frame_t_first @ first.cam_T_frame.inverse()


def _projection(p: Float64Array, rect_T_rect0: Transform) -> Float64Array:
    """Return (3, 4) P for points of the rectified camera 0; without a rotation, K is unchanged."""
    k = p[:, :3]
    fourth = k @ rect_T_rect0.translation + p[:, 3]
    if angle_of(rect_T_rect0.rotation) > _PARALLEL_RAD:
        k = k @ rect_T_rect0.rotation
    return np.column_stack([k, fourth])


def _distorted(
    index: int, model: CameraModel, *, rectified: bool
) -> tuple[Float64Array | None, Float64Array | None]:
    """Return K and D as KITTI has them: plumb_bob of five numbers; None where neither is needed.

    Raises:
        MissingDataError: The images have another distortion.
    """
    # The rational polynomial's denominator is 1 where its last three numbers are 0.
    plain = model.model == PLUMB_BOB or (
        model.model == RATIONAL and not model.d[_PLUMB_BOB_NUMBERS:].any()
    )
    if plain and not model.d[_PLUMB_BOB_NUMBERS:].any():
        d = np.zeros(_PLUMB_BOB_NUMBERS)
        d[: len(model.d)] = model.d[:_PLUMB_BOB_NUMBERS]
        return model.k, d
    if rectified:
        return None, None
    raise MissingDataError(
        f'camera {index} is distorted by {model.model} of {len(model.d)} numbers, and KITTI has a'
        f' place for plumb_bob of 5; set rectify: true in the plan'
    )
