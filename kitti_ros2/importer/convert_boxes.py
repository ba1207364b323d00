# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with 3D boxes, or with label lines -> KITTI's labels."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..messages.detections import ABSURD, has_scores
from ..messages.solid_boxes import cuboids_in
from ..messages.source import LABEL_LINES, decode_text
from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.losses import Loss
from ..model.nominal import NOMINAL_CAM0_T_VELO
from .frames import topic_of
from .label_classes import LabelClasses, is_own
from .labels import OUT_OF_VIEW, TrackIds, boxes_of_lines, make_boxes, max_tilt
from .plan import UNKNOWN_OCCLUSION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..messages.camera_info import CameraModel
    from ..model.boxes import Box, Cuboid
    from ..rig.tf_tree import FrameTree
    from .calibration_source import Calibrations
    from .convert_images import ImageConversion
    from .plan import Plan
    from .survey import Survey

_REPORTED_TILT_RAD = np.radians(10)


class BoxConversion:
    """Converts the messages of a plan's labels, in order: tracks are numbered as they appear.

    Attributes:
        left_out: Number of boxes without a label so far, by reason.
    """

    def __init__(
        self,
        plan: Plan,
        survey: Survey,
        tree: FrameTree,
        models: Mapping[int, CameraModel],
        calibrations: Calibrations,
        images: ImageConversion,
    ) -> None:
        """Check the options of labels.

        Raises:
            UsageError: The plan names a missing topic, or its labels cannot be made.
        """
        self._plan = plan
        self._tree = tree
        self._models = models
        self._calibrations = calibrations
        self._images = images
        self.left_out: Counter[str] = Counter()
        self._max_tilt = 0.0
        self._tracks = TrackIds()
        self._scores = self._check(survey)
        labels = plan.labels
        self._classes = (
            None if labels is None else LabelClasses(labels, own=is_own(survey, labels.topic))
        )

    def _check(self, survey: Survey) -> bool:
        """Check the options of labels; return whether they have scores."""
        plan = self._plan.labels
        if plan is None:
            return False
        if self._plan.scan is None and not self._models and plan.topic != LABEL_LINES:
            raise UsageError('labels need a scan or a camera_info: their boxes are given in frames')
        if plan.topic == LABEL_LINES and plan.occluded != UNKNOWN_OCCLUSION:
            raise UsageError(
                f'labels.occluded is for boxes; the label lines of {plan.topic} have their own:'
                f' leave it at {UNKNOWN_OCCLUSION}'
            )
        calibration = self._calibrations.first
        if calibration is None:
            raise UsageError('labels need a calibration: set calibration of the plan, or --calib')
        if plan.camera not in calibration.cameras:
            raise UsageError(f'labels.camera is {plan.camera}, of which there is no calibration')
        return any(has_scores(look) for look in topic_of(survey, plan.topic).looks)

    @cached_property
    def _to_velo(self) -> dict[str, Transform]:
        """velo_T_frame of every frame connected to the scans' (or to the camera's) frame."""
        if self._plan.scan is not None:
            base, velo_t_base = self._plan.scan.frame, Transform.identity()
        else:
            base = self._models[min(self._models)].frame
            velo_t_base = NOMINAL_CAM0_T_VELO.inverse()
        joined = {base: velo_t_base}
        for frame in self._tree.frames:
            base_t_frame = self._tree.find(base, frame)
            if base_t_frame is not None:
                joined[frame] = velo_t_base @ base_t_frame
        return joined

    def boxes(self, message: Any, stamp_ns: int) -> list[Box]:  # noqa: ANN401 - of the bag's types
        """Make the labels of a frame.

        Raises:
            ValueError: They cannot be read.
        """
        plan, calibration = self._plan.labels, self._calibrations.at(stamp_ns)
        if plan is None or calibration is None:
            return []
        if plan.topic == LABEL_LINES:
            return self._lines(decode_text(message).text)
        size = self._images.size(plan.camera) or calibration.cameras[plan.camera].size
        if size is None:
            raise ValueError(f'the size of camera {plan.camera} is not known')
        cuboids, left_out = self.cuboids(message)
        if self._classes is not None:
            find = self._classes.find
            cuboids = [replace(each, class_name=find(each.class_name)) for each in cuboids]
        boxes, unseen = make_boxes(
            cuboids,
            calibration,
            plan.camera,
            size,
            self._tracks,
            out_of_view=plan.out_of_view,
            occluded=plan.occluded,
        )
        self.left_out.update(left_out)
        self.left_out[OUT_OF_VIEW] += unseen
        self._max_tilt = max(self._max_tilt, max_tilt(cuboids, calibration))
        return boxes

    def _lines(self, text: str) -> list[Box]:
        boxes = boxes_of_lines(text, self._tracks)
        if self._classes is None or not self._plan.labels or not self._plan.labels.classes:
            return boxes
        find = self._classes.find
        return [replace(each, class_name=find(each.class_name)) for each in boxes]

    def cuboids(self, message: Any) -> tuple[list[Cuboid], list[str]]:  # noqa: ANN401 - as boxes
        """Decode a message with 3D boxes to boxes in velo_link; also why others were skipped.

        Raises:
            ValueError: They cannot be read.
        """
        return cuboids_in(message, self._to_velo, scores=self._scores)

    def notes(self) -> list[str]:
        """Return non-fatal remarks on the boxes so far."""
        found = [
            f'{count} boxes {reason} were left out of the labels'
            for reason, count in self.left_out.items()
            if count and reason != ABSURD
        ]
        if self._max_tilt > _REPORTED_TILT_RAD:
            found.append(
                f"boxes lean by up to {np.degrees(self._max_tilt):.0f} degrees from the camera's y"
                f' axis, about which alone labels turn: their heading was kept'
            )
        return found if self._classes is None else [*found, *self._classes.notes()]

    def losses(self) -> tuple[Loss, ...]:
        """Return the boxes so far that a label cannot represent."""
        count, plan = self.left_out[ABSURD], self._plan.labels
        if not count or plan is None:
            return ()
        return (Loss(plan.topic, count, f'{plan.topic}: boxes {ABSURD} (NaN, 0 or beyond 100 km)'),)
