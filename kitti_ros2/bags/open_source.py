# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens what a user names as a source: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..kitti.layouts import open_recording
from ..model.errors import UsageError
from .bag_files import OpenBag
from .locate import looks_like_bag

if TYPE_CHECKING:
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..options.read import ReadOptions


def open_source(path: Path, options: ReadOptions) -> OpenBag | KittiRecording:
    """Open a bag, to be closed by the caller, or a KITTI folder.

    Args:
        path: A file or folder.
        options: Read options of a folder; with a layout the path is a KITTI folder.

    Raises:
        UsageError: There is no such path.
        KittiRos2Error: It cannot be read.
        OSError: The same.
    """
    if not path.exists():
        raise UsageError(f'{path}: no such file or folder; give a KITTI folder or a bag')
    if options.layout is None and looks_like_bag(path):
        return OpenBag(path)
    return open_recording(path, options)
