# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The text files of a whole recording: read for its index, and once more for its description."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .store import STORE, decode_text

if TYPE_CHECKING:
    from pathlib import Path


class CommonFiles:
    """Files of a whole recording, each kept from the first reading until it is taken."""

    def __init__(self) -> None:
        self._known: dict[Path, bytes] = {}

    def read(self, path: Path) -> bytes:
        """Read a whole file and keep it.

        Raises:
            BadFileError, OSError: As STORE.read.
        """
        data = self._known.get(path)
        if data is None:
            data = self._known[path] = STORE.read(path)
        return data

    def read_text(self, path: Path) -> str:
        """Read a whole text file and keep it.

        Raises:
            BadFileError, OSError: As STORE.read_text.
        """
        return decode_text(self.read(path), path)

    def take_text(self, path: Path) -> str:
        """Read a whole text file; it is not kept any more.

        Raises:
            BadFileError, OSError: As STORE.read_text.
        """
        data = self._known.pop(path, None)
        return STORE.read_text(path) if data is None else decode_text(data, path)
