# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Data sets that --overwrite may replace: those of one recording, without files of others."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..files.remote import is_remote
from ..files.store_objects import objects_at
from ..model.text import format_count
from . import names
from .layout_files import LAYOUTS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection
    from pathlib import PurePath

_ENDINGS = (names.BIN, names.TXT, names.LABEL, '.xml')


def keep_all_but_data_sets(recordings: int) -> Callable[[Path], str | None]:
    """Return a refusal for Staging that lets only a data set of KITTI be replaced.

    Args:
        recordings: Number of recordings that replace it: a data set of more is kept.
    """

    def refusal(path: Path) -> str | None:
        found = max(len(files.find(path)) for files in LAYOUTS.values()) if path.is_dir() else 0
        if not found or not _is_plain(path):
            return 'it is no KITTI data set, so --overwrite does not touch it; choose another name'
        if found > recordings:
            return (
                f'it holds {format_count(found, "recording")}, and --overwrite would remove all of'
                f' them; choose another name'
            )
        return None

    return refusal


def keep_all_but_camera_sets(folders: Collection[str]) -> Callable[[Path], str | None]:
    """Return a refusal for Staging that lets the sets of --all-cameras be replaced.

    Args:
        folders: The folders of the sets that replace them; a data set of one recording may be
            replaced, too.
    """
    keep = keep_all_but_data_sets(1)

    def refusal(path: Path) -> str | None:
        if not path.is_dir() or not _is_plain(path):
            return keep(path)
        found = {entry.name for entry in path.iterdir()} - {names.IMAGE_SETS}
        if not found or not found <= set(folders):
            return keep(path)
        return next(filter(None, (keep(path / name) for name in sorted(found))), None)

    return refusal


def _is_plain(folder: Path) -> bool:
    """Whether a folder holds files of KITTI's endings at their places only, and no links."""
    if is_remote(folder):
        return all(map(_is_of_data_set, map(PurePosixPath, objects_at(folder))))
    for root, folders, files in os.walk(folder):
        if not all(_is_of_data_set(Path(root, name).relative_to(folder)) for name in files):
            return False
        if any(Path(root, name).is_symlink() for name in (*folders, *files)):
            return False
    return True


def _is_of_data_set(path: PurePath) -> bool:
    """Whether a data set has such a file, by its path in the folder; images are a camera's."""
    suffix = path.suffix.lower()
    if suffix in names.IMAGE_SUFFIXES:
        return any(part.startswith('image_') for part in path.parts[:-1])
    return suffix in _ENDINGS
