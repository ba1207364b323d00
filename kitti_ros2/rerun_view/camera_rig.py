# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where cameras stand. What a right camera's offset is taken from differs from bag to bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..rig.stereo import viewpoints

if TYPE_CHECKING:
    from ..rig.camera_info import CameraModel
    from ..rig.stereo import Viewpoint
    from .program_survey import ProgramSurvey


class CameraRig:
    """The cameras of a recording, each as its last CameraInfo has it."""

    def __init__(self, survey: ProgramSurvey) -> None:
        self._tree = survey.tree()
        self._models = dict(survey.cameras)

    def place(self, topic: str, model: CameraModel) -> Viewpoint:
        """Where the camera of a CameraInfo topic stands, from now on with this model."""
        self._models[topic] = model
        # In the order of their names a left camera comes right before its right one.
        numbers = {name: number for number, name in enumerate(sorted(self._models))}
        models = {numbers[name]: each for name, each in self._models.items()}
        return viewpoints(self._tree, models)[0][numbers[topic]]
