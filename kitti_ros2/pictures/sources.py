# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Open what pictures are made of: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..bags.locate import looks_like_bag
from ..errors import UsageError
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
    if not path.exists():
        raise UsageError(f'{path}: no such file or folder; give a KITTI folder or a bag')
    if options.layout is None and looks_like_bag(path):
        return BagFrames(path)
    return RecordingFrames(open_recording(path, options))
