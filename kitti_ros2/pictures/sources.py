# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Open what pictures are made of: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..bags.locate import is_bag
from ..kitti.layouts import open_recording
from .bag_frames import BagFrames
from .recording_frames import RecordingFrames

if TYPE_CHECKING:
    from pathlib import Path

    from ..options import ReadOptions
    from .frame import FrameSource


def open_frames(path: Path, options: ReadOptions) -> FrameSource:
    """The frames of a KITTI folder, or of a bag.

    Raises:
        UsageError: There is no such path.
        KittiRos2Error: It cannot be read, or has nothing to look at.
    """
    if is_bag(path, options.layout):
        return BagFrames(path)
    return RecordingFrames(open_recording(path, options))
