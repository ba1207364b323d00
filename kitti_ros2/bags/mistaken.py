# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Explains paths that are no source: a bag in place of a KITTI folder, the reverse, or neither."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..model.containers import ANY_BAG
from ..model.errors import (
    AmbiguousLayoutError,
    BadBagError,
    KittiRos2Error,
    NotABagError,
    NotKittiError,
    Remedy,
    UsageError,
)
from .bag_files import OpenBag
from .locate import METADATA, locate_bag, looks_like_bag

if TYPE_CHECKING:
    from pathlib import Path

    from .locate import BagFiles

_QUICKLY_READ_BYTES = 1 << 30


def explain_no_folder(path: Path, error: NotKittiError, *, forced: bool) -> KittiRos2Error:
    """Return the error for a path that holds no recording, where a KITTI folder is needed.

    Args:
        path: The path.
        error: The error of the readers.
        forced: Whether a layout was requested.
    """
    bag = _find_bag(path)
    if bag is None or (error.remedies and not _has_bag_alone(path)):
        return error
    return _is_bag(bag, forced=forced)


def explain_no_bag(path: Path, error: NotABagError) -> KittiRos2Error:
    """Return the error for a path that holds no bag, where a bag is needed."""
    if not path.exists() or _is_metadata(path):
        near = explain_file(path)
        return near if near.remedies else error
    from ..kitti.layouts import guess_layout  # noqa: PLC0415 - for errors only

    try:
        kind = f'layout {guess_layout(path).value}'
    except AmbiguousLayoutError:
        kind = 'several layouts'
    except NotKittiError as near:
        if not near.explained:
            return error
        if not near.remedies or any(each.before for each in near.remedies):  # archives
            return near
        remedies = (replace(each, command='to-bag') for each in near.remedies)
        return UsageError(f'{near} to to-bag').with_remedies(*remedies)
    found = f'{path}: is a KITTI folder ({kind}), not a bag; convert it to a bag'
    return UsageError(found).with_remedies(Remedy(path, path, command='to-bag'))


def explain_file(path: Path) -> KittiRos2Error:
    """Return the error for a file that is no bag."""
    if _is_metadata(path):
        found = f'{path}: describes the bag {path.parent}; give that folder'
        return UsageError(found).with_remedies(Remedy(path, path.parent))
    from ..kitti.nearby import explain  # noqa: PLC0415 - for errors only

    near = explain(path)
    if near.explained:
        return near
    return BadBagError(path, 'is a file of another kind', f'a KITTI folder, {ANY_BAG}')


def _is_metadata(path: Path) -> bool:
    return path.name == METADATA and looks_like_bag(path.parent)


def _has_bag_alone(path: Path) -> bool:
    """Whether a path is a file or a rosbag2 directory, not a folder that also holds bags."""
    return path.is_file() or (path / METADATA).is_file()


def _find_bag(path: Path) -> BagFiles | None:
    if not looks_like_bag(path):
        return None
    try:
        return locate_bag(path)
    except (BadBagError, OSError):
        return None


def _is_bag(bag: BagFiles, *, forced: bool) -> UsageError:
    """Return the error for a bag in place of a KITTI folder."""
    path = bag.path
    found = f'{path}: is a bag ({bag.container}), not a KITTI folder'
    if forced:
        return UsageError(f'{found}; leave --layout out')
    commands, advice = ['play', 'to-kitti'], 'play it, or convert it to KITTI'
    if _is_damaged(bag):
        commands.append('recover')
        advice = 'play it, convert it to KITTI, or repair it, as it is damaged'
    remedies = (Remedy(path, path, command=command) for command in commands)
    return UsageError(f'{found}; {advice}').with_remedies(*remedies)


def _is_damaged(bag: BagFiles) -> bool:
    """Whether a bag is damaged, as far as a short look can tell."""
    if bag.losses or sum(file.stat().st_size for file in bag.files) > _QUICKLY_READ_BYTES:
        return bool(bag.losses)
    try:
        with OpenBag(bag.path) as opened:
            return not opened.index.complete
    except (BadBagError, OSError):
        return True
