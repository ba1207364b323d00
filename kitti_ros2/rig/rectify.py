# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rectification of images by sensor_msgs/CameraInfo.

A point X of the camera's frame is seen at the pixel K distort(X) of the original image, and at the
pixel P[:, :3] R X of the rectified one. P's fourth column moves the origin of the frame, not the
pixels. Sources: sensor_msgs/CameraInfo.msg and distortion_models.hpp; OpenCV's calib3d
(plumb_bob and rational_polynomial) and its fisheye (equidistant, Kannala and Brandt 2006).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.camera_info import EQUIDISTANT, PLUMB_BOB, RATIONAL, has_k_of_p
from ..model.samples import MOST_PIXELS

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..messages.camera_info import CameraModel
    from ..messages.pixels import Pixels
    from ..model.geometry import Float64Array

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
    """Whether a camera's images are not rectified: False where D is 0 and K is that of P.

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
    """Whether K, D and R are of a larger image than the camera's, whose size and P fit each other.

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
    places = np.stack(maps, axis=-1)
    filled, filled_by_larger = (
        float(((places >= 0) & (places <= each - 1)).all(axis=-1).mean()) for each in (size, larger)
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
        import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

        height, width = pixels.shape[:2]
        if (width, height) != self._size:
            raise ValueError(
                f'an image of {width} x {height} pixels; its camera_info is of'
                f' {self._size[0]} x {self._size[1]}'
            )
        rectified = cv2.remap(
            pixels,
            *self._maps,
            interpolation=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
        return np.asarray(rectified, pixels.dtype)


def rectify_pixels(pixels: Float64Array, camera: CameraModel) -> Float64Array:
    """Return the places of (N, 2) pixels of an unrectified image in the rectified one."""
    import cv2  # noqa: PLC0415 - as above

    undistort = (cv2.fisheye if camera.model == EQUIDISTANT else cv2).undistortPoints
    places = np.ascontiguousarray(pixels[:, None], dtype=np.float64)
    moved = undistort(places, camera.k, camera.d, R=camera.r, P=camera.p[:, :3])
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
