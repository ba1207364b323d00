# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Images of fisheyes as a pinhole camera sees them, for consumers without their model.

ROS has no distortion_model for a fisheye of the MEI model, so image_geometry, image_proc and RViz
cannot project into its image. The view has the camera's optical frame, and a CameraInfo of
plumb_bob without distortion, R the identity.

Its focal length is that of the fisheye in the middle of the image, so a pixel there is a pixel.
Off the axis a pinhole magnifies: in KITTI-360's fisheyes by 1.2 at 20 degrees, 1.6 at 40 and 2.0
at 50, across the axis. So no detail is lost or aliased, and a wider view would be but larger. Sides
are multiples of 16, as video encoders need them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..model.samples import MOST_PIXELS
from .rectified_cameras import remap

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration
    from .images import Pixels

_WIDTH_DEG = 100
_MULTIPLE = 16


class PinholeView:
    """The view of a fisheye; its map of pixels is computed once.

    Args:
        calibration: Contains the fisheye.
        index: KITTI camera index.

    Attributes:
        calibration: The same with the view as the camera.
        size: (width, height).

    Raises:
        ValueError: The camera has no lens of its own, or one of impossible numbers.
    """

    def __init__(self, calibration: Calibration, index: int) -> None:
        import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

        camera = calibration.cameras[index]
        if camera.lens is None or camera.size is None:
            raise ValueError('a camera without a lens of its own has no pinhole view')
        self._source_size = camera.size
        k = camera.p_rect[:, :3]
        focal = max(k[0, 0], k[1, 1]) * camera.lens.scale
        self.size, p = _pinhole(focal, camera.size)
        bent = camera.lens.bent(_rays(self.size, p))
        # Rays that the lens does not see come from outside of the image.
        sources = np.nan_to_num(bent @ k[:2, :2].T + k[:2, 2], nan=-1e4).astype(np.float32)
        self._maps = cv2.convertMaps(sources[..., 0], sources[..., 1], cv2.CV_16SC2)
        view = replace(camera, p_rect=p, size=self.size, lens=None)
        self.calibration = replace(calibration, cameras={**calibration.cameras, index: view})

    def of(self, pixels: Pixels) -> Pixels:
        """Make the view of an image; bilinear, same type.

        Raises:
            ValueError: The image is not of the size that the fisheye is calibrated for.
        """
        size = pixels.shape[1], pixels.shape[0]
        if size != self._source_size:
            raise ValueError(
                'an image of {}x{} pixels; the fisheye is calibrated for {}x{}'.format(
                    *size, *self._source_size
                )
            )
        return remap(pixels, self._maps)


pinhole_view = lru_cache(maxsize=4)(PinholeView)  # 6 MB each


def _pinhole(focal: float, source_size: tuple[int, int]) -> tuple[tuple[int, int], Float64Array]:
    """Return (width, height) and P of a view in the shape of the fisheye's image.

    Raises:
        ValueError: It has no or too many pixels.
    """
    across = 2 * focal * np.tan(np.radians(_WIDTH_DEG / 2))
    sides = np.rint(across * np.array(source_size) / source_size[0] / _MULTIPLE) * _MULTIPLE
    if not (sides.min() > 0 and sides.prod() <= MOST_PIXELS):
        raise ValueError(f'a fisheye of {focal:g} pixels of focal length has no pinhole view')
    (width, height), (u, v) = sides.astype(int).tolist(), (sides - 1) / 2
    return (width, height), np.array([[focal, 0, u, 0], [0, focal, v, 0], [0, 0, 1.0, 0]])


def _rays(size: tuple[int, int], p: Float64Array) -> Float64Array:
    """Return (H, W, 3) the rays of all pixels of a pinhole, of depth 1."""
    columns, rows = np.meshgrid(*map(np.arange, size))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    rays: Float64Array = pixels @ np.linalg.inv(p[:, :3]).T
    return rays
