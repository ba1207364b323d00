# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A page on disk: wholly there, or not at all."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ...bags.staging import Staging, keep_all, reported

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_BEGINNING = b'<!doctype html'


@contextmanager
def publish_page(out: Path, *, overwrite: bool) -> Iterator[Callable[[str], int]]:
    """A function that writes the page and returns its bytes; it is renamed to out at the end.

    Args:
        out: The file to make, with its folders.
        overwrite: Whether a page that is there may be replaced; nothing else ever is.

    Raises:
        OutputExistsError: There is something that may not be replaced.
        OutputError: It cannot be written; nothing is left behind.
    """
    staging = Staging(out, _keep_all_but_pages if overwrite else keep_all)

    def write(page: str) -> int:
        with reported(out):
            return staging.content.write_bytes(page.encode())

    try:
        yield write
        staging.publish()
    finally:
        staging.discard()


def _keep_all_but_pages(path: Path) -> str | None:
    """Why --overwrite does not replace what is there; None for a page."""
    if path.is_file():
        with path.open('rb') as file:
            if file.read(len(_BEGINNING)).lower() == _BEGINNING:
                return None
    return 'it is no HTML page, so --overwrite does not touch it; choose another name'
