# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan's calibration, applied to samples: points, images, boxes and poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model import msgtypes as types
from ..model.geometry import Transform
from ..model.labels import rect_from_velo
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..rig.tf_tree import FrameTree
from .calibration import rect_in_frame
from .calibration_source import camera_models, make_calibrations
from .convert_boxes import BoxConversion
from .convert_images import ImageConversion
from .convert_scans import ScanConversion
from .frames import topic_of
from .plan import TF
from .report import undecoded
from .scan_frame import made_frame

if TYPE_CHECKING:
    from ..model.losses import Loss
    from .plan import Plan
    from .survey import Survey


class Rigging:
    """The sensors of a plan in KITTI's frames.

    Attributes:
        calibrations: Of all frames.
        scans: Converts clouds.
        images: Converts images.
        labels: Converts boxes.
        imu_t_topic: By topic of the GPS/IMU unit: its frame in KITTI's imu frame.
    """

    def __init__(self, plan: Plan, survey: Survey) -> None:
        """Make the calibration.

        Raises:
            UsageError: The plan names a missing topic.
            MissingDataError: Required frames are not connected by static transforms.
            BadFileError: A calibration file cannot be read.
        """
        lost = next((undecoded(each).text() for each in survey.unreadable(*types.TF_TYPES)), '')
        tree = FrameTree(survey.static, survey.moving, lost)
        plan, made = made_frame(plan, tree)
        self._tree = FrameTree([*survey.static, *made], survey.moving, lost) if made else tree
        self._plan = plan
        self._models = camera_models(plan, survey)
        self.calibrations = make_calibrations(plan, survey, self._tree, self._models)
        self.scans = ScanConversion(plan.scan, survey, self._tree)
        self.images = ImageConversion(plan, survey, self._models)
        self._changing = [
            f'{camera.info} changes within the bag; the first that can be read counts'
            for camera in plan.cameras.values()
            if camera.info and topic_of(survey, camera.info).changes
        ]
        self.imu_t_topic = self._unit_transforms(survey)
        self.labels = BoxConversion(
            plan, survey, self._tree, self._models, self.calibrations, self.images
        )

    def _unit_transforms(self, survey: Survey) -> dict[str, Transform]:
        found = {}
        for topic in (self._plan.imu, self._plan.velocity):
            frame = topic_of(survey, topic).frame if topic else ''
            target = self._plan.imu_frame
            if frame and target and frame != target:
                found[topic] = self._tree.transform(target, frame)
        return found

    def body_t_rect(self) -> Transform:
        """Return body_T_rect: the rectified camera 0 in the body frame of the plan's poses.

        Without a camera it is at the nominal place of KITTI's camera on the scanner; without a
        scanner too, at the body's origin, looking ahead.

        Raises:
            MissingDataError: The static transforms do not connect the frames.
        """
        body = self._plan.pose.body if self._plan.pose is not None else ''
        if self._models and self._plan.calibration == TF:
            frame, frame_t_rect = rect_in_frame(self._tree, self._models)
            return self._tree.transform(body, frame) @ frame_t_rect
        if self._plan.scan is not None:
            velo_t_rect = NOMINAL_CAM0_T_VELO.inverse()
            if self.calibrations.first is not None:
                velo_t_rect = rect_from_velo(self.calibrations.first).inverse()
            return self._tree.transform(body, self._plan.scan.frame) @ velo_t_rect
        return Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))

    def notes(self) -> list[str]:
        """Return non-fatal remarks on the samples so far."""
        first = self.calibrations.first
        nominal = first.nominal if first is not None else ()
        found = [f'{part}: not in the bag, a nominal value is used' for part in nominal]
        found += [*self.scans.notes(), *self.images.notes(), *self.labels.notes()]
        return [*found, *self._changing, *self.calibrations.notes]

    def losses(self) -> tuple[Loss, ...]:
        """Return the parts of samples so far that could not be converted."""
        return (*self.scans.losses(), *self.labels.losses())
