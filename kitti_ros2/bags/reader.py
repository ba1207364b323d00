# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of bags of any container: summaries, and messages in time order."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ..files.remote import real_place
from ..model.errors import UsageError
from .bag_files import BagSource, OpenBag, opened, path_of
from .message_source import BagMessages
from .reading import BagMessage
from .summary import BagIndex, BagSummary, TopicSummary, summarize

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..model.samples import Int64Array

__all__ = [
    'BagIndex',
    'BagMessage',
    'BagMessages',
    'BagSource',
    'BagSummary',
    'OpenBag',
    'TopicSummary',
    'bag_stamps',
    'index_bag',
    'open_messages',
    'opened',
    'path_of',
    'summarize_bag',
]

Bags: TypeAlias = BagSource | Sequence[BagSource]
"""An .mcap, .db3 or .bag file or a directory of rosbag2, or several of them; or opened ones."""


def summarize_bag(bags: Bags) -> BagSummary:
    """Summarize topics, counts, times, rates and gaps of bags, from their index if they have one.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    with ExitStack() as stack:
        found = [stack.enter_context(opened(bag)) for bag in _each_once(bags)]
        located = [bag.located for bag in found]
        containers = ', '.join(dict.fromkeys(bag.container for bag in located))
        files = tuple(file for bag in located for file in bag.files)
        return summarize(containers, files, index_bag(found))


def index_bag(bags: Bags) -> BagIndex:
    """Return the stamps of the messages of bags, and findings about damage.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    index = BagIndex()
    for each in _each_once(bags):
        with opened(each) as bag:
            index.merge(bag.index)
    return index


def bag_stamps(bags: Bags) -> dict[str, Int64Array]:
    """Return by topic the log times of its messages, (N,) int64 nanoseconds, ascending.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all.
        OSError: A file cannot be read.
    """
    return index_bag(bags).by_topic()


def open_messages(
    bags: Bags, topics: Collection[str] | None = None, *, must_read: bool = True
) -> BagMessages:
    """Open bags to read their messages; the result is a context manager, and an iterable.

    Args:
        bags: The bags to read; the messages of several are merged by time.
        topics: The topics to read; all of them by default.
        must_read: Whether a requested topic whose type has no definition, or two, is an error; else
            it is left out, as without topics.

    Raises:
        BadBagError: A path holds no bag, or one that cannot be read at all; bags disagree about a
            topic's type; or a requested topic cannot be read.
        UsageError: A path is given twice.
        OSError: A file cannot be read.
    """
    return BagMessages(_each_once(bags), topics, must_read=must_read)


def _each_once(bags: Bags) -> Sequence[BagSource]:
    if isinstance(bags, (Path, OpenBag)):
        return [bags]
    known: set[str] = set()
    for path in map(path_of, bags):
        place = real_place(path)
        if place in known:
            raise UsageError(f'{path}: is given twice; give each bag once')
        known.add(place)
    return bags
