# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The marker of an output in a store whose upload was not completed, and its check by readers."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from ..model.errors import BadFileError
from .remote import is_remote

if TYPE_CHECKING:
    from pathlib import Path

    from .remote import RemotePath


def marker_of(path: RemotePath) -> RemotePath:
    """Return the marker of an output of several files."""
    return path.with_name(f'.{path.name}.partial')


def refuse_incomplete(path: Path) -> None:
    """Refuse to read an output whose upload was not completed, or what is in one.

    Args:
        path: A file or folder; local ones are not asked for.

    Raises:
        BadFileError: There is a marker.
    """
    if not is_remote(path) or path.scheme in {'http', 'https'}:
        return
    for folder in (path, *path.parents):
        if not folder.parent.name:
            return
        marker = marker_of(folder)
        if _is_there(marker):
            raise BadFileError(
                folder,
                'its upload was not completed',
                f'a complete output, without {marker}',
                remedy='run the command that writes it again, or remove the marker to read what'
                ' is there',
            )


def _is_there(marker: RemotePath) -> bool:
    from .store_objects import StoreError, object_at  # noqa: PLC0415 - for URLs only

    # A bucket that may be read but not listed answers 403 for what is absent.
    with suppress(StoreError):
        return object_at(marker) is not None
    return False
