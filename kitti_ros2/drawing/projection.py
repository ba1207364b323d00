# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Projection of velo_link to the pixels of one camera, for all kinds of cameras.

- Rectified images: P_i R0_rect Tr_velo_to_cam.
- Independent cameras (Waymo): P_i cam_T_velo.
- Unrectified images (extract): K distort(X) with X = cam_T_cam0 cam0_T_velo x, by the camera's
  own K and D. Distortion: plumb bob, as OpenCV's calib3d defines it (k1 k2 p1 p2 k3).
- Cameras with a lens of their own (KITTI-360's fisheyes): K lens(cam_T_velo x).

Pixels are KITTI's: (0, 0) is the centre of the first one. Depth is along the optical axis,
metres; of a wide lens, which sees to the side and behind, it is the distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import NEAR_M
from ..model.geometry import Transform
from ..model.lenses import PlumbBob, at_depth_1
from ..model.samples import rect_from_velo

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.lenses import Lens
    from ..model.samples import Calibration, CameraCalibration

_PLUMB_BOB = 5
_SEGMENTS = 16
"""Number of straight segments of a line that the lens bends."""


@dataclass(frozen=True, eq=False)
class Projection:
    """Projection of velo_link points to pixels of a camera.

    Attributes:
        matrix: (3, 4) velo_link to homogeneous pixels; with a lens, to metres in the camera's own
            frame. The third row is along the optical axis either way.
        k: (3, 3) applied after the lens, None without one.
        lens: The lens; None for rectified images.
    """

    matrix: Float64Array
    k: Float64Array | None = None
    lens: Lens | None = None

    @classmethod
    def of(cls, calibration: Calibration, camera: int) -> Projection:
        """Return the projection into the images of a camera.

        Args:
            calibration: The rig.
            camera: KITTI camera index.

        Raises:
            ValueError: A required part of the calibration is missing.
        """
        intrinsics = calibration.cameras.get(camera)
        if intrinsics is None:
            calibrated = ', '.join(map(str, sorted(calibration.cameras))) or 'none'
            raise ValueError(f'no calibration of camera {camera} (there is: {calibrated})')
        if intrinsics.cam_T_velo is not None and intrinsics.lens is not None:
            matrix = _finite(intrinsics.cam_T_velo.matrix()[:3], camera)
            return cls(matrix, intrinsics.p_rect[:, :3], intrinsics.lens)
        if intrinsics.cam_T_velo is not None:
            return cls(_finite(intrinsics.p_rect @ intrinsics.cam_T_velo.matrix(), camera))
        if calibration.cam0_T_velo is None:
            raise ValueError('the calibration does not tell where the scanner is (Tr_velo_to_cam)')
        if not calibration.rectified:
            return _unrectified(intrinsics, camera, calibration.cam0_T_velo)
        if calibration.r0_rect is None:
            raise ValueError('the calibration has no rectifying rotation (R0_rect)')
        return cls(_finite(intrinsics.p_rect @ rect_from_velo(calibration).matrix(), camera))

    def resized(self, scale_x: float, scale_y: float) -> Projection:
        """Return the projection into the same images, resized; image edges map to image edges."""
        shift_x, shift_y = (scale_x - 1) / 2, (scale_y - 1) / 2
        resize = np.array([[scale_x, 0, shift_x], [0, scale_y, shift_y], [0, 0, 1]])
        if self.k is not None:
            return replace(self, k=resize @ self.k)
        return replace(self, matrix=resize @ self.matrix)

    def homogeneous(self, points: npt.ArrayLike) -> Float64Array:
        """Transform (..., 3) points in velo_link to the input of pixels(); lines stay lines."""
        positions = np.ascontiguousarray(points, np.float64)
        if not positions.size:
            return np.zeros_like(positions)
        import cv2  # noqa: PLC0415 - 0.1 s that a rig without points does not need

        # Not @: for so thin a matrix the threads of a BLAS spend more time waiting than computing.
        seen = cv2.transform(positions.reshape(-1, 1, 3), self.matrix)
        return np.asarray(seen, np.float64).reshape(positions.shape)

    def depth(self, seen: Float64Array) -> Float64Array:
        """Return (...,) depths of (..., 3) homogeneous points, metres; see the module."""
        is_wide = self.lens is not None and self.lens.is_wide
        return np.linalg.norm(seen, axis=-1) if is_wide else np.asarray(seen[..., 2])

    def pixels(self, seen: Float64Array) -> Float64Array:
        """Return (..., 2) pixels, u and v, of homogeneous points; NaN for invisible ones.

        These are behind the camera, or so far to the side that the lens would fold them back.
        """
        with np.errstate(invalid='ignore', divide='ignore', over='ignore'):
            if self.k is None or self.lens is None:
                return at_depth_1(seen)
            return np.asarray(self.lens.bent(seen) @ self.k[:2, :2].T + self.k[:2, 2], np.float64)

    def points(self, pixels: Float64Array, depth: Float64Array) -> Float64Array:
        """Return the (N, 3) points in velo_link at (N, 2) pixels and (N,) depths, metres."""
        if self.k is None or self.lens is None:
            rays = np.column_stack([pixels, np.ones(len(pixels))])
        else:
            rays = self.lens.rays((pixels - self.k[:2, 2]) @ np.linalg.inv(self.k[:2, :2]).T)
        seen = rays * depth[:, None]
        points: Float64Array = np.linalg.solve(self.matrix[:, :3], (seen - self.matrix[:, 3]).T).T
        return points

    def segments(self, ends: Float64Array) -> tuple[Float64Array, npt.NDArray[np.intp]]:
        """Project straight lines, clipped just in front of a camera without a wide lens.

        Args:
            ends: (M, 2, 3) in velo_link, metres.

        Returns:
            (K, 2, 2) segments in pixels, not clipped to an image; (K,) the line of each.
        """
        seen, lines = self.homogeneous(ends), np.arange(len(ends))
        if self.lens is None or not self.lens.is_wide:
            seen, lines = _clip_near(seen)
        if self.lens is not None:
            steps = np.linspace(0.0, 1.0, _SEGMENTS + 1)[:, None]
            along = seen[:, :1] + steps * (seen[:, 1:] - seen[:, :1])
            seen = np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2, 3)
            lines = np.repeat(lines, _SEGMENTS)
        pixels = self.pixels(seen)
        finite = np.isfinite(pixels).all(axis=(1, 2))
        return pixels[finite], lines[finite]


def _clip_near(seen: Float64Array) -> tuple[Float64Array, npt.NDArray[np.intp]]:
    """Return (K, 2, 3) parts of (M, 2, 3) lines in front of the camera, and the line of each."""
    lines = np.flatnonzero(
        (seen[..., 2] >= NEAR_M).any(axis=1) & np.isfinite(seen).all(axis=(1, 2))
    )
    seen = seen[lines]
    depth = seen[..., 2]
    fall = depth[:, ::-1] - depth
    share = np.where(depth < NEAR_M, (NEAR_M - depth) / np.where(fall, fall, 1.0), 0.0)
    return seen + share[..., None] * (seen[:, ::-1] - seen), lines


def _unrectified(camera: CameraCalibration, index: int, cam0_t_velo: Transform) -> Projection:
    """Return the projection of a camera with unrectified images."""
    if camera.k is None or camera.d is None or len(camera.d) != _PLUMB_BOB:
        raise ValueError(
            f'the calibration has no K and D of camera {index}, which is not rectified'
        )
    if camera.cam_T_cam0 is None and index != 0:
        raise ValueError(
            f'the calibration has no R and T of camera {index}, which is not rectified'
        )
    cam_t_cam0 = camera.cam_T_cam0 or Transform.identity()
    matrix = (cam_t_cam0 @ cam0_t_velo).matrix()[:3]
    lens = PlumbBob(_finite(camera.d, index))
    return Projection(_finite(matrix, index), _finite(camera.k, index), lens)


def _finite(values: Float64Array, camera: int) -> Float64Array:
    """Check the values of a calibration: drivers send zeros for a camera without one."""
    if not np.isfinite(values).all() or (values.ndim == 2 and not values[:, :3].any(axis=1).all()):
        raise ValueError(f'the calibration of camera {camera} is empty or not of finite numbers')
    return np.ascontiguousarray(values, np.float64)
