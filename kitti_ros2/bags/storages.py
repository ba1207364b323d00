# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of each container; model/containers.py has all other facts about it.

Those of the container NAME are STORAGE in the module NAME_storage here. Each is imported when it is
asked for, and reader and writer when they are called: the libraries behind all of them take some
tenths of a second, and a run needs one or two.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .contract import SegmentContext, SegmentWriter
    from .findings import Findings
    from .pieces import BagFile, NamedFile


class Storage(NamedTuple):
    """Opens the files of a container.

    Attributes:
        read: Opens a file (file, findings) for reading.
        write: Makes a file and opens it for writing.
        write_errors: Exceptions of the writer's library, besides OSError, when the disk refuses.
    """

    read: Callable[[NamedFile, Findings], BagFile]
    write: Callable[[Path, SegmentContext], SegmentWriter]
    write_errors: tuple[type[Exception], ...] = ()


def storage_of(container: str) -> Storage:
    """Return the reader and the writer of a container, one of model.containers."""
    found: Storage = import_module(f'.{container}_storage', __package__).STORAGE
    return found
