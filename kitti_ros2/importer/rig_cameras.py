# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras of a bag beside those of a plan: what frames and P mean shows in all of them.

A plan may take one camera of a pair, and each of camera_sets takes one camera.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..messages.camera_info import camera_model
from .camera_geometry import find_heading, with_frames
from .camera_topics import find_cameras
from .optical_frames import optical_link

if TYPE_CHECKING:
    from ..messages.camera_info import CameraModel
    from ..rig.tf_tree import Link
    from .plan import Plan
    from .survey import Survey


def other_cameras(plan: Plan, survey: Survey) -> tuple[list[CameraModel], list[Link]]:
    """Return the models of the other cameras of a bag, and links to the frames made for them.

    They have the frames that a guessed plan gives them. Cameras that are not calibrated are left
    out.
    """
    tree = survey.tree
    rig = find_cameras(survey)
    heading = find_heading(tree, None if plan.scan is None else plan.scan.frame, rig)
    taken = {camera.info for camera in plan.cameras.values()}
    models: list[CameraModel] = []
    links: dict[str, Link] = {}
    for each in with_frames(rig, tree, heading, []):
        if each.info is None or each.info.name in taken or not each.info.looks:
            continue
        try:
            model = camera_model(each.info.looks[0])
        except ValueError:  # of a plan's camera it is an error
            continue
        models.append(replace(model, frame=each.frame))
        if each.forward:
            links[each.frame] = optical_link(each.bag_frame, each.forward)
    return models, list(links.values())
