# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Finds what there is to check at a path: data sets with their recordings, and bags."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..bags.locate import METADATA
from ..bags.search import bags_among, is_bag_name
from ..kitti.find import absolute
from ..kitti.layouts import data_sets_at, not_of_layout
from ..kitti.nearby import data_sets_below, explain
from ..kitti.store import STORE
from ..model.containers import CONTAINERS
from ..model.errors import naming

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ..kitti.nearby import DataSet
    from ..model.errors import KittiRos2Error
    from ..options.read import ReadOptions


class Found(NamedTuple):
    """What there is at a path.

    Attributes:
        data_sets: Folders with recordings.
        bags: Files and folders.
        complete: Whether all folders below were searched.
    """

    data_sets: list[DataSet]
    bags: list[Path]
    complete: bool = True


def find_sources(path: Path, options: ReadOptions) -> Found:
    """Find the data sets and bags at a path, or below a folder that is none itself.

    Args:
        path: A KITTI folder, a folder of several, a bag, or a folder of bags.
        options: A layout and a sequence, if only those are to be checked.

    Raises:
        KittiRos2Error: There is nothing to check; or the layout is ambiguous.
        OSError: The folder cannot be read.
    """
    if not path.is_dir():
        if path.is_file() and _is_bag_file(path):  # opening a pipe would wait
            return Found([], [path])
        raise _explain_file(path) if path.is_file() else explain(path)
    if (path / METADATA).is_file():
        return Found([], [path])
    data_sets = [each._replace(folder=absolute(path)) for each in data_sets_at(path, options)]
    bags = list(_bags_in(path)) if options.layout is None else []
    if options.layout is not None and not data_sets:
        raise not_of_layout(path, options.layout)
    if data_sets:
        return Found(data_sets, bags)
    below, complete = data_sets_below(path)
    if not below and not bags:
        raise explain(path)
    return Found(below, bags, complete)


def _explain_file(path: Path) -> KittiRos2Error:
    from ..bags.mistaken import explain_file  # noqa: PLC0415 - readers of bags, for errors only

    return explain_file(path)


def _is_bag_file(path: Path) -> bool:
    with naming(path), path.open('rb') as file:
        head = file.read(16)
    known = any(head.startswith(each.magic) for each in CONTAINERS.values())
    return known or is_bag_name(path)


def _bags_in(folder: Path) -> Iterator[Path]:
    """Yield the bags in a folder: files of their own, and rosbag2 directories."""
    names = STORE.names(folder)
    yield from (each for each in bags_among(folder, names) if each == folder or each.is_file())
    for name in names:
        if (folder / name / METADATA).is_file():
            yield folder / name
