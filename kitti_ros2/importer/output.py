# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Staging of a data set: built beside its folder, and moved there when complete."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..files.staging import Staging, reported

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def staged(out: Path) -> Iterator[Path]:
    """Yield a folder to build a data set in; its content is moved to out on success.

    Args:
        out: The data set's folder.

    Raises:
        OutputExistsError: out is not empty.
        OutputError: It cannot be written.
    """
    staging = Staging(out, _refuse_content)
    try:
        with reported(out):
            staging.content.mkdir()
            yield staging.content
        staging.publish()
    finally:
        staging.discard()


def _refuse_content(path: Path) -> str | None:
    if path.is_dir() and not any(path.iterdir()):
        return None
    return 'choose another name, or an empty folder'
