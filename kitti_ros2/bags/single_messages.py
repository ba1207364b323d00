# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Single messages of a bag, by position or by index in time order."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.errors import MissingDataError
from .reader import open_messages

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from ..model.samples import Int64Array
    from .bag_files import BagSource
    from .reader import BagMessage, BagMessages


# Random access to single messages of a bag, by their log times.


class MessagePosition(NamedTuple):
    """The position of a message: topic, log time, and number of earlier ones of both.

    A bag is searched by time, and several messages of a topic may have the same.
    """

    topic: str
    log_ns: int
    before: int


def positions_of(topic: str, log_ns: Int64Array, indices: Iterable[int]) -> list[MessagePosition]:
    """Return the positions of some messages of a topic.

    Args:
        topic: Its name.
        log_ns: (N,) log times of all its messages, nanoseconds, ascending.
        indices: Indices of the requested ones.
    """
    stamps = [(index, int(log_ns[index])) for index in indices]
    return [
        MessagePosition(topic, stamp_ns, index - int(np.searchsorted(log_ns, stamp_ns)))
        for index, stamp_ns in stamps
    ]


class MessagesByPosition:
    """Reads messages by position; thread-safe.

    Raises:
        BadBagError: The bag cannot be read.
    """

    def __init__(self, bag: BagSource, topics: Collection[str]) -> None:
        self._messages = open_messages(bag, topics, must_read=False)
        self._types = dict(self._messages.channels)
        self._lock = Lock()

    def close(self) -> None:
        """Close the files."""
        self._messages.close()

    def read(self, position: MessagePosition) -> Any:  # noqa: ANN401 - of the bag's types
        """Read and decode the message at a position.

        Raises:
            MissingDataError: It is missing, or its topic cannot be read.
            Exception: It cannot be decoded; generated code lets anything out.
        """
        if position.topic not in self._types:
            raise MissingDataError('its type is not defined')
        before = position.before
        with self._lock:
            for message in self._messages.at(position.topic, position.log_ns):
                if not before:
                    kind = message.msgtype
                    return self._messages.typestore.deserialize_cdr(bytes(message.data), kind)
                before -= 1
        raise MissingDataError('it is not there any more')


# Messages by their index in time order; the next one is read without a search.


class MessagesByIndex:
    """Reads messages by their index in time order; seeks where it is not that of the next one.

    Args:
        messages: All messages of a bag; closed by the caller.
        log_ns: (N,) log times of all of them, nanoseconds, ascending.
    """

    def __init__(self, messages: BagMessages, log_ns: Int64Array) -> None:
        self._messages = messages
        self._log_ns = log_ns
        self._iterator: Iterator[BagMessage] | None = None
        self._next = 0

    def read(self, index: int) -> BagMessage | None:
        """Read a message; None if it is missing.

        Raises:
            BadBagError: The bag cannot be read.
            OSError: A file cannot be read.
        """
        log_ns = int(self._log_ns[index])
        iterator, self._iterator = self._iterator, None  # an iterator that fails is not used again
        if iterator is None or index != self._next:
            iterator = self._messages.since(log_ns)
            for _ in range(index - int(self._log_ns.searchsorted(log_ns))):
                next(iterator, None)
        message = next(iterator, None)
        if message is None or message.stamp_ns != log_ns:
            return None
        self._iterator, self._next = iterator, index + 1
        return message
