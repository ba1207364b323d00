# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a scan that a camera sees, by two rules that are in use.

- reference: reflectance > 0, depth >= 0, u and v rounded half to even, 0 < u < width,
  0 < v < height. The rule of the crop scripts for the object benchmark.
- reduced: 0.001 < depth < 100, 0 < u < width, 0 < v < height, any reflectance. The rule of
  velodyne_reduced in OpenPCDet and mmdetection3d.

Both project in float64 with the calibration of the scan's frame: P_i R0_rect Tr_velo_to_cam in
object and tracking, P_i Tr in odometry, P_rect_i R_rect_00 [R|T] in raw, and by K and D of the
camera in a raw extract. Width and height are those of the frame's own image in object, whose sizes
differ; elsewhere all images of a camera have one size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.image_size import image_size
from ..model.errors import MissingDataError
from ..options.crop import View

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..drawing.projection import Projection
    from ..kitti.recording import KittiRecording
    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from ..options.crop import CropOptions

DEFAULT_CAMERA = 2
_NEAREST_M, _FARTHEST_M = 0.001, 100.0


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera at one frame.

    Attributes:
        rule: Which points it sees.
        projection: Of velo_link into its images.
        size: (width, height) of these.
    """

    rule: View
    projection: Projection
    size: tuple[int, int]

    def sees(self, points: Float32Array, places: Float64Array) -> npt.NDArray[np.bool_]:
        """Return (N,) whether it sees each of (N, 4) points, whose places are (N, 3) float64."""
        seen = self.projection.homogeneous(places)
        depth, pixels = seen[:, 2], self.projection.pixels(seen)
        if self.rule is View.REFERENCE:
            near_enough = (points[:, 3] > 0) & (depth >= 0)
            pixels = np.rint(pixels)
        else:
            near_enough = (depth > _NEAREST_M) & (depth < _FARTHEST_M)
        inside = (pixels > 0) & (pixels < self.size)
        kept: npt.NDArray[np.bool_] = near_enough & inside[:, 0] & inside[:, 1]
        return kept


class CameraViews:
    """The view of a camera by frame.

    Args:
        recording: The recording of the frames.
        options: Options with a view.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions) -> None:
        self._recording = recording
        self._rule = options.view
        self._camera = DEFAULT_CAMERA if options.camera is None else options.camera
        self._size = options.image_size
        self._common = lru_cache(maxsize=1)(lambda: self._make(0))

    def at(self, number: int) -> CameraView | None:
        """Return the view at a frame, None if the options have none.

        Raises:
            MissingDataError: The calibration or the size of the images is missing.
        """
        if self._rule is None:
            return None
        of_frame = self._recording.layout.traits.calibration_per_frame
        return self._make(number) if of_frame else self._common()

    def _make(self, number: int) -> CameraView:
        from ..drawing.projection import Projection  # noqa: PLC0415 - cv2

        calibration = self._recording.calibration(number)
        try:
            projection = Projection.of(calibration, self._camera)
        except ValueError as error:
            parts = (f'P{self._camera}', 'R0_rect', 'Tr_velo_to_cam', 'file')
            known = [calibration.missing[part] for part in parts if part in calibration.missing]
            raise MissingDataError(
                known[0] if known else f'{self._recording.root}: {error}'
            ) from None
        return CameraView(self._rule or View.REDUCED, projection, self._size_at(number))

    def _size_at(self, number: int) -> tuple[int, int]:
        """Return the size of the images: that of the options, the calibration or an image."""
        if self._size is not None:
            return self._size
        return image_size(self._recording, self._camera, number, '--image-size')
