# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Depth maps of scans that were made from depth images: each point in its pixel of a camera.

As the sparse maps of KITTI's depth benchmark (velodyne_raw) they are the projections of the points,
the nearest where several fall in a pixel. Where the depth image is registered to the camera's
images, each pixel gets its own depth back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.png.encode import encode_png
from ..model.labels import rect_from_velo

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..kitti.writer import LayoutWriter
    from ..model.samples import Calibration, Float32Array
    from .apply_calibration import Rigging
    from .plan import Plan

_PER_M = 256.0
_DEEPEST = 65535


class DepthMaps:
    """Writes the depth maps of a recording; thread-safe.

    Attributes:
        folders: Of the maps, by camera; none unless the scans are of depth images.
    """

    def __init__(
        self, plan: Plan, rigging: Rigging, writer: LayoutWriter, *, unrectified: bool
    ) -> None:
        wanted = rigging.scans.are_depth and not unrectified and rigging.calibrations.values
        self._unrectified = rigging.scans.are_depth and unrectified
        self._writer = writer
        self.folders = {
            camera: writer.depth_folder(camera)
            for camera in sorted(plan.cameras)
            if wanted and writer.depth_folder(camera) and rigging.images.size(camera)
        }

    def write(self, number: int, stamp_ns: int, points: Float32Array, rigging: Rigging) -> None:
        """Write the maps of a scan, (N, 4) in velo_link, by the rigging of its frame."""
        calibration = rigging.calibrations.at(stamp_ns)
        for camera in self.folders:
            size = rigging.images.size(camera)
            if calibration is not None and size is not None:
                pixels = make_depth_map(points, calibration, camera, size)
                self._writer.write_depth(camera, number, encode_png(pixels))

    def notes(self) -> list[str]:
        """Return what was written, or why nothing was."""
        if self._unrectified:
            return ['no depth maps were written: the images of an extract are not rectified']
        return [
            f'{folder}: depth maps of camera {camera}, 16-bit PNG, metres * 256'
            for camera, folder in self.folders.items()
        ]


def make_depth_map(
    points: Float32Array, calibration: Calibration, camera: int, size: tuple[int, int]
) -> npt.NDArray[np.uint16]:
    """Return (H, W) depth times 256, metres, along the axis of a rectified camera; 0 without one.

    Args:
        points: (N, 4) x y z reflectance in velo_link.
        calibration: Contains the camera and the place of the scanner.
        camera: KITTI index.
        size: (width, height) of its rectified image.
    """
    model = calibration.cameras[camera]
    seen = rect_from_velo(calibration) if model.cam_T_velo is None else model.cam_T_velo
    places = seen.apply(points[:, :3].astype(np.float64))
    u, v, depth = (np.column_stack([places, np.ones(len(places))]) @ model.p_rect.T).T
    ahead = depth > 0
    column, row = (np.round(each[ahead] / depth[ahead]) for each in (u, v))
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    value = np.clip(np.round(depth[ahead][inside] * _PER_M), 1, _DEEPEST).astype(np.uint16)
    # The last write to a pixel stays: the nearest.
    order = np.argsort(-value.astype(np.int64), kind='stable')
    found = np.zeros((size[1], size[0]), dtype=np.uint16)
    places_in = row[inside].astype(np.intp)[order], column[inside].astype(np.intp)[order]
    found[places_in] = value[order]
    return found
