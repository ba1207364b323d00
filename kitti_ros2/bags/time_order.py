# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The merge of the messages of a bag's files by time.

A piece is read when its time comes and dropped after its last message, so merging a bag of any size
takes the memory of the pieces that overlap, and of a few that threads read ahead of their turn.
"""

from __future__ import annotations

from collections import deque
from heapq import heappop, heappush, heapreplace
from typing import TYPE_CHECKING

from ..files.workers import SpareThreads

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from typing_extensions import Self

    from ..files.threads import ThreadTask
    from .pieces import BagFile, FetchedPiece, Piece, StoredMessage

_AHEAD = 4
_LEAST_FETCHED = 2**16  # handing over a smaller piece costs as much as reading it
_MOST_FETCHED = 2**23  # bytes of all pieces ahead: they are the larger part of the memory


def in_time_order(
    files: Sequence[tuple[BagFile, Collection[int]]], since_ns: int
) -> Iterator[tuple[int, StoredMessage]]:
    """Yield the messages of files from a stamp on, with the number of their file.

    Args:
        files: Each with the ids of the requested channels.
        since_ns: The first requested stamp.
    """
    # By stamp, file and position, which are unique, so messages are never compared.
    active: list[tuple[int, int, int, StoredMessage, Iterator[StoredMessage]]] = []
    with _Turns(files, since_ns) as turns:
        while True:
            while turns.start_ns is not None and (not active or turns.start_ns <= active[0][0]):
                number, position, found = turns.take()
                messages = iter(found)
                first = next(messages, None)
                if first is not None:
                    heappush(active, (first[0], number, position, first, messages))
            if not active:
                return
            _, number, position, message, messages = active[0]
            yield number, message
            following = next(messages, None)
            if following is None:
                heappop(active)
            else:
                heapreplace(active, (following[0], number, position, following, messages))


class _Turns:
    """The pieces in the order of their first stamps; those that are next are read in threads.

    Their number grows with the number of pieces taken: who wants the first message only does not
    wait for others.
    """

    def __init__(self, files: Sequence[tuple[BagFile, Collection[int]]], since_ns: int) -> None:
        self._files = files
        self._since_ns = since_ns
        waiting = [
            (number, piece)
            for number, (file, wanted) in enumerate(files)
            for piece in file.pieces
            if piece.end_ns >= since_ns and not piece.counts.keys().isdisjoint(wanted)
        ]
        waiting.sort(key=lambda each: (each[1].start_ns, each[0], each[1].position))
        self._waiting = deque(waiting)
        self._ahead: deque[ThreadTask[FetchedPiece] | None] = deque()
        self._most_ahead = 0
        self._threads = SpareThreads()

    @property
    def start_ns(self) -> int | None:
        """The first stamp of the next piece; None after the last one."""
        return self._waiting[0][1].start_ns if self._waiting else None

    def take(self) -> tuple[int, int, Iterable[StoredMessage]]:
        """Read the next piece: the number of its file, its position, and its messages."""
        number, piece = self._waiting.popleft()
        ahead = self._ahead.popleft() if self._ahead else None
        fitting = max(1, _MOST_FETCHED // max(1, piece.length))
        self._most_ahead = min(self._most_ahead + 1, _AHEAD, fitting)
        while len(self._ahead) < min(self._most_ahead, len(self._waiting)):
            self._ahead.append(self._request(*self._waiting[len(self._ahead)]))
        file, wanted = self._files[number]
        # What a thread could not read is tried again here, where errors are handled.
        fetched = None if ahead is None or ahead.error() else ahead.result()
        return number, piece.position, file.read(piece, wanted, self._since_ns, fetched)

    def _request(self, number: int, piece: Piece) -> ThreadTask[FetchedPiece] | None:
        file = self._files[number][0]
        can_fetch = file.fetches and _LEAST_FETCHED <= piece.length <= _MOST_FETCHED
        ahead = self._threads.submit(file.fetch, piece) if can_fetch else None
        if ahead is None:
            file.expect(piece)
        return ahead

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.close()
