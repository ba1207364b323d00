# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What files of chunks have in common: MCAP and ROS 1, with an index at the end or without."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from copy import copy
from operator import itemgetter
from typing import TYPE_CHECKING

from .summary import BagIndex

if TYPE_CHECKING:
    from array import array
    from collections.abc import Collection, Iterator, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt
    from typing_extensions import Self

    from .findings import Findings
    from .pieces import FileBytes, Piece, SourceChannel, StoredMessage


class ChunkedFile(ABC):
    """A BagFile of chunks.

    Args:
        file: The bytes.
        findings: What is damaged is entered there.
        channels: By id.
        pieces: Chunks, and runs of records outside of chunks.
        stamps: Nanoseconds by channel id, from a pass over the file; None with an index.
        compressions: Names of those met so far.
    """

    def __init__(
        self,
        file: FileBytes,
        findings: Findings,
        channels: Mapping[int, SourceChannel],
        pieces: Sequence[Piece],
        stamps: Mapping[int, array[int]] | None,
        compressions: set[str],
    ) -> None:
        self.channels = channels
        self.pieces = pieces
        self._file = file
        self._findings = findings
        self._stamps = stamps
        self.compressions = compressions

    def read(self, piece: Piece, wanted: Collection[int], since_ns: int) -> Iterator[StoredMessage]:
        """The messages of some channels in a piece from a stamp on, in time order."""
        data = self._file.read(piece.position, piece.length)
        end = piece.position + len(data)
        try:
            found, sound = self._messages(data, wanted, since_ns)
        except ValueError:
            found, sound = [], False
        if len(data) < piece.length:
            self._findings.lose(f'{self._file.name}: cut off at byte {end} while it was read')
        elif sound and since_ns <= piece.start_ns:
            self._compare(piece, wanted, found)
        if not sound or len(data) < piece.length:
            cost = sum(piece.counts[channel_id] for channel_id in piece.counts.keys() & set(wanted))
            found = [
                message
                for message in self._salvaged(piece.position, data, cost)
                if message[1] in wanted and message[0] >= since_ns
            ]
        found.sort(key=itemgetter(0))  # next to nothing where it is sorted already
        return iter(found)

    def _compare(
        self, piece: Piece, wanted: Collection[int], found: Sequence[StoredMessage]
    ) -> None:
        """Tell where a piece holds other messages than its index tells: one is damaged."""
        told = {key: count for key, count in piece.counts.items() if count and key in wanted}
        there = Counter(map(itemgetter(1), found))
        stamps = [message[0] for message in found]
        early = min(stamps, default=piece.start_ns) < piece.start_ns
        late = max(stamps, default=piece.end_ns) > piece.end_ns
        if told != there or early or late:
            lost = sum((Counter(told) - there).values())
            place = f'{self._file.name}: the chunk at byte {piece.position}'
            self._findings.lose(f'{place} holds other messages than its index tells', lost)

    def index(self) -> BagIndex:
        """The stamps of all messages, by topic and type."""
        index = BagIndex()
        for channel in self.channels.values():
            index.add((channel.topic, channel.msgtype), [])
        for channel_id, found in self._all_stamps():
            if channel_id in self.channels:
                channel = self.channels[channel_id]
                index.add((channel.topic, channel.msgtype), found)
        index.compressions |= self.compressions
        return index

    def reporting_to(self, findings: Findings) -> Self:
        """As BagFile has it."""
        other = copy(self)
        other._findings = findings  # noqa: SLF001 - of the same class
        return other

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _all_stamps(self) -> list[tuple[int, npt.ArrayLike]]:
        """The stamps by channel as the file indexes them; by a pass where that is damaged."""
        found: list[tuple[int, npt.ArrayLike]] = []
        if self._stamps is not None:
            return list(self._stamps.items())
        for piece in self.pieces:
            try:
                stamps = self._indexed(piece)
            except ValueError:
                stamps = {}
            if piece.counts != {channel_id: len(each) for channel_id, each in stamps.items()}:
                return list(self._scanned().items())
            found += stamps.items()
        return found

    @abstractmethod
    def _messages(
        self, data: bytes, wanted: Collection[int], since_ns: int
    ) -> tuple[list[StoredMessage], bool]:
        """The messages of a piece, and whether it is sound.

        Raises:
            ValueError: It is damaged.
        """

    @abstractmethod
    def _salvaged(self, position: int, data: bytes, cost: int) -> Iterator[StoredMessage]:
        """What can be had of a damaged piece, in the order of the file; the rest is told."""

    @abstractmethod
    def _indexed(self, piece: Piece) -> dict[int, npt.NDArray[np.int64]]:
        """The stamps of a piece by channel id, from its index.

        Raises:
            ValueError: That is damaged.
        """

    @abstractmethod
    def _scanned(self) -> Mapping[int, array[int]]:
        """The stamps by channel id, from a pass over the file."""
