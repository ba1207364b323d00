# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes a page atomically: completely or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.replacing import keep_all, keep_all_but_files
from ..files.staging import Staging, staged_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_KEEP_ALL_BUT_PAGES = keep_all_but_files('HTML page', [b'<!doctype html'])


def check_output(out: Path, *, overwrite: bool) -> None:
    """Check beforehand whether a page can be written; leaves nothing behind.

    Raises:
        OutputExistsError: The path exists and must not be replaced.
        OutputError: The page cannot be written.
    """
    Staging(out, _refusal(overwrite=overwrite)).discard()


def write_page(out: Path, page: str, *, overwrite: bool) -> int:
    """Write a page to a temporary file and rename it; return its size in bytes.

    Args:
        out: The file to write; missing folders are created.
        page: Its text.
        overwrite: Whether an existing page may be replaced; other files never are.

    Raises:
        OutputExistsError: The path exists and must not be replaced.
        OutputError: The page cannot be written; nothing is left behind.
    """
    with staged_file(out, _refusal(overwrite=overwrite)) as path:
        return path.write_bytes(page.encode())


def _refusal(*, overwrite: bool) -> Callable[[Path], str | None]:
    return _KEEP_ALL_BUT_PAGES if overwrite else keep_all
