# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that boxes in the pixels of a camera may name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model import msgtypes as types

if TYPE_CHECKING:
    from ..rig.tf_tree import FrameTree
    from .plan import CameraPlan
    from .survey import Survey

_SAME_PLACE_M = 1e-3
_CAMERA_TYPES = (types.IMAGE, types.COMPRESSED, types.CAMERA_INFO)


def pixel_frames(survey: Survey, tree: FrameTree, camera: CameraPlan) -> set[str]:
    """Return the frames of a camera's images, and those at the same place.

    A driver's camera_frame and camera_optical_frame are of one camera, turned (REP 103). Frames of
    other cameras are left out: those of one device may be at one place. Of the only camera, boxes
    without a frame are, too.
    """
    names = {survey.topics[name].frame for name in (camera.topic, camera.info) if name}
    own = {*names, camera.frame} - {''}
    every = {each.frame for kind in _CAMERA_TYPES for each in survey.of_type(kind)}
    others = every - own - {''}
    near = {
        frame
        for frame in tree.frames - others
        if any(_is_same_place(tree, each, frame) for each in own & tree.frames)
    }
    return own | near | ({''} if not others else set())


def _is_same_place(tree: FrameTree, one: str, other: str) -> bool:
    place = tree.find(one, other)
    return place is not None and bool(np.linalg.norm(place.translation) < _SAME_PLACE_M)
