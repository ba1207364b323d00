# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A page on disk: wholly there, or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.staging import Staging, keep_all, keep_all_but_files, staged_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_KEEP_ALL_BUT_PAGES = keep_all_but_files('HTML page', [b'<!doctype html'])


def check_output(out: Path, *, overwrite: bool) -> None:
    """Find out before the work whether a page can be written; nothing is left behind.

    Raises:
        OutputExistsError: There is something that may not be replaced.
        OutputError: It cannot be written.
    """
    Staging(out, _refusal(overwrite=overwrite)).discard()


def write_page(out: Path, page: str, *, overwrite: bool) -> int:
    """Write a page beside its place and rename it there; returns its bytes.

    Args:
        out: The file to make, with its folders.
        page: Its text.
        overwrite: Whether a page that is there may be replaced; nothing else ever is.

    Raises:
        OutputExistsError: There is something that may not be replaced.
        OutputError: It cannot be written; nothing is left behind.
    """
    with staged_file(out, _refusal(overwrite=overwrite)) as path:
        return path.write_bytes(page.encode())


def _refusal(*, overwrite: bool) -> Callable[[Path], str | None]:
    return _KEEP_ALL_BUT_PAGES if overwrite else keep_all
