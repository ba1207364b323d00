# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that boxes in the pixels of a camera may name."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..model import msgtypes as types
from .planned_topics import topic_of

if TYPE_CHECKING:
    from ..rig.tf_tree import FrameTree
    from .plan import CameraPlan
    from .survey import Survey

_SAME_PLACE_M = 1e-3
_CAMERA_TYPES = (types.IMAGE, types.COMPRESSED, types.CAMERA_INFO)


class PixelFrames:
    """The frames of a camera's images, and those at the same place, to be tested with `in`.

    A driver's camera_frame and camera_optical_frame are of one camera, turned (REP 103). Frames of
    other cameras are left out: those of one device may be at one place. Of the only camera, boxes
    without a frame are, too.
    """

    def __init__(self, survey: Survey, tree: FrameTree, camera: CameraPlan) -> None:
        """Take the frames of a camera in the tree of its bag.

        Raises:
            UsageError: The bag has no messages of the camera.
        """
        names = {topic_of(survey, name).frame for name in (camera.topic, camera.info) if name}
        self._named = {*names, camera.frame} - {''}
        every = {each.frame for kind in _CAMERA_TYPES for each in survey.of_type(kind)}
        self._others = every - self._named - {''}
        self._tree = tree

    def __contains__(self, frame: object) -> bool:
        if frame in self._named or not frame:
            return bool(frame) or not self._others
        if not isinstance(frame, str) or frame in self._others or frame not in self._tree.frames:
            return False
        return any(
            _is_same_place(self._tree, each, frame) for each in self._named & self._tree.frames
        )

    @cached_property
    def every(self) -> list[str]:
        """All of them that have a name, sorted."""
        return sorted(self._named | {frame for frame in self._tree.frames if frame in self})


def _is_same_place(tree: FrameTree, one: str, other: str) -> bool:
    place = tree.find(one, other)
    return place is not None and bool(np.linalg.norm(place.translation) < _SAME_PLACE_M)
