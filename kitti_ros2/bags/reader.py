# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of bags of any container: summaries, and messages in time order."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ..model.errors import UsageError
from .bag_files import index_files
from .locate import locate_bag, reindex_advice
from .message_source import BagMessage, BagMessages, LeftOut
from .summary import BagIndex, BagSummary, TopicSummary, summarize

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..model.samples import Int64Array
    from .locate import BagFiles

__all__ = [
    'BagIndex',
    'BagMessage',
    'BagMessages',
    'BagSummary',
    'LeftOut',
    'TopicSummary',
    'bag_stamps',
    'index_bag',
    'open_messages',
    'summarize_bag',
]

Bags: TypeAlias = Path | Sequence[Path]
"""An .mcap, .db3 or .bag file or a directory of rosbag2, or several of them."""


def summarize_bag(paths: Bags) -> BagSummary:
    """Summarize topics, counts, times, rates and gaps of bags, from their index if they have one.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    bags = _locate(paths)
    index = index_bag(paths)
    containers = ', '.join(dict.fromkeys(bag.container for bag in bags))
    return summarize(containers, tuple(file for bag in bags for file in bag.files), index)


def index_bag(paths: Bags) -> BagIndex:
    """Return the stamps of the messages of bags, and warnings about damage.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    bags = _locate(paths)
    index = BagIndex()
    for bag in bags:
        found = index_files(bag)
        if bag.message_count is not None and bag.message_count != found.total:
            found.warnings.append(
                f'{bag.path}: metadata.yaml counts {bag.message_count} messages,'
                f' the files hold {found.total}; {reindex_advice(bag.path, bag.files)}'
            )
        index.merge(found)
    return index


def bag_stamps(paths: Bags) -> dict[str, Int64Array]:
    """Return by topic the log times of its messages, (N,) int64 nanoseconds, ascending.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    return index_bag(paths).by_topic()


def open_messages(paths: Bags, topics: Collection[str] | None = None) -> BagMessages:
    """Open bags to read their messages; the result is a context manager, and an iterable.

    Args:
        paths: The bags to read; the messages of several are merged by time.
        topics: The topics to read; all of them by default.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all; bags disagree about a
            topic's type; or the type of a requested topic has no definition, or two.
        UsageError: A path is given twice.
        OSError: A file cannot be read.
    """
    return BagMessages(_locate(paths), topics)


def _locate(paths: Bags) -> list[BagFiles]:
    if isinstance(paths, Path):
        return [locate_bag(paths)]
    known: set[str] = set()
    for path in paths:
        place = os.path.realpath(path)
        if place in known:
            raise UsageError(f'{path}: is given twice; give each bag once')
        known.add(place)
    return [locate_bag(path) for path in paths]
