# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of MCAP and ROS 1 files: chunks, with or without an index at the end."""

from __future__ import annotations

from abc import abstractmethod
from array import array
from collections import Counter
from contextlib import suppress
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Generic

from .chunk_scan import piece_records, unpack
from .pieces import BagFile, FetchedPiece
from .record_walk import Head

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from .chunk_scan import FileContents
    from .findings import Findings
    from .pieces import Buffer, FileBytes, Piece, StoredMessage
    from .record_walk import RecordFormat


_INDEXES_AHEAD = 16
_MOST_UNPACKED = 2**23  # before its turn: some chunks are made to fill the memory


class ChunkedFile(BagFile, Generic[Head]):
    """A BagFile that consists of chunks.

    Args:
        file: The bytes.
        findings: Damage is entered there.
        contents: From the file's index, or from a scan of the file.
        form: The format of the records.
    """

    def __init__(
        self, file: FileBytes, findings: Findings, contents: FileContents, form: RecordFormat[Head]
    ) -> None:
        self.channels = contents.channels
        self.pieces = contents.pieces
        self.compressions: set[str] = contents.compressions
        self._stamps = contents.stamps
        self._file = file
        self._findings = findings
        self._form = form
        self.fetches = not file.waits

    def fetch(self, piece: Piece) -> FetchedPiece:
        """Read a piece, and unpack it unless it is large, on any thread."""
        data = self._file.read(piece.position, piece.length)
        with suppress(ValueError):  # read finds the damage again
            if self._form.unpacked_size(data) <= _MOST_UNPACKED:
                return FetchedPiece(data, unpack(self._form, self._file, piece.position, data))
        return FetchedPiece(data, None)

    def read(
        self,
        piece: Piece,
        wanted: Collection[int],
        since_ns: int,
        fetched: FetchedPiece | None = None,
    ) -> Iterator[StoredMessage]:
        """Return the messages of some channels in a piece from a stamp on, in time order."""
        if fetched is None:
            fetched = FetchedPiece(self._file.read(piece.position, piece.length), None)
        data, unpacked = fetched
        end = piece.position + len(data)
        try:
            records, whole = unpacked or unpack(self._form, self._file, piece.position, data)
            found, done = self._messages_in(records, wanted, since_ns)
            self._file.limits.add_records(piece.position, len(found))
            sound = whole and done == len(records)
        except ValueError:
            found, sound = [], False
        found.sort(key=itemgetter(0))  # costs little if it is sorted already
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
            found.sort(key=itemgetter(0))
        return iter(found)

    def _compare(
        self, piece: Piece, wanted: Collection[int], found: Sequence[StoredMessage]
    ) -> None:
        """Enter a loss if a piece and its index list different messages: one of them is damaged.

        Args:
            piece: As the index lists it.
            wanted: Ids of the requested channels.
            found: Their messages in the piece, by time.
        """
        listed = {key: count for key, count in piece.counts.items() if count and key in wanted}
        there = Counter(map(itemgetter(1), found))
        outside = found and not piece.start_ns <= found[0][0] <= found[-1][0] <= piece.end_ns
        if listed != there or outside:
            lost = sum((Counter(listed) - there).values())
            place = f'{self._file.name}: the chunk at byte {piece.position}'
            self._findings.lose(f'{place} has other messages than its index lists', lost)

    def expect(self, piece: Piece) -> None:
        """Ask the system to read a piece ahead of its turn."""
        self._file.expect(piece.position, piece.length)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _all_stamps(self) -> Iterable[tuple[int, npt.ArrayLike]]:
        """Return the stamps by channel from the file's index, or from a scan if that is damaged."""
        if self._stamps is not None:
            return self._stamps.items()
        joined: dict[int, array[int]] = {}  # thousands of chunks have one or two of a channel
        for number, piece in enumerate(self.pieces):
            if self._file.waits:
                self._expect_indexes(self.pieces[number : number + _INDEXES_AHEAD])
            try:
                stamps = self._indexed(piece)
            except ValueError:
                stamps = {}
            if piece.counts != {channel_id: len(each) for channel_id, each in stamps.items()}:
                return self._scanned().items()
            for channel_id, each in stamps.items():
                joined.setdefault(channel_id, array('Q')).frombytes(each.astype('u8').tobytes())
        return joined.items()

    def _salvaged(self, position: int, data: bytes, cost: int) -> Iterator[StoredMessage]:
        """Yield the recoverable messages of a damaged piece in file order; enter the losses."""
        findings = self._findings
        for head, body in piece_records(self._form, self._file, position, data, findings, cost):
            message = self._form.stored_message(head, body)
            if message is not None:
                yield message

    @abstractmethod
    def _messages_in(
        self, records: Buffer, wanted: Collection[int], since_ns: int
    ) -> tuple[list[StoredMessage], int]:
        """Return the messages among records, and the end of the last record that can be split."""

    def _expect_indexes(self, pieces: Sequence[Piece]) -> None:
        """Request the indexes of pieces from a store."""

    @abstractmethod
    def _indexed(self, piece: Piece) -> Mapping[int, npt.NDArray[np.integer[Any]]]:
        """Return the stamps of a piece by channel id, from its index.

        Raises:
            ValueError: The index is damaged.
        """

    @abstractmethod
    def _scanned(self) -> Mapping[int, array[int]]:
        """Return the stamps by channel id, from a scan of the file."""
