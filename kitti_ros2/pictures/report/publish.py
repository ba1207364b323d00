# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A page on disk: wholly there, or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...bags.staging import Staging, keep_all, reported

if TYPE_CHECKING:
    from pathlib import Path

_BEGINNING = b'<!doctype html'


def check_output(out: Path, *, overwrite: bool) -> None:
    """Find out before the work whether a page can be written; nothing is left behind.

    Raises:
        OutputExistsError: There is something that may not be replaced.
        OutputError: It cannot be written.
    """
    _stage(out, overwrite=overwrite).discard()


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
    staging = _stage(out, overwrite=overwrite)
    try:
        with reported(out):
            size = staging.content.write_bytes(page.encode())
        staging.publish()
    finally:
        staging.discard()
    return size


def _stage(out: Path, *, overwrite: bool) -> Staging:
    return Staging(out, _keep_all_but_pages if overwrite else keep_all)


def _keep_all_but_pages(path: Path) -> str | None:
    """Why --overwrite does not replace what is there; None for a page."""
    if path.is_file():
        with path.open('rb') as file:
            if file.read(len(_BEGINNING)).lower() == _BEGINNING:
                return None
    return 'it is no HTML page, so --overwrite does not touch it; choose another name'
