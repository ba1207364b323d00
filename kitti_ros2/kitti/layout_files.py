# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of each layout, and names of its text files.

What else differs between layouts is in LayoutTraits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..model.layouts import Layout
from ..model.streams import Stream
from . import names
from .find import find_object, find_odometry, find_raw, find_tracking
from .write_object import ObjectWriter
from .write_odometry import OdometryWriter
from .write_raw import RawWriter
from .write_tracking import TrackingWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from .find import Candidate
    from .write_object import WriteOptions
    from .writer import LayoutWriter


@dataclass(frozen=True)
class LayoutFiles:
    """The reader and the writer of a layout, and names of text files.

    Attributes:
        find: Lists the recordings at a path.
        write: Makes a writer below a root folder for a recording of a name.
        line_folders: By line stream (see LayoutTraits) the folder of its text file, or the name of
            the file without suffix.
        stamps: Name of the text file with the stamps of a stream, beside the stream's folder; empty
            in a layout without time.
    """

    find: Callable[[Path], list[Candidate]]
    write: Callable[[Path, str, WriteOptions | None], LayoutWriter]
    line_folders: Mapping[Stream, str] = field(default_factory=dict)
    stamps: str = ''


LAYOUTS = {
    Layout.RAW: LayoutFiles(
        find_raw,
        lambda root, name, _: RawWriter(root, *names.parse_drive(name)),
        stamps=names.TIMESTAMPS,
    ),
    Layout.OBJECT: LayoutFiles(find_object, ObjectWriter),
    Layout.ODOMETRY: LayoutFiles(
        find_odometry,
        lambda root, name, _: OdometryWriter(root, names.parse_sequence(name)),
        {Stream.POSE: names.POSES},
        stamps=names.TIMES,
    ),
    Layout.TRACKING: LayoutFiles(
        find_tracking,
        lambda root, name, _: TrackingWriter(root, names.parse_sequence(name)),
        {
            Stream.OXTS: names.OXTS,
            Stream.POSE: names.OXTS,
            Stream.LABELS: names.TRACKING_LABELS,
        },
    ),
}


def make_writer(
    layout: Layout, root: Path, name: str, options: WriteOptions | None = None
) -> LayoutWriter:
    """Make the writer of a layout, for a recording of a name; the options are for object sets.

    Raises:
        UsageError: The layout has no such name.
    """
    return LAYOUTS[layout].write(root, name, options)
