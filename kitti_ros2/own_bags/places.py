# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Random access to single messages of a bag, by their log times."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bags.reader import open_messages
from ..model.errors import MissingDataError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from ..bags.reader import BagSource
    from ..model.samples import Int64Array


class Place(NamedTuple):
    """The place of a message: topic, log time, and number of earlier ones of both.

    A bag is searched by time, and several messages of a topic may have the same.
    """

    topic: str
    log_ns: int
    before: int


def places_of(topic: str, log_ns: Int64Array, indices: Iterable[int]) -> list[Place]:
    """Return the places of some messages of a topic.

    Args:
        topic: Its name.
        log_ns: (N,) log times of all its messages, nanoseconds, ascending.
        indices: Those to locate.
    """
    stamps = [(index, int(log_ns[index])) for index in indices]
    return [
        Place(topic, stamp_ns, index - int(np.searchsorted(log_ns, stamp_ns)))
        for index, stamp_ns in stamps
    ]


class PlacedMessages:
    """Reads messages by their places; thread-safe.

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

    def read(self, place: Place) -> Any:  # noqa: ANN401 - of the bag's types
        """Read and decode the message at a place.

        Raises:
            MissingDataError: It is missing, or its topic cannot be read.
            Exception: It cannot be decoded; generated code lets anything out.
        """
        if place.topic not in self._types:
            raise MissingDataError('its type is not defined')
        before = place.before
        with self._lock:
            for message in self._messages.since(place.log_ns):
                if message.topic != place.topic:
                    continue
                if not before:
                    kind = message.msgtype
                    return self._messages.typestore.deserialize_cdr(bytes(message.data), kind)
                before -= 1
        raise MissingDataError('it is not there any more')
