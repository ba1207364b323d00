# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Read any bag: what is in it at a glance, and its messages in time order."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import zstandard

from kitti_ros2.errors import BadBagError

from .bag_index import mcap_index, ros1_index, sqlite_index
from .locate import BagFiles, locate_bag
from .message_source import BagMessage, BagMessages
from .summary import BagIndex, BagSummary, TopicSummary, summarize

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from kitti_ros2.samples import Int64Array

__all__ = [
    'BagMessage',
    'BagMessages',
    'BagSummary',
    'TopicSummary',
    'bag_stamps',
    'open_messages',
    'summarize_bag',
]

_INDEXES: dict[str, Callable[[Path], BagIndex]] = {
    'mcap': mcap_index,
    'sqlite3': sqlite_index,
    'ros1': ros1_index,
}


def summarize_bag(path: Path) -> BagSummary:
    """Topics, counts, times, rates and gaps of a bag, from its index where it has one.

    Args:
        path: An .mcap, .db3 or .bag file, or a directory of rosbag2.

    Raises:
        BadBagError: It holds no bag, or one that cannot be read at all.
        OSError: It cannot be read.
    """
    bag = locate_bag(path)
    index = _bag_index(bag)
    if bag.message_count is not None and bag.message_count != index.total:
        index.warnings.append(
            f'{path}: metadata.yaml counts {bag.message_count} messages,'
            f' the files hold {index.total}; ros2 bag reindex corrects it'
        )
    return summarize(bag.container, bag.files, index)


def bag_stamps(path: Path) -> dict[str, Int64Array]:
    """By topic the log times of its messages, (N,) int64 nanoseconds, ascending.

    Raises:
        BadBagError: It holds no bag, or one that cannot be read at all.
        OSError: It cannot be read.
    """
    index = _bag_index(locate_bag(path))
    pieces: dict[str, list[Int64Array]] = {}
    for (topic, _), found in index.stamps.items():
        pieces.setdefault(topic, []).extend(found)
    return {topic: np.sort(np.concatenate(found)) for topic, found in pieces.items() if found}


def _bag_index(bag: BagFiles) -> BagIndex:
    index = BagIndex()
    if bag.compression_mode:
        index.compressions.add('zstd')
    for file in bag.files:
        index.merge(_file_index(bag, file))
    return index


def open_messages(path: Path, topics: Collection[str] | None = None) -> BagMessages:
    """Open a bag to read its messages; a context manager, and then an iterable.

    Args:
        path: An .mcap, .db3 or .bag file, or a directory of rosbag2.
        topics: The topics to read; all of them by default.

    Raises:
        BadBagError: It holds no bag, or one that cannot be read at all.
        OSError: It cannot be read.
    """
    return BagMessages(locate_bag(path), topics)


def _file_index(bag: BagFiles, file: Path) -> BagIndex:
    index = _INDEXES[bag.storage]
    if bag.compression_mode != 'file':
        return index(file)
    with ExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory())
        plain = Path(folder) / file.stem
        with file.open('rb') as source, plain.open('wb') as target:
            reader = zstandard.ZstdDecompressor().stream_reader(source)
            try:
                shutil.copyfileobj(reader, target)
            except zstandard.ZstdError as error:
                raise BadBagError(file, f'cannot be decompressed ({error})') from error
        return index(plain)
