# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of ROS 1 .bag files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .storages import Storage

if TYPE_CHECKING:
    from pathlib import Path

    from .contract import SegmentContext, SegmentWriter
    from .findings import Findings
    from .pieces import BagFile, NamedFile


def _read(file: NamedFile, findings: Findings) -> BagFile:
    from .ros1_file import Ros1File  # noqa: PLC0415

    return Ros1File(file, findings)


def _write(path: Path, context: SegmentContext) -> SegmentWriter:
    from .ros1_writer import Ros1Segment  # noqa: PLC0415

    return Ros1Segment(path, context)


STORAGE = Storage(_read, _write)
