# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of cameras; the reference of a right camera's offset differs between bags."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..rig.stereo import viewpoints

if TYPE_CHECKING:
    from ..messages.camera_info import CameraModel
    from ..rig.stereo import Viewpoint
    from .program_survey import ProgramSurvey


class CameraRig:
    """The cameras of a recording, each with the model of its last CameraInfo."""

    def __init__(self, survey: ProgramSurvey) -> None:
        self._tree = survey.tree()
        self._models = dict(survey.cameras)

    def place(self, topic: str, model: CameraModel) -> Viewpoint:
        """Set the model of a CameraInfo topic, and return the camera's viewpoint."""
        self._models[topic] = model
        # Sorted by name, a left camera precedes its right one.
        numbers = {name: number for number, name in enumerate(sorted(self._models))}
        models = {numbers[name]: each for name, each in self._models.items()}
        return viewpoints(self._tree, models)[0][numbers[topic]]
