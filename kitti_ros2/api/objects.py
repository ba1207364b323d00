# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A labelled object of a frame, in any coordinate frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import cuboid_corners
from ..model.errors import MissingDataError
from ..model.geometry import rotation_to_rpy

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..drawing.objects import LabelledObject
    from ..model.boxes import Box, Cuboid
    from ..model.geometry import Float64Array


class FrameObject:
    """One labelled object.

    Attributes:
        class_name: Car, Van, Truck, Pedestrian, Person_sitting, Cyclist, Tram, Misc, DontCare, or
            a word of the data set's own.
        box_2d: left, top, right, bottom in pixels of camera 2; None without one (tracklets).
        alpha: Observation angle, radians; None without one.
        truncated: 0..1 (tracking: 0, 1, 2), None if unknown.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown; None without a value.
        track: Identity across frames, None without one.
        score: Of a detection, None for ground truth.
        label: The line of the label file, None for tracklets and objects of other bags.
    """

    def __init__(
        self,
        found: LabelledObject,
        label: Box | None,
        transform: Callable[[str | int, str | int], Float64Array],
    ) -> None:
        self._cuboid = found.cuboid
        self._transform = transform
        self.class_name = found.class_name
        self.box_2d = found.box_2d
        self.alpha = None if label is None or label.alpha < -np.pi - 1 else label.alpha
        self.truncated = found.truncated
        self.occluded = found.occluded
        if found.cuboid is not None and found.occluded is None:
            self.occluded = found.cuboid.occluded
        self.track = found.track_id
        self.score = found.score
        self.label = label

    @property
    def has_box(self) -> bool:
        """Whether it has a 3D box; DontCare regions and 2D detections have none."""
        return self._cuboid is not None

    @property
    def box(self) -> Float64Array:
        """(7,) float64 in velo_link: centre x y z, length, width, height in metres, yaw in radians.

        The form of OpenPCDet and mmdetection3d: the centre is the middle of the box, and the yaw is
        about z, 0 along x. The box may be tilted against velo_link by about a degree, see pose.

        Raises:
            MissingDataError: It has no 3D box.
        """
        cuboid = self._need()
        _, _, yaw = rotation_to_rpy(cuboid.velo_T_box.rotation)
        return np.array([*cuboid.velo_T_box.translation, *cuboid.size_lwh, yaw])

    def pose(self, frame: str | int = 'velo_link') -> Float64Array:
        """Return frame_T_box, (4, 4): the middle of the box, x along its heading, y left, z up.

        Args:
            frame: As in Frame.transform.

        Raises:
            MissingDataError: It has no 3D box, or the transform is missing.
        """
        box = self._need().velo_T_box.matrix()
        if frame == 'velo_link':
            return box
        moved: Float64Array = self._transform(frame, 'velo_link') @ box
        return moved

    def corners(self, frame: str | int = 'velo_link') -> Float64Array:
        """Return the corners of the 3D box, (8, 3) metres.

        The bottom face first, then the top face; each from front left, front right, rear right to
        rear left, seen along the heading.

        Args:
            frame: As in Frame.transform.

        Raises:
            MissingDataError: It has no 3D box, or the transform is missing.
        """
        corners: Float64Array = cuboid_corners([self._need()])[0]
        if frame == 'velo_link':
            return corners
        matrix = self._transform(frame, 'velo_link')
        moved: Float64Array = corners @ matrix[:3, :3].T + matrix[:3, 3]
        return moved

    def _need(self) -> Cuboid:
        if self._cuboid is None:
            raise MissingDataError(
                f'{self.class_name}: no 3D box: it is a 2D region, or the calibration is missing'
            )
        return self._cuboid

    def __repr__(self) -> str:
        track = '' if self.track is None else f' {self.track}'
        return f'<kitti_ros2.FrameObject {self.class_name}{track}>'
