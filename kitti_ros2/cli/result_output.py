# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where and how a command that checks, counts or scores puts its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class ResultOutput:
    """Where and how a result is put.

    Attributes:
        out: What -o names, None without it: a file, or with --all the folder of outputs.
        overwrite: Whether existing files may be replaced.
        json: Whether to print JSON instead of text.
        quiet: Print only errors and losses.
    """

    out: Path | None
    overwrite: bool
    json: bool
    quiet: bool

    def refuse_files(self) -> None:
        """Refuse -o and --overwrite of a command that writes files with --all only.

        Raises:
            UsageError: One is given.
        """
        if self.out is not None or self.overwrite:
            raise UsageError('-o and --overwrite are for whole collections; give --all too')
