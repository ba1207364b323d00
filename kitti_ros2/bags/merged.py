# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Several bags of one recording, read as if they were one."""

from __future__ import annotations

import heapq
from contextlib import ExitStack
from typing import TYPE_CHECKING

from rosbags.typesys import Stores, get_typestore

from kitti_ros2.errors import BadBagError

from .reader import open_messages

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from pathlib import Path
    from types import TracebackType

    from rosbags.typesys.store import Typestore
    from typing_extensions import Self

    from .message_source import BagMessage, BagMessages


class MergedMessages:
    """The messages of several bags in time order; used as BagMessages is.

    Args:
        paths: At least one bag.
        topics: The topics to read; all of them by default.

    Raises:
        BadBagError: One cannot be read, or they disagree about a topic's type or its definition.
    """

    def __init__(self, paths: Sequence[Path], topics: Collection[str] | None = None) -> None:
        with ExitStack() as stack:
            self._bags = [stack.enter_context(open_messages(path, topics)) for path in paths]
            self.channels = _channels(paths, self._bags)
            self.typestore = _typestore(paths, self._bags)
            self._stack = stack.pop_all()
        self.latched = {topic: depth for bag in self._bags for topic, depth in bag.latched.items()}

    @property
    def complete(self) -> bool:
        """Whether nothing was found damaged so far."""
        return all(bag.complete for bag in self._bags)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know, one line each, as far as has been read."""
        return tuple(warning for bag in self._bags for warning in bag.warnings)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def __iter__(self) -> Iterator[BagMessage]:
        return heapq.merge(*self._bags, key=lambda message: message.stamp_ns)


def _channels(paths: Sequence[Path], bags: Sequence[BagMessages]) -> tuple[tuple[str, str], ...]:
    found: dict[str, str] = {}
    for path, bag in zip(paths, bags, strict=True):
        for topic, msgtype in bag.channels:
            known = found.setdefault(topic, msgtype)
            if known != msgtype:
                raise BadBagError(path, f'{topic} is {msgtype} here, and {known} in another bag')
    return tuple(sorted(found.items()))


def _typestore(paths: Sequence[Path], bags: Sequence[BagMessages]) -> Typestore:
    """The definitions of all bags; those of a type that is read must agree."""
    store = get_typestore(Stores.EMPTY)
    for path, bag in zip(paths, bags, strict=True):
        known = store.fielddefs
        for _, msgtype in bag.channels:
            own = bag.typestore.fielddefs.get(msgtype)
            if msgtype in known and own is not None and known[msgtype][1] != own[1]:
                raise BadBagError(path, f'defines {msgtype} otherwise than another bag does')
        new = {name: own for name, own in bag.typestore.fielddefs.items() if name not in known}
        store.register(new)
    return store
