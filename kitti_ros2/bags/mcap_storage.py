# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of MCAP files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .storages import Storage

if TYPE_CHECKING:
    from pathlib import Path

    from .contract import SegmentContext, SegmentWriter
    from .findings import Findings
    from .pieces import BagFile, NamedFile


def _read(file: NamedFile, findings: Findings) -> BagFile:
    from .mcap_file import McapFile  # noqa: PLC0415

    return McapFile(file, findings)


def _write(path: Path, context: SegmentContext) -> SegmentWriter:
    from .mcap_writer import McapSegment  # noqa: PLC0415

    return McapSegment(path, context)


STORAGE = Storage(_read, _write)
