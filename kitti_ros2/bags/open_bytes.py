# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's file opened by position, on a disk or in a store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.remote import is_remote
from .pieces import FileBytes

if TYPE_CHECKING:
    from pathlib import Path

    from ..files.remote import RemotePath
    from .pieces import NamedFile


class RemoteFileBytes(FileBytes):
    """The bytes of a file in a store.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    waits = True

    def __init__(self, path: RemotePath, name: Path) -> None:
        from ..files.remote_bytes import RemoteBytes  # noqa: PLC0415 - for URLs only

        self.name = name
        self._bytes = RemoteBytes(path)
        self.size = self._bytes.size

    def read(self, position: int, length: int) -> bytes:
        """Read as FileBytes does."""
        return self._bytes.read(position, length)

    def expect(self, position: int, length: int) -> None:
        """Request bytes that will be read."""
        self._bytes.expect(position, length)

    def is_cut(self) -> bool:
        """Return false: objects are replaced, never truncated."""
        return False

    def close(self) -> None:
        """Do nothing: no connection is held."""


def open_bytes(file: NamedFile) -> FileBytes:
    """Open a file, on a disk or in a store.

    Raises:
        OSError, RemoteError: It cannot be opened.
    """
    if is_remote(file.path):
        return RemoteFileBytes(file.path, file.name)
    return FileBytes(file)
