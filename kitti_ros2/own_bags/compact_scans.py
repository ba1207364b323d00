# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of --clouds compact joined with the rests of their files, in any order of both."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..bags.reader import Decoder, open_messages
from ..kitti.compact_scan import restore
from ..messages.cdr import stamp_ns_of
from ..messages.compact_clouds import decode_rest
from ..messages.naming import REST
from ..messages.topics import own_topics
from ..model.bag_formats import STRING
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from ..bags.bag_files import BagSource
    from ..bags.reader import BagMessage
    from ..model.samples import Scan, ScanRest

_MOST_WAITING = 8
"""Clouds that wait for their rests: a recorder stores both within less than a turn."""


def read_rests(bag: BagSource) -> dict[str, ScanRest]:
    """Read the rests of all scans of a bag, by the names of their files; damaged ones are left out.

    Raises:
        BadBagError: The bag cannot be read.
    """
    rests = {}
    with open_messages(bag, {REST}, must_read=False) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            with suppress(ValueError):
                name, rest = decode_rest(decode(message, STRING))
                rests[name] = rest
    return rests


def as_in_file(scan: Scan, rest: ScanRest | None) -> Scan:
    """Return a scan with the points of its file; with those of its cloud where that is not it."""
    if rest is None:
        return scan
    try:
        return replace(scan, points=restore(scan.points, rest), difference='')
    except ValueError as error:
        return replace(scan, difference=f'but those of their clouds: {error}')


class ScanRests:
    """The rests of the files of scans in a bag.

    Args:
        names: Returns the names of the files that a scan with a stamp, nanoseconds, may be.
        lose: Called with a message that is damaged, and the reason.
    """

    def __init__(
        self, names: Callable[[int], Sequence[str]], lose: Callable[[BagMessage, str], None]
    ) -> None:
        self._names = names
        self._lose = lose
        self._rests: dict[str, ScanRest] = {}

    def take(self, name: str) -> ScanRest | None:
        """Return the rest of a file, once; None without it."""
        return self._rests.pop(name, None)

    def joined(
        self, messages: Iterable[tuple[BagMessage, Any]], *, are_there: bool
    ) -> Iterator[tuple[BagMessage, Any]]:
        """Yield decoded messages but those of rests; a cloud follows the rest of its file.

        Args:
            messages: Each with what it is decoded to, or the error.
            are_there: Whether the bag has rests.
        """
        waiting: deque[tuple[BagMessage, Any]] = deque()
        for message, decoded in messages:
            if message.topic == REST:
                self._enter(message, decoded)
            elif are_there and own_topics()[message.topic].stream is Stream.SCAN:
                waiting.append((message, decoded))
            else:
                yield message, decoded
            while waiting and (len(waiting) > _MOST_WAITING or self._is_joined(waiting[0][1])):
                yield waiting.popleft()
        yield from waiting

    def _enter(self, message: BagMessage, decoded: Any) -> None:  # noqa: ANN401 - of the bag's types
        try:
            if isinstance(decoded, ValueError):
                raise decoded
            name, rest = decode_rest(decoded)
        except ValueError as error:
            self._lose(message, str(error))
            return
        self._rests[name] = rest

    def _is_joined(self, decoded: Any) -> bool:  # noqa: ANN401 - as above
        if isinstance(decoded, ValueError):
            return True
        names = self._names(stamp_ns_of(decoded.header))
        return not names or not self._rests.keys().isdisjoint(names)
