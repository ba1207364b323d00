# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions of frames, compared with labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..drawing.objects import compared, objects_of
from ..model.errors import KittiRos2Error, describe_error
from ..model.least_overlaps import KITTI_OVERLAPS, LeastOverlaps
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..model.samples import FrameLabels
    from .frame import FrameData

_NAME = Stream.PREDICTIONS.value


@dataclass(frozen=True)
class Predictions:
    """The predictions of one recording.

    Attributes:
        read: Returns the predictions of a frame, such as ResultFiles.read; raises KittiRos2Error
            or OSError if they cannot be read.
        overlaps: The IoU above which a prediction is a true positive.
    """

    read: Callable[[int], FrameLabels]
    overlaps: LeastOverlaps = KITTI_OVERLAPS

    def add_to(self, frame: FrameData) -> FrameData:
        """Return the frame with its predictions, compared with its labels if it has any.

        Bad lines are in its missing.
        """
        try:
            found = self.read(frame.number)
        except (KittiRos2Error, OSError) as error:
            return replace(frame, missing={**frame.missing, _NAME: describe_error(error)})
        missing = {f'{_NAME} {row}': reason for row, reason in found.missing.items()}
        predictions = objects_of(found, frame.calibration)
        objects = frame.objects
        if frame.labelled:
            objects, predictions = compared(objects, predictions, self.overlaps)
        return replace(
            frame,
            objects=objects,
            predictions=predictions,
            missing={**frame.missing, **missing},
        )
