# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of numbered files, and validation of the paths in a bag."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..kitti.names import split_name
from ..model.errors import BadBagError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..kitti.names import FileNames
    from ..model.streams import Stream

_SHOWN = 80


@dataclass(frozen=True)
class Folder:
    """The folder of a stream's numbered files.

    Attributes:
        path: Relative to the recording's root.
        names: How they are named.
        numbers: File numbers of the recording, ascending.
        carried: Those of them that were written to the bag, ascending.
    """

    path: PurePosixPath
    names: FileNames
    numbers: tuple[int, ...]
    carried: tuple[int, ...]

    def file(self, number: int) -> PurePosixPath:
        """Return the path of the file with a number."""
        return self.path / self.names.name(number)

    def has(self, number: int) -> bool:
        """Whether the recording has a file of this number."""
        place = bisect_left(self.numbers, number)
        return self.numbers[place : place + 1] == (number,)


def owner_of(path: PurePosixPath, folders: Mapping[Stream, Folder]) -> tuple[Stream, int] | None:
    """Return the stream and number of a numbered file; None if it is not in the recording."""
    for stream, folder in folders.items():
        if path.parent != folder.path:
            continue
        number = folder.names.number(split_name(path.name)[0])
        if number is not None and folder.has(number) and path == folder.file(number):
            return stream, number
    return None


def inside(name: str, bag: Path) -> PurePosixPath:
    """Validate a relative path in a bag.

    Raises:
        BadBagError: It would be outside of the output.
    """
    if not is_inside(name):
        found = f'names a file {shown(name)}, which would lie outside of the output'
        raise BadBagError(bag, found, 'paths within the recording')
    return PurePosixPath(name)


def shown(name: str) -> str:
    """Format a name for errors."""
    return repr(name if len(name) <= _SHOWN else f'{name[:_SHOWN]}...')


def is_inside(name: str) -> bool:
    """Whether a name is a relative path that stays below its root."""
    path = PurePosixPath(name)
    return not (path.is_absolute() or '..' in path.parts or not path.parts or '\0' in name)
