# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Optical frames of cameras whose own frame has x forward and z up.

A CameraInfo is for an optical frame, z forward, x right, y down (REP 103, sensor_msgs/CameraInfo).
Simulators and exporters often name the body of the camera; the optical frame is one more static
link then, so that calibration, labels and poses agree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.geometry import Transform
from ..rig.heading import AXES
from .planned_topics import topic_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..rig.tf_tree import Link
    from .plan import CameraPlan, Plan
    from .survey import Survey

X_FORWARD = 'x'
"""The value of forward of a camera whose frame has x forward, y left, z up."""

LINK_T_OPTICAL = Transform(AXES['z'].T.copy(), np.zeros(3))
"""The optical frame in such a frame."""


def optical_name(frame: str, forward: str) -> str:
    """Return the name of the optical frame of a camera's frame: itself, or the made one."""
    return f'{frame} with {forward} forward, optical' if forward else frame


def frame_of(camera: CameraPlan, survey: Survey) -> str:
    """Return the frame that a camera of a plan has in the bag.

    Raises:
        UsageError: The plan names a missing topic.
    """
    return camera.frame or topic_of(survey, camera.info).frame


def optical_link(frame: str, forward: str) -> Link:
    """Return the link from a frame with x forward to its optical frame."""
    return frame, optical_name(frame, forward), LINK_T_OPTICAL


def made_optical_frames(plan: Plan, survey: Survey) -> list[Link]:
    """Return the links to the optical frames that a plan has made.

    Raises:
        UsageError: The plan names a missing topic.
    """
    cameras: Iterable[CameraPlan] = plan.cameras.values()
    frames = {frame_of(each, survey) for each in cameras if each.forward and each.info}
    return [optical_link(frame, X_FORWARD) for frame in sorted(frames)]
