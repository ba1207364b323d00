# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The bags in a folder, by the names of its files; none is opened."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from ..model.containers import CONTAINERS
from .locate import METADATA

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

_GLOBS = tuple(glob for each in CONTAINERS.values() for glob in each.globs)
_ENDINGS = tuple(glob.removeprefix('*') for glob in _GLOBS)


def is_bag_name(path: Path) -> bool:
    """Whether a file has the name of a bag of any container."""
    return any(path.match(glob) for glob in _GLOBS)


def stem_of(path: Path) -> str:
    """Return the name of a bag without the ending of its container."""
    for ending in _ENDINGS:
        if path.name.endswith(ending) and path.name != ending:
            return path.name.removesuffix(ending)
    return path.name


def bags_among(folder: Path, names: Iterable[str]) -> list[Path]:
    """Return the bags in a folder, in the order of their names.

    Files named FOLDER_N are one bag, which is the folder: a ROS 1 bag that was split, or a rosbag2
    directory whose metadata.yaml is missing.

    Args:
        folder: A folder.
        names: Names of its files.
    """
    if METADATA in names:
        return [folder]
    files = [folder / name for name in sorted(names) if is_bag_name(folder / name)]
    part = re.compile(rf'{re.escape(folder.name)}_\d+\.')
    if files and all(part.match(each.name) for each in files):
        return [folder]
    return files
