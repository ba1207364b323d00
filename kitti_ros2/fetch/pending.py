# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Complete files that get their names together, once all of them are on the disk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.durability import sync_files, sync_folders

if TYPE_CHECKING:
    from pathlib import Path

_MOST_FILES = 256
_MOST_BYTES = 256 * 2**20


class PendingFiles:
    """Files that are complete under other names.

    To sync files one by one takes the disk a hundred times as long as to sync them together.

    Args:
        root: The folder that they are below.
        fsync: Whether they outlast a power cut.
    """

    def __init__(self, root: Path, *, fsync: bool) -> None:
        self._root = root
        self._fsync = fsync
        self._parts: dict[Path, Path] = {}
        self._size_bytes = 0
        self._folders: set[Path] = set()

    def __contains__(self, target: Path) -> bool:
        """Whether a file is waiting for its name."""
        return target in self._parts

    def add(self, part: Path, target: Path, size: int) -> None:
        """Let a complete file get its name soon.

        Raises:
            OSError: The disk refuses; the file that it is about has no name.
        """
        self._parts[target] = part
        self._size_bytes += size
        most = _MOST_FILES if self._fsync else 1
        if len(self._parts) >= most or self._size_bytes >= _MOST_BYTES:
            self.publish()

    def note(self, target: Path) -> None:
        """Note that a file has its name already, perhaps not on the disk yet."""
        self._folders.add(target.parent)

    def publish(self) -> None:
        """Give all files their names.

        Raises:
            OSError: The disk refuses; the files that are left have no name.
        """
        if self._fsync:
            sync_files([*self._parts.values()])
        for target in [*self._parts]:
            self._parts[target].replace(target)
            self._folders.add(target.parent)
            del self._parts[target]
        self._size_bytes = 0

    def settle(self) -> None:
        """Give all files their names, and wait until these are on the disk.

        Raises:
            OSError: The disk refuses.
        """
        self.publish()
        if self._fsync:
            folders = {each for folder in self._folders for each in (folder, *folder.parents)}
            sync_folders(each for each in folders if self._root in (each, *each.parents))
        self._folders.clear()

    def drop(self) -> None:
        """Remove the files that have no name."""
        for part in self._parts.values():
            part.unlink(missing_ok=True)
        self._parts.clear()
