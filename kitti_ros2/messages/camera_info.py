# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calibration -> sensor_msgs/CameraInfo; any CameraInfo -> a camera model.

One rule: P (after R) projects points given in header.frame_id, exactly as KITTI's own P does.

- Rectified images: K = P[:, :3], R = I, D = 0. A left camera's frame is its own. A right camera's
  is the *left* optical frame of its pair, with K t in P's fourth column, t the offset within the
  pair: the stereo convention of sensor_msgs/CameraInfo, so no baseline is counted twice.
- Unrectified images (extract): the camera's own unrectified frame, its K, D and R_rect, and
  K_rect in P. The cameras' R_0i, T_0i and P_rect differ by up to 0.3 mm in KITTI's files; the
  remainder is in P's fourth column.
- Cameras with extrinsics of their own (Waymo): their own frame, and P as it is.
- Fisheyes (KITTI-360): distortion_model mei, for which ROS has no name, D of xi k1 k2 p1 p2, K of
  gamma1 gamma2 u0 v0. P is the pinhole of the same size in the middle of the image: what it shows
  of points near the axis is right, and image_geometry refuses to rectify.

On request the pairs of cameras (0 and 1, 2 and 3) follow the rule of stereo nodes instead: P is
K_rect, and in the right camera Tx = -fx B, B the baseline along x, with Ty = Tz = 0
(CameraInfo.msg on the second camera of a horizontal pair). The right camera names its own frame, so
that the baseline is in TF, too, or the left one's. Who reads what:

- cuVSLAM: K, and the extrinsics from TF by the frame of each CameraInfo (isaac_ros_visual_slam
  8d7f280, src/impl/visual_slam_impl.cpp, Initialize); mono8 and rgb8 only (575961b,
  src/impl/cuvslam_ros_conversion.cpp, TocuVSLAMImageEncoding).
- rtabmap: the left frame, and the baseline of P, for rectified images; TF between both frames for
  others, where equal frames are an error (rtabmap_ros, stereo_odometry, alreadyRectified).
- stereo_image_proc: the left header, and the baseline of P (image_pipeline 0131608,
  disparity_node.cpp). image_geometry asserts equal frames of both, which ends nodes that are
  built without NDEBUG, and equal fx, fy and cy (vision_opencv e8884ed, stereo_camera_model.cpp,
  lines 32 to 35).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.geometry import NOMINAL_CAM0_T_VELO, NOMINAL_CAM0_X_M, Transform
from ..model.samples import LEFT_OF, CameraCalibration, rectified_offset
from .cdr import make_header, make_quaternion, make_vector3, vector_of
from .ros_types import CameraInfo, RegionOfInterest, TFMessage, TransformMsg, TransformStamped

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Calibration
    from .naming import FrameNames


_PAIRED = frozenset(LEFT_OF) | frozenset(LEFT_OF.values())
_SINGULAR = 1e-9
_ROTATION = 1e-3
_LARGEST = 1e9
_SAME_PIXEL = 1e-3

PLUMB_BOB, RATIONAL, EQUIDISTANT = 'plumb_bob', 'rational_polynomial', 'equidistant'
LENS_MODELS = (PLUMB_BOB, RATIONAL, EQUIDISTANT)
"""Names of sensor_msgs/distortion_models.hpp, each with a function of OpenCV."""

_LENSES = {
    '': PLUMB_BOB,
    'radtan': PLUMB_BOB,  # of Kalibr and VINS
    'brown_conrady': PLUMB_BOB,  # of RealSense
    'fisheye': EQUIDISTANT,
    'kannala_brandt': EQUIDISTANT,
}


def image_frame_camera(calibration: Calibration, index: int, *, own: bool = False) -> int:
    """Return the camera whose optical frame is the frame_id of a camera's images.

    With own it is the camera itself.
    """
    left = LEFT_OF.get(index)
    if own or left is None or not calibration.rectified or calibration.is_independent(index):
        return index
    return left if left in calibration.cameras else index


def projection(calibration: Calibration, index: int) -> Float64Array:
    """Return (3, 4) P of CameraInfo, which projects points of the image's frame after R."""
    camera = calibration.cameras[index]
    k = camera.p_rect[:, :3]
    if camera.lens is not None:
        p: Float64Array = camera.p_rect.copy()
        p[[0, 1], [0, 1]] *= camera.lens.scale
        return p
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


def stereo_projection(calibration: Calibration, index: int) -> Float64Array:
    """Return (3, 4) P of CameraInfo by the rule of stereo nodes; projection's for other cameras."""
    cameras, left = calibration.cameras, LEFT_OF.get(index, index)
    if calibration.is_independent(index) or index not in _PAIRED:
        return projection(calibration, index)
    fx_baseline = 0.0
    if left in cameras:
        offset = rectified_offset(cameras[index]) - rectified_offset(cameras[left])
        fx_baseline = cameras[index].p_rect[0, 0] * offset[0]
    return np.column_stack([cameras[index].p_rect[:, :3], [fx_baseline, 0.0, 0.0]])


def encode_camera_info(
    calibration: Calibration,
    index: int,
    size: tuple[int, int],
    stamp_ns: int,
    frame_id: str,
    *,
    stereo: bool = False,
) -> CameraInfo:
    """Make the CameraInfo of a camera.

    Args:
        calibration: Contains the camera.
        index: KITTI camera index.
        size: (width, height) of its images.
        stamp_ns: The image's own.
        frame_id: The image's own.
        stereo: Whether P follows the rule of stereo nodes.
    """
    camera = calibration.cameras[index]
    k, d, r = camera.p_rect[:, :3], np.zeros(5), np.eye(3)
    model = PLUMB_BOB
    if camera.lens is not None:
        model, d = camera.lens.model, camera.lens.numbers
    if not calibration.rectified:
        k = k if camera.k is None else camera.k
        d = d if camera.d is None else camera.d
        r = r if camera.r_rect is None else camera.r_rect
    return CameraInfo(
        header=make_header(stamp_ns, frame_id),
        height=size[1],
        width=size[0],
        distortion_model=model,
        d=d,
        k=np.ascontiguousarray(k).ravel(),
        r=r.ravel(),
        p=(stereo_projection if stereo else projection)(calibration, index).ravel(),
        binning_x=0,
        binning_y=0,
        roi=RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A camera model from a CameraInfo, in pixels of the published images.

    Attributes:
        frame: Optical frame (x right, y down, z forward).
        size: (width, height).
        k: (3, 3) of the unrectified image.
        d: (n,) distortion.
        r: (3, 3) optical to rectified frame.
        p: (3, 4), projects points of the rectified frame.
        model: Name of the distortion model.
        turned: Whether its images are rectified by a plan, so that R counts.
    """

    frame: str
    size: tuple[int, int]
    k: Float64Array
    d: Float64Array
    r: Float64Array
    p: Float64Array
    model: str = PLUMB_BOB
    turned: bool = False

    @property
    def is_as_rectified(self) -> bool:
        """True if its images are rectified as they are: D is 0 and K that of P."""
        plain = self.model in {PLUMB_BOB, RATIONAL} and not self.d.any()
        return plain and not self.turned and has_k_of_p(self.k, self.p)

    @property
    def offset(self) -> Float64Array:
        """(3,) metres that P's fourth column adds to points of the rectified frame."""
        return np.asarray(np.linalg.solve(self.p[:, :3], self.p[:, 3]), np.float64)

    def sees(self, points: Float64Array) -> npt.NDArray[np.bool_]:
        """Return (N,) which of (N, 3) points of the optical frame are in the rectified image."""
        with np.errstate(all='ignore'):
            pixels = (points @ self.r.T) @ self.p[:, :3].T + self.p[:, 3]
            u, v = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2]
            ahead = pixels[:, 2] > 0
            inside = ahead & (u >= 0) & (v >= 0) & (u < self.size[0]) & (v < self.size[1])
        return np.asarray(inside)


def camera_model(message: Any) -> CameraModel:  # noqa: ANN401 - of the bag's types
    """Make the model of a sensor_msgs/CameraInfo.

    P, R or K of zeros is missing: P is then K, R the identity, K the left part of P. Binning and a
    region of interest transform K and P to the published pixels: first the region's corner is
    subtracted, in pixels of the full resolution, then all is divided (CameraInfo.msg, and as
    image_geometry does it).

    Raises:
        ValueError: It has no size or no calibration, or its region leaves the image.
    """
    if not message.width or not message.height:
        raise ValueError('a CameraInfo without width and height')
    k, p = _matrix(message.k, 3), _matrix(message.p, 4)
    if not p[:, :3].any():
        p = np.column_stack([k, np.zeros(3)])
    if not k.any():
        k = p[:, :3].copy()
    for name, matrix in (('K', k), ('P', p)):
        if not _is_projection(matrix):
            raise ValueError(f'a CameraInfo that is not calibrated: {name} is {matrix.tolist()}')
    d = np.array(message.d, dtype=np.float64).ravel()
    if not (np.abs(d) <= _LARGEST).all():
        raise ValueError(f'a CameraInfo that is not calibrated: D is {d.tolist()}')
    size, to_published = _published(message)
    return CameraModel(
        frame=message.header.frame_id.lstrip('/'),
        size=size,
        k=to_published @ k,
        d=d,
        r=_rectifying(_matrix(message.r, 3)),
        p=to_published @ p,
        model=lens_model(message.distortion_model, d),
    )


def has_k_of_p(k: Any, p: Any) -> bool:  # noqa: ANN401 - lists or arrays
    """Return whether K, 9 numbers, is the left (3, 3) of P, 12 numbers, to 1e-3 pixels."""
    return np.allclose(_matrix(k, 3), _matrix(p, 4)[:, :3], rtol=0, atol=_SAME_PIXEL)


def lens_model(name: str, d: Float64Array) -> str:
    """Return the name that ROS has for a distortion model, plumb_bob for one without distortion.

    Args:
        name: Lens model of any calibration program.
        d: (n,) its numbers; all 0 is no distortion, but in a fisheye model.
    """
    lower = name.lower()
    model = lower if lower in LENS_MODELS else _LENSES.get(lower, name)
    return model if model in LENS_MODELS or d.any() else PLUMB_BOB


def _is_projection(matrix: Float64Array) -> bool:
    """Return whether a K or P is valid: finite, of limited size, focal lengths > 0, invertible."""
    if not (np.abs(matrix) <= _LARGEST).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        return False
    return bool(abs(np.linalg.det(matrix[:, :3])) >= _SINGULAR)


def _matrix(numbers: Any, columns: int) -> Float64Array:  # noqa: ANN401 - a list or an array
    return np.array(numbers, dtype=np.float64).reshape(3, columns)


def _rectifying(r: Float64Array) -> Float64Array:
    if not r.any():
        return np.eye(3)
    off = np.abs(r @ r.T - np.eye(3)).max()
    if not off < _ROTATION or np.linalg.det(r) < 0:
        raise ValueError(f'a CameraInfo whose R is no rotation: {r.tolist()}')
    return r


def _published(message: Any) -> tuple[tuple[int, int], Float64Array]:  # noqa: ANN401
    """Return the size of the published images, and (3, 3) from full-resolution pixels to theirs."""
    roi = message.roi
    width, height = roi.width or message.width, roi.height or message.height
    if roi.x_offset + width > message.width or roi.y_offset + height > message.height:
        raise ValueError(
            f'a CameraInfo of {message.width} x {message.height} pixels, whose region of'
            f' {width} x {height} begins at {roi.x_offset}, {roi.y_offset}'
        )
    columns, rows = max(message.binning_x, 1), max(message.binning_y, 1)
    scale = np.diag([1 / columns, 1 / rows, 1.0])
    shift = np.array([[1.0, 0, -roi.x_offset], [0, 1, -roi.y_offset], [0, 0, 1]])
    size = width // columns, height // rows
    if not all(size):
        raise ValueError(f'a CameraInfo whose binning of {columns} x {rows} leaves no pixel')
    return size, scale @ shift


# Nominal camera mounts, so that every frame_id of a message is in the static tree.
#
# They are used for the tree only. Boxes and CameraInfo require the real calibration.


def with_nominal_mounts(
    calibration: Calibration, cameras: Collection[int], *, own: bool = False
) -> Calibration:
    """Add nominal values to a calibration where the mount of a camera is missing.

    Args:
        calibration: Calibration of a frame.
        cameras: Cameras whose images or labels are in messages.
        own: Whether each names its own frame.

    Returns:
        A calibration with the frame of each of them; nominal lists the added parts.
    """
    named = sorted({image_frame_camera(calibration, index, own=own) for index in cameras})
    if not named:
        return calibration
    if all(map(calibration.is_independent, named)):
        return _with_cameras(calibration, [i for i in named if not _has_own_mount(calibration, i)])
    nominal = []
    if calibration.cam0_T_velo is None:
        nominal.append('cam0_T_velo')
    if calibration.rectified and calibration.r0_rect is None:
        nominal.append('r0_rect')
    filled = replace(
        calibration,
        cam0_T_velo=calibration.cam0_T_velo
        or calibration.nominal_mounts.get(0, NOMINAL_CAM0_T_VELO),
        r0_rect=np.eye(3) if calibration.r0_rect is None else calibration.r0_rect,
        nominal=(*calibration.nominal, *nominal),
    )
    # Camera 0's frame needs cam0_T_velo alone.
    return _with_cameras(filled, [i for i in named if i and not _has_pose(calibration, i)])


def _has_own_mount(calibration: Calibration, index: int) -> bool:
    camera = calibration.cameras.get(index)
    return camera is not None and camera.cam_T_velo is not None


def _has_pose(calibration: Calibration, index: int) -> bool:
    camera = calibration.cameras.get(index)
    return camera is not None and (calibration.rectified or camera.cam_T_cam0 is not None)


def _with_cameras(calibration: Calibration, missing: list[int]) -> Calibration:
    cameras = dict(calibration.cameras)
    for index in missing:
        own = calibration.mounts.get(index, calibration.nominal_mounts.get(index))
        if own is None and calibration.is_independent(index):
            own = NOMINAL_CAM0_T_VELO
        offset = np.array([-NOMINAL_CAM0_X_M.get(index, 0.0), 0.0, 0.0])
        cameras[index] = CameraCalibration(
            np.column_stack([np.eye(3), offset]),
            cam_T_cam0=Transform.from_translation(offset),
            cam_T_velo=own,
        )
    nominal = [index for index in missing if index not in calibration.mounts]
    names = tuple(f'the mount of camera {index}' for index in nominal)
    return replace(calibration, cameras=cameras, nominal=(*calibration.nominal, *names))


# Calibration -> tf2_msgs/TFMessage: the static tree in one message.


def static_links(
    calibration: Calibration, base_t_imu: Transform, frames: FrameNames
) -> list[tuple[str, str, Transform]]:
    """Return (parent, child, parent_T_child) of the static tree; unknown links are skipped.

    base_link -> imu_link -> velo_link -> camera 0 -> the other cameras, where camera 0 is the
    rectified one, or the unrectified where the images are. Cameras with extrinsics of their own are
    children of velo_link, and so is KITTI-360's line scanner.
    """
    links = [
        (frames.base, frames.imu, base_t_imu),
        (frames.imu, frames.velo, calibration.velo_T_imu.inverse()),
    ]
    if calibration.velo_T_sick is not None:
        links.append((frames.velo, frames.sick, calibration.velo_T_sick))
    first = frames.camera(0)
    cam0_t_velo = None if calibration.is_independent(0) else _camera0_t_velo(calibration)
    if cam0_t_velo is not None:
        links.append((frames.velo, first, cam0_t_velo.inverse()))
    for index, camera in sorted(calibration.cameras.items()):
        if camera.cam_T_velo is not None:
            links.append((frames.velo, frames.camera(index), camera.cam_T_velo.inverse()))
        elif index == 0:
            continue
        elif calibration.rectified:
            offset = Transform.from_translation(-rectified_offset(camera))
            links.append((first, frames.camera(index), offset))
        elif camera.cam_T_cam0 is not None:
            links.append((first, frames.camera(index), camera.cam_T_cam0.inverse()))
    return links


def _camera0_t_velo(calibration: Calibration) -> Transform | None:
    """Return cam0_T_velo of the frame of camera 0's images."""
    if calibration.cam0_T_velo is None:
        return None
    if not calibration.rectified:
        return calibration.cam0_T_velo
    if calibration.r0_rect is None:
        return None
    return Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo


def encode_static(links: Sequence[tuple[str, str, Transform]], stamp_ns: int) -> TFMessage:
    """Make a message of all static transforms."""
    return TFMessage(
        [make_transform(transform, stamp_ns, parent, child) for parent, child, transform in links]
    )


def decode_static(message: TFMessage) -> list[tuple[str, str, Transform]]:
    """Decode static transforms: the inverse of encode_static."""
    links = []
    for stamped in message.transforms:
        q = stamped.transform.rotation
        translation = vector_of(stamped.transform.translation)
        transform = Transform.from_quaternion((q.x, q.y, q.z, q.w), translation)
        links.append((stamped.header.frame_id, stamped.child_frame_id, transform))
    return links


def make_transform(
    transform: Transform, stamp_ns: int, parent: str, child: str
) -> TransformStamped:
    """Make a TransformStamped of parent_T_child."""
    return TransformStamped(
        make_header(stamp_ns, parent),
        child,
        TransformMsg(make_vector3(transform.translation), make_quaternion(transform.quaternion())),
    )
