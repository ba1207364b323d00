# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CameraInfo and static transforms -> a calibration as KITTI's files have it.

KITTI's frame is the rectified frame of the lowest-numbered camera: its optical frame, turned by the
R of its CameraInfo. P_i projects points of that frame to camera i's rectified pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import LackingError
from ..geometry import Transform
from ..kitti.calib_file import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU
from ..samples import Calibration, CameraCalibration

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..geometry import Float64Array
    from .frame_tree import FrameTree

_PARALLEL_RAD = 1e-6
_SINGULAR = 1e-9
_SAME_PLACE_M = 1e-3
_BASELINE_M = 0.02
_BASELINE_SHARE = 0.1
_PLUMB_BOB_NUMBERS = 5


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A camera as its CameraInfo tells, in pixels of the images that are published.

    Attributes:
        frame: Optical frame (x right, y down, z forward).
        size: (width, height).
        k: (3, 3) of the unrectified image.
        d: (n,) distortion.
        r: (3, 3) optical to rectified frame.
        p: (3, 4), projects points of the rectified frame.
        model: Name of the distortion model.
    """

    frame: str
    size: tuple[int, int]
    k: Float64Array
    d: Float64Array
    r: Float64Array
    p: Float64Array
    model: str = 'plumb_bob'


def camera_model(message: Any) -> CameraModel:  # noqa: ANN401 - of the bag's types
    """The model of a sensor_msgs/CameraInfo.

    A P or R of zeros is one that was never calibrated: K and no turn take its place. Binning and a
    region of interest shift and scale K and P to the published pixels, as CameraInfo.msg says.

    Raises:
        ValueError: It is not calibrated, or has no size.
    """
    k, r = message.k.reshape(3, 3).astype(float), message.r.reshape(3, 3).astype(float)
    p = message.p.reshape(3, 4).astype(float)
    if not message.width or not message.height:
        raise ValueError('a CameraInfo without width and height')
    if not p[:, :3].any():
        p = np.column_stack([k, np.zeros(3)])
    if not k.any():
        k = p[:, :3]
    for matrix in (k, p):
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:, :3])) < _SINGULAR:
            raise ValueError('a CameraInfo that is not calibrated: K and P are zeros')
    size, shift, scale = _published(message)
    pixels = np.array([[scale[0], 0, -shift[0] * scale[0]], [0, scale[1], -shift[1] * scale[1]]])
    change = np.vstack([pixels, [0, 0, 1]])
    return CameraModel(
        message.header.frame_id.lstrip('/'),
        size,
        change @ k,
        np.array(message.d, dtype=float),
        r if r.any() else np.eye(3),
        change @ p,
        message.distortion_model or 'plumb_bob',
    )


def _published(
    message: Any,  # noqa: ANN401 - of the bag's types
) -> tuple[tuple[int, int], tuple[float, float], tuple[float, float]]:
    """Size of the published image, and its origin and scale in full-resolution pixels."""
    roi = message.roi
    width, height = roi.width or message.width, roi.height or message.height
    binning = max(message.binning_x, 1), max(message.binning_y, 1)
    size = width // binning[0], height // binning[1]
    return size, (roi.x_offset, roi.y_offset), (1 / binning[0], 1 / binning[1])


def make_calibration(
    tree: FrameTree,
    lidar_frame: str | None,
    cameras: Mapping[int, CameraModel],
    imu_frame: str | None,
    *,
    rectified: bool,
) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration of a rig, and what its user should know.

    Args:
        tree: The static transforms.
        lidar_frame: KITTI's velodyne frame; None for a rig without scanner.
        cameras: By KITTI index, at least one.
        imu_frame: KITTI's imu frame; None for a rig without one.
        rectified: False for unrectified images, whose K, D, R and P all go to the calibration.

    Raises:
        LackingError: The tree does not join the frames; a stereo baseline is told twice and
            differently; a distortion has no place in KITTI's files.
    """
    first = min(cameras)
    reference = cameras[first]
    notes: list[str] = []
    nominal = []
    if lidar_frame is None:
        cam0_t_velo = NOMINAL_CAM0_T_VELO
        nominal.append('cam0_T_velo')
    else:
        cam0_t_velo = tree.transform(reference.frame, lidar_frame)
    if imu_frame is None or lidar_frame is None:
        velo_t_imu = NOMINAL_VELO_T_IMU
        nominal.append('velo_T_imu')
    else:
        velo_t_imu = tree.transform(lidar_frame, imu_frame)
    found = {}
    for index, model in sorted(cameras.items()):
        cam_t_cam0, p = _placed(tree, index, cameras, notes)
        turn = _turn(model.r) @ cam_t_cam0 @ _turn(reference.r).inverse()
        found[index] = CameraCalibration(p @ _folded(turn), model.size)
        _note_turn(index, turn, notes)
        if not rectified:
            found[index] = _unrectified(found[index], index, model, cam_t_cam0)
    calibration = Calibration(
        found,
        r0_rect=reference.r,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu,
        rectified=rectified,
        nominal=tuple(nominal),
    )
    return calibration, tuple(notes)


def _turn(rotation: Float64Array) -> Transform:
    return Transform(rotation, np.zeros(3))


def _folded(transform: Transform) -> Float64Array:
    """(4, 4) with the rotation left out where it is none, so that K stays as it is."""
    matrix = transform.matrix()
    if _angle(transform.rotation) <= _PARALLEL_RAD:
        matrix[:3, :3] = np.eye(3)
    return matrix


def _angle(rotation: Float64Array) -> float:
    return float(np.linalg.norm(rotation - np.eye(3)) / np.sqrt(2))


def _note_turn(index: int, turn: Transform, notes: list[str]) -> None:
    angle = _angle(turn.rotation)
    if angle > np.radians(0.5):
        notes.append(
            f'camera {index} is turned by {np.degrees(angle):.1f} degrees against the first:'
            f' P{index} holds the turn, so its left part is no plain K'
        )


def _placed(
    tree: FrameTree, index: int, cameras: Mapping[int, CameraModel], notes: list[str]
) -> tuple[Transform, Float64Array]:
    """cam_T_cam0 of a camera (its own optical frame) and the P that goes with it.

    P projects points given in the frame that the CameraInfo names. A right camera of a stereo pair
    has its baseline in P's fourth column, relative to the left camera (CameraInfo.msg). Where it is
    stamped with a frame of its own that stands a baseline away, the tree tells the same once more:
    the column is dropped then, for a baseline counts once.

    Raises:
        LackingError: The frames are not joined, or the two baselines differ.
    """
    model, reference = cameras[index], cameras[min(cameras)]
    k = model.p[:, :3]
    offset = np.linalg.solve(k, model.p[:, 3])
    shared = any(other.frame == model.frame for i, other in cameras.items() if i != index)
    if np.linalg.norm(offset) <= _SAME_PLACE_M or shared:
        return tree.transform(model.frame, reference.frame), model.p
    plain = np.column_stack([k, np.zeros(3)])
    others = [other for i, other in cameras.items() if i != index]
    if not others:
        notes.append(
            f'camera {index}: its P has a baseline of {np.linalg.norm(offset):.3f} m, taken from'
            f' {model.frame} as there is no other camera'
        )
        return Transform.identity(), model.p
    try:
        places = [(_turn(model.r) @ tree.transform(model.frame, each.frame)) for each in others]
    except LackingError:
        # Nothing but P tells of the pair: its left camera is the one with the same K and no offset.
        notes.append(f'camera {index}: no transform to the others; its place is taken from P')
        return Transform.identity(), model.p
    distances = [float(np.linalg.norm(place.translation - offset)) for place in places]
    limit = max(_BASELINE_M, _BASELINE_SHARE * float(np.linalg.norm(offset)))
    if min(distances) <= limit:
        return tree.transform(model.frame, reference.frame), plain
    if min(float(np.linalg.norm(place.translation)) for place in places) <= _SAME_PLACE_M:
        return tree.transform(model.frame, reference.frame), model.p
    seen = ', '.join(f'{np.linalg.norm(place.translation):.3f}' for place in places)
    raise LackingError(
        f'{model.frame}: camera {index} has a baseline of {np.linalg.norm(offset):.3f} m in its P,'
        f" and is {seen} m from the other cameras by the static transforms; set the camera's frame"
        f' in the plan, or give --calib'
    )


def _unrectified(
    camera: CameraCalibration, index: int, model: CameraModel, cam_t_cam0: Transform
) -> CameraCalibration:
    """The same with what raw extract needs besides.

    Raises:
        LackingError: The distortion is not plumb_bob of up to five numbers.
    """
    if model.model != 'plumb_bob' or len(model.d) > _PLUMB_BOB_NUMBERS:
        raise LackingError(
            f'camera {index} is distorted by {model.model} of {len(model.d)} numbers, and KITTI has'
            f' a place for plumb_bob of 5; set rectify: true in the plan'
        )
    d = np.zeros(_PLUMB_BOB_NUMBERS)
    d[: len(model.d)] = model.d
    return replace(camera, k=model.k, d=d, r_rect=model.r, cam_T_cam0=cam_t_cam0)
