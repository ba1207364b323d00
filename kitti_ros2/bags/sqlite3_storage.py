# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of rosbag2's SQLite files."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING

from .storages import Storage

if TYPE_CHECKING:
    from pathlib import Path

    from .contract import SegmentContext, SegmentWriter
    from .findings import Findings
    from .pieces import BagFile, NamedFile


def _read(file: NamedFile, findings: Findings) -> BagFile:
    from .sqlite_file import SqliteFile  # noqa: PLC0415

    return SqliteFile(file, findings)


def _write(path: Path, context: SegmentContext) -> SegmentWriter:
    from .sqlite_writer import SqliteSegment  # noqa: PLC0415

    return SqliteSegment(path, context)


STORAGE = Storage(_read, _write, (sqlite3.Error,))
