# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by CameraInfo: rectification of their images, and their positions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.geometry import Transform
from ..model.samples import LEFT_OF, MOST_PIXELS
from .camera_info import EQUIDISTANT, PLUMB_BOB, RATIONAL, has_k_of_p

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from .camera_info import CameraModel
    from .images import Pixels
    from .tf_tree import FrameTree


# Rectification of images by sensor_msgs/CameraInfo.
#
# A point X of the camera's frame is seen at the pixel K distort(X) of the original image, and at
# the pixel P[:, :3] R X of the rectified one. P's fourth column moves the origin of the frame, not
# the pixels. Sources: sensor_msgs/CameraInfo.msg and distortion_models.hpp; OpenCV's calib3d
# (plumb_bob and rational_polynomial) and its fisheye (equidistant, Kannala and Brandt 2006).

_OF_OPENCV = (4, 5, 8, 12, 14)
_COUNTS = {PLUMB_BOB: _OF_OPENCV, RATIONAL: _OF_OPENCV, EQUIDISTANT: (4,)}
"""Numbers of D; image_geometry of ROS, too, passes those of both pinhole models on to OpenCV."""
_SAME_ROTATION = 1e-9
_LARGEST = 32767
_GRID = (64, 48)
_LARGER = 1.05
_NEARER = 0.3
_MORE_FILLED = 0.15
_FILLED = 0.9


def needs_rectifying(k: npt.ArrayLike, d: npt.ArrayLike, p: npt.ArrayLike) -> bool:
    """Return whether a camera's images are not rectified: False where D is 0 and K is that of P.

    K and D describe the images as they are, in the camera's frame; P the rectified ones. Where both
    are the same, there is nothing to rectify, whatever R is: bags of kitti2mcap and others that are
    made from pykitti have rectified images with R_rect in R.

    Args:
        k: (3, 3) or 9 numbers.
        d: Any count, also 0.
        p: (3, 4) or 12 numbers.
    """
    return bool(np.any(np.asarray(d, np.float64))) or not has_k_of_p(k, p)


def has_lens_of_larger_image(camera: CameraModel) -> bool:
    """Return whether K, D and R are of a larger image than the camera's, whose size and P agree.

    Such images are rectified already. kitti2bag writes sync drives so: K, D and R are those of the
    unrectified camera (1392 x 512), P and the size those of its rectified images (1242 x 375).
    Rectified once more, they would be displaced, and empty at the right and the bottom, where the
    larger image goes on. All of this must hold:

    - R is a turn, so it is a stereo calibration, which puts the principal point of P by itself.
    - An image with the principal point of K in its middle is larger by a twentieth, both ways.
    - The principal point of P is nearer to the middle of the camera's image: 0.3 times as far as
      that of K, at most.
    - The larger image fills the rectified one, by 0.9; the camera's image less of it, by 0.15.

    A cropped image, whose principal points are both aside, one with a region of interest or
    binning, whose K is brought to it, and one with empty margins on all sides (alpha = 1 of
    OpenCV's stereoRectify) do not meet them. Of random stereo calibrations whose principal points
    are aside by 3 % of the size (standard deviation) about 1 camera in 10 000 does, with 10 % 15.
    """
    size, k, p = np.array(camera.size), camera.k, camera.p[:, :3]
    larger = 2 * k[:2, 2]
    aside, aside_rect = (float(np.linalg.norm(m[:2, 2] - size / 2)) for m in (k, p))
    if (larger < _LARGER * size).any() or aside_rect > _NEARER * aside:
        return False
    if np.allclose(camera.r, np.eye(3), rtol=0, atol=_SAME_ROTATION):
        return False
    to_grid = np.diag([*(_GRID / size), 1.0])
    try:
        maps = _maps(replace(camera, size=_GRID, p=to_grid @ camera.p), fixed=False)
    except ValueError:  # an unknown lens
        return False
    pixels = np.stack(maps, axis=-1)
    filled, filled_by_larger = (
        float(((pixels >= 0) & (pixels <= edge - 1)).all(axis=-1).mean()) for edge in (size, larger)
    )
    return filled_by_larger >= max(_FILLED, filled + _MORE_FILLED)


class Rectifier:
    """Rectifies the images of a camera; the pixel maps are computed once.

    Args:
        camera: D has 4, 5, 8, 12 or 14 numbers of plumb_bob or rational_polynomial, or 4 of
            equidistant. None of the first two is no distortion.

    Raises:
        ValueError: The model is unknown, D has another count of numbers, K, R or P is invalid (all
            zero, as drivers send it for an uncalibrated camera), or the size is 0, beyond the limit
            of OpenCV (32767), or of more than MOST_PIXELS.
    """

    def __init__(self, camera: CameraModel) -> None:
        self._size = width, height = camera.size
        sides = 0 < width <= _LARGEST and 0 < height <= _LARGEST
        if not sides or width * height > MOST_PIXELS:
            raise ValueError(f'an image of {width} x {height} pixels')
        self._maps = _maps(camera)

    def apply(self, pixels: Pixels) -> Pixels:
        """Rectify an image; bilinear, same type, 0 outside of the camera's view.

        Source positions are accurate to 0.02 px: OpenCV rounds to 1/32 px.

        Args:
            pixels: (H, W) uint8 or uint16, or (H, W, 3) uint8, of the camera's size.

        Raises:
            ValueError: The image has another size.
        """
        height, width = pixels.shape[:2]
        if (width, height) != self._size:
            raise ValueError(
                f'an image of {width} x {height} pixels; its camera_info is of'
                f' {self._size[0]} x {self._size[1]}'
            )
        return remap(pixels, self._maps)


def remap(pixels: Pixels, maps: tuple[npt.NDArray[Any], npt.NDArray[Any]]) -> Pixels:
    """Move pixels by the two maps of cv2.remap; bilinear, same type, 0 outside of the image."""
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    moved = cv2.remap(
        pixels,
        *maps,
        interpolation=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    return np.asarray(moved, pixels.dtype)


def rectify_pixels(pixels: Float64Array, camera: CameraModel) -> Float64Array:
    """Return the positions of (N, 2) pixels of an unrectified image in the rectified one."""
    import cv2  # noqa: PLC0415 - as above

    undistort = (cv2.fisheye if camera.model == EQUIDISTANT else cv2).undistortPoints
    points = np.ascontiguousarray(pixels[:, None], dtype=np.float64)
    moved = undistort(points, camera.k, camera.d, R=camera.r, P=camera.p[:, :3])
    return np.asarray(moved[:, 0], np.float64)


def _invertible(name: str, matrix: Float64Array) -> Float64Array:
    """Return a (3, 3) matrix in contiguous memory, as OpenCV needs it.

    Raises:
        ValueError: It is singular or not finite.
    """
    numbers = np.ascontiguousarray(matrix)
    if not np.isfinite(numbers).all() or not np.linalg.det(numbers):
        raise ValueError(f'{name} is {numbers.tolist()}: the camera is not calibrated')
    return numbers


def _maps(camera: CameraModel, *, fixed: bool = True) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Compute the two maps of cv2.remap: (H, W, 2) whole pixels, (H, W) fractions.

    Without fixed they are (H, W) columns and (H, W) rows, float32.

    Raises:
        ValueError: As Rectifier.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    k, r = _invertible('K', camera.k), _invertible('R', camera.r)
    k_rect = _invertible('P', camera.p[:, :3])
    name = camera.model
    if name not in _COUNTS:
        raise ValueError(
            f'unknown distortion model {camera.model!r}; known are {", ".join(_COUNTS)}'
        )
    counts = _COUNTS[name]
    d = camera.d if camera.d.any() or name == EQUIDISTANT else np.zeros(counts[0])
    if len(d) not in counts:
        expected = ' or '.join(map(str, counts))
        raise ValueError(f'D has {len(camera.d)} numbers; {camera.model} has {expected}')
    lens = cv2.fisheye if name == EQUIDISTANT else cv2
    maps: tuple[npt.NDArray[Any], npt.NDArray[Any]] = lens.initUndistortRectifyMap(
        k, d, r, k_rect, camera.size, cv2.CV_16SC2 if fixed else cv2.CV_32FC1
    )
    return maps


# Positions of cameras by CameraInfo and static transforms, each baseline counted once.
#
# P projects points of header.frame_id after R. In the right camera of a stereo pair, P's fourth
# column is the baseline to the left one (sensor_msgs/CameraInfo.msg). The meaning of its
# header.frame_id differs from bag to bag, and is detected by the static tree:
#
# - the left camera's frame, or one at its position: P is right as it is. Points are rectified by
#   the left camera's R, for P is given in the pair's common rectified frame.
# - the right camera's own frame, a baseline away from the left one's: the tree has it, too.
# - a frame not connected to the left camera: the pair's frame is the left camera's.
#
# The difference of two cameras' fourth columns (KITTI's 2 and 3, from camera 0) is compared with
# the tree: if it is their distance there, the tree has both baselines.
#
# Many drivers and kitti2bag name frames that are already rectified (RViz and image_geometry apply
# no R). This is detected where the frames of two cameras are parallel and apart, and
#
# - their R differ: the tree includes R.
# - their baseline in the tree is that of P to 0.1 mm without R, and not with R.
#
# It is detected for a single camera, too, where D is 0 and K is that of P: K describes the images
# in the camera's frame, and P the rectified ones, so that frame is the rectified one, and its own.

_PARALLEL_RAD = 1e-5
_EXACT_M = 1e-4
_INEXACT_M = 1e-3
_ALIKE_RAD = np.radians(10)
_NO_BASELINE_M = 1e-3
_BASELINE_M = 0.02
_BASELINE_SHARE = 0.1
_PLAUSIBLE = 0.5
_PARALLEL = 'frames of cameras are parallel while their R differ'
_NO_LENS = 'D is 0 and K is that of P, so that R is applied neither to images nor to points'
_NO_LEFT = 'no left camera is there to compare with'
_SAME_BASELINE = 'the baseline in them is that of P where R is not applied'


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """The position of a camera, and its projection.

    Attributes:
        frame: A frame of the tree.
        cam_T_frame: That frame to the unrectified camera.
        p: (3, 4), projects points of the unrectified camera after R.
    """

    frame: str
    cam_T_frame: Transform
    p: Float64Array


def viewpoints(
    tree: FrameTree, cameras: Mapping[int, CameraModel], others: Iterable[CameraModel] = ()
) -> tuple[dict[int, Viewpoint], list[str]]:
    """Return the viewpoint of each camera, and notes on ambiguous ones, a line each.

    Args:
        tree: The static transforms.
        cameras: By KITTI index.
        others: Further cameras of the rig, to compare with; the same ones again are no harm.
    """
    rig = dict(cameras) | dict(enumerate(others, max(cameras, default=0) + 1))
    why = {index: _why_rectified(tree, index, rig) for index in rig}
    unturned = {
        index: replace(model, r=np.eye(3)) if why[index] else model for index, model in rig.items()
    }
    views, notes = {}, []
    for reason in (_NO_LENS, _PARALLEL, _SAME_BASELINE):
        frames = dict.fromkeys(cameras[camera].frame for camera in cameras if why[camera] == reason)
        if frames:
            notes.append(f'{", ".join(frames)}: taken as rectified frames, for {reason}')
    for index, model in sorted(cameras.items()):
        view, note = _viewpoint(tree, index, unturned, frozenset(cameras))
        if why[index] == _NO_LENS and note.endswith(_NO_LEFT):
            view, note = replace(view, p=_without_offset(model)), ''
        if why[index]:
            back = Transform(model.r.T.copy(), np.zeros(3))
            view = replace(view, cam_T_frame=back @ view.cam_T_frame)
        views[index] = view
        notes += [note] if note else []
    return views, notes


def angle_of(rotation: Float64Array) -> float:
    """Return the angle of a rotation, radians; also exact for small ones."""
    sine = np.linalg.norm(rotation - rotation.T) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))


def _why_rectified(tree: FrameTree, index: int, rig: Mapping[int, CameraModel]) -> str:
    """Return why the frame of a camera is a rectified one; empty if nothing shows it, or R is I."""
    model = rig[index]
    reason = ''
    if angle_of(model.r) <= _PARALLEL_RAD:
        return reason
    if model.is_as_rectified:
        return _NO_LENS
    for other in rig.values():
        pose = tree.find(model.frame, other.frame)
        if pose is None or _is_same(pose) or angle_of(pose.rotation) > _PARALLEL_RAD:
            continue
        if angle_of(model.r @ other.r.T) > _PARALLEL_RAD:
            return _PARALLEL
        baseline = model.offset - other.offset
        difference_m = float(np.linalg.norm(model.r @ pose.translation - baseline))
        if difference_m > _INEXACT_M and np.linalg.norm(pose.translation - baseline) < _EXACT_M:
            reason = _SAME_BASELINE
    return reason


def _viewpoint(
    tree: FrameTree, index: int, rig: Mapping[int, CameraModel], cameras: Collection[int]
) -> tuple[Viewpoint, str]:
    """Return the viewpoint of a camera, and a note where it is ambiguous.

    Args:
        tree: The static transforms.
        index: KITTI index of the camera.
        rig: All cameras.
        cameras: Those with a viewpoint: only one of them can be the left camera of a frame that
            no transform joins.
    """
    model = rig[index]
    offset = model.offset
    own = Viewpoint(model.frame, Transform.identity(), model.p)
    if np.linalg.norm(offset) < _NO_BASELINE_M:
        return own, ''
    around = [
        (rig[other], pose)
        for other in sorted(rig, key=lambda other: (other != LEFT_OF.get(index), other))
        for pose in [tree.find(model.frame, rig[other].frame)]
        if other != index and (pose is not None or other in cameras)
    ]
    lefts = [pair for pair in around if np.linalg.norm(pair[0].offset) < _NO_BASELINE_M]
    for left, pose in lefts:
        if pose is not None and _is_same(pose):
            return _beside(model, left), ''
    if lefts and all(pose is None for _, pose in lefts):
        return _beside(model, lefts[0][0]), ''
    if _has_both(model, around) or any(_agree(xyz, offset) for xyz in _positions(tree, model)):
        return replace(own, p=_without_offset(model)), ''
    if any(_agree(xyz, -offset) for xyz in _positions(tree, model)):
        return own, ''
    joined = [
        (left, model.r @ pose.translation)
        for left, pose in lefts
        if pose is not None and angle_of(pose.rotation) < _ALIKE_RAD
    ]
    return _doubtful(index, model, joined, own)


def _has_both(model: CameraModel, around: Iterable[tuple[CameraModel, Transform | None]]) -> bool:
    """Return whether the tree has the baseline of a camera and another one that P displaces."""
    return any(
        _agree(model.r @ pose.translation, model.offset - other.offset)
        for other, pose in around
        if pose is not None
        and angle_of(pose.rotation) < _ALIKE_RAD
        and np.linalg.norm(other.offset) >= _NO_BASELINE_M
    )


def _positions(tree: FrameTree, model: CameraModel) -> list[Float64Array]:
    """Return the positions of frames with the same view direction, in the rectified camera, m."""
    transforms = (tree.find(model.frame, frame) for frame in tree.frames)
    return [
        model.r @ pose.translation
        for pose in transforms
        if pose is not None and angle_of(pose.rotation) < _ALIKE_RAD
    ]


def _is_same(pose: Transform) -> bool:
    near = bool(np.linalg.norm(pose.translation) < _NO_BASELINE_M)
    return near and angle_of(pose.rotation) < _ALIKE_RAD


def _agree(position: Float64Array, offset: Float64Array) -> bool:
    """Return whether a frame is at the left camera's position by P, rather than the same."""
    error = np.linalg.norm(position - offset)
    limit = max(_BASELINE_M, _BASELINE_SHARE * float(np.linalg.norm(offset)))
    return bool(error <= limit and error < np.linalg.norm(position))


def _beside(model: CameraModel, left: CameraModel) -> Viewpoint:
    """Return the right camera of a pair, placed by P beside the left one, whose R is used."""
    cam_t_rect = Transform(model.r.T.copy(), np.zeros(3))
    rect_t_left = Transform(left.r, model.offset)
    return Viewpoint(left.frame, cam_t_rect @ rect_t_left, _without_offset(model))


def _without_offset(model: CameraModel) -> Float64Array:
    return np.column_stack([model.p[:, :3], np.zeros(3)])


def _doubtful(
    index: int,
    model: CameraModel,
    joined: list[tuple[CameraModel, Float64Array]],
    own: Viewpoint,
) -> tuple[Viewpoint, str]:
    """Decide where P and the tree disagree.

    If the baselines are similar, that of P is used, since a stereo calibration measured it; else P
    is applied to the camera's own frame.
    """
    baseline = float(np.linalg.norm(model.offset))
    note = f'camera {index}: P has a baseline of {baseline:.3f} m'
    if not joined:
        return own, f'{note}, taken as from {model.frame}: {_NO_LEFT}'
    left, position = min(joined, key=lambda pair: float(np.linalg.norm(pair[1] - model.offset)))
    note += (
        f' but {model.frame} is {np.linalg.norm(position):.3f} m from {left.frame} by the static'
        f' transforms'
    )
    if np.linalg.norm(position - model.offset) <= _PLAUSIBLE * baseline:
        return _beside(model, left), f'{note}; P is believed'
    return own, f'{note}; P is taken from {model.frame}'
