# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files and folders that a recording is read from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.layouts import Layout
from ..options.read import ReadOptions
from .layouts import open_recording
from .recording_tree import calibration_beside, tree_of

if TYPE_CHECKING:
    from pathlib import Path


def parts_of(source: Path, layout: Layout, sequence: str | None) -> list[Path]:
    """Return the files and folders of a recording.

    Args:
        source: Its folder.
        layout: Its layout.
        sequence: Its name among those of the folder; None for the only one.

    Raises:
        KittiRos2Error: It cannot be opened.
    """
    if layout is Layout.RAW and sequence is None:  # to open it reads stamps and tracklets: 4 ms
        return [source, *calibration_beside(source)]
    recording = open_recording(source, ReadOptions(layout=layout, sequence=sequence))
    return [path for path, _ in tree_of(recording).parts]
