# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of each container; model/containers.py has all other facts about it.

Each is imported when it is called: the libraries behind all of them take some tenths of a second,
and a run needs one or two.
"""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .contract import SegmentContext, SegmentWriter
    from .findings import Findings
    from .pieces import BagFile


class Storage(NamedTuple):
    """Opens the files of a container.

    Attributes:
        read: Opens a file (path, path to show, findings) for reading.
        write: Makes a file and opens it for writing.
        write_errors: Exceptions of the writer's library, besides OSError, when the disk refuses.
    """

    read: Callable[[Path, Path, Findings], BagFile]
    write: Callable[[Path, SegmentContext], SegmentWriter]
    write_errors: tuple[type[Exception], ...] = ()


def _read_mcap(path: Path, name: Path, findings: Findings) -> BagFile:
    from .mcap_file import McapFile  # noqa: PLC0415

    return McapFile(path, name, findings)


def _write_mcap(path: Path, context: SegmentContext) -> SegmentWriter:
    from .mcap_writer import McapSegment  # noqa: PLC0415

    return McapSegment(path, context)


def _read_sqlite(path: Path, name: Path, findings: Findings) -> BagFile:
    from .sqlite_file import SqliteFile  # noqa: PLC0415

    return SqliteFile(path, name, findings)


def _write_sqlite(path: Path, context: SegmentContext) -> SegmentWriter:
    from .sqlite_writer import SqliteSegment  # noqa: PLC0415

    return SqliteSegment(path, context)


def _read_ros1(path: Path, name: Path, findings: Findings) -> BagFile:
    from .ros1_file import Ros1File  # noqa: PLC0415

    return Ros1File(path, name, findings)


def _write_ros1(path: Path, context: SegmentContext) -> SegmentWriter:
    from .ros1_writer import Ros1Segment  # noqa: PLC0415

    return Ros1Segment(path, context)


STORAGES = {
    'mcap': Storage(_read_mcap, _write_mcap),
    'sqlite3': Storage(_read_sqlite, _write_sqlite, (sqlite3.Error,)),
    'ros1': Storage(_read_ros1, _write_ros1),
}
