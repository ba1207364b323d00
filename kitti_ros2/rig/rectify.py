# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rectification of images by sensor_msgs/CameraInfo.

A point X of the camera's frame is seen at the pixel K distort(X) of the original image, and at the
pixel P[:, :3] R X of the rectified one. P's fourth column moves the origin of the frame, not the
pixels. Sources: sensor_msgs/CameraInfo.msg and distortion_models.hpp; OpenCV's calib3d
(plumb_bob and rational_polynomial) and its fisheye (equidistant, Kannala and Brandt 2006).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..messages.camera_info import EQUIDISTANT, PLUMB_BOB, RATIONAL
from ..messages.pixels import MOST_PIXELS

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..messages.camera_info import CameraModel
    from ..messages.pixels import Pixels
    from ..model.geometry import Float64Array

_OF_OPENCV = (4, 5, 8, 12, 14)
_COUNTS = {PLUMB_BOB: _OF_OPENCV, RATIONAL: _OF_OPENCV, EQUIDISTANT: (4,)}
"""Numbers of D; image_geometry of ROS, too, passes those of both pinhole models on to OpenCV."""
_SAME_ROTATION = 1e-9
_SAME_PIXEL = 1e-6
_LARGEST = 32767


def needs_rectifying(
    k: npt.ArrayLike, d: npt.ArrayLike, r: npt.ArrayLike, p: npt.ArrayLike
) -> bool:
    """Whether a camera's images are not rectified: False where D is 0, R is I and P has K.

    Args:
        k: (3, 3) or 9 numbers.
        d: Any count, also 0.
        r: (3, 3) or 9 numbers.
        p: (3, 4) or 12 numbers.
    """
    if np.any(np.asarray(d, np.float64)):
        return True
    k_rect = np.reshape(p, (3, 4))[:, :3]
    turned = not np.allclose(np.reshape(r, (3, 3)), np.eye(3), rtol=0, atol=_SAME_ROTATION)
    return turned or not np.allclose(np.reshape(k, (3, 3)), k_rect, rtol=0, atol=_SAME_PIXEL)


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


def _maps(camera: CameraModel) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint16]]:
    """Compute the two maps of cv2.remap: (H, W, 2) whole pixels, (H, W) fractions.

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
    maps: tuple[npt.NDArray[np.int16], npt.NDArray[np.uint16]] = lens.initUndistortRectifyMap(
        k, d, r, k_rect, camera.size, cv2.CV_16SC2
    )
    return maps
