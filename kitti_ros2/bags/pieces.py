# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag as pieces with a time span each.

A piece is read at once: a chunk of MCAP or ROS 1, or all rows of a database. Damage costs at most
its own piece.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ..model.channels import Channel
from ..model.errors import naming
from .limits import FileLimits
from .summary import BagIndex

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt
    from typing_extensions import Self

    from ..files.scattered import Bytes, PageScatter
    from .decompressors import Buffer
    from .findings import Findings

StoredMessage: TypeAlias = 'tuple[int, int, Buffer]'
"""Stamp in nanoseconds, channel id, and the data in stored form."""


class MessageStart(bytes):
    """The first kilobyte or more of a large message, of which the rest was read and not kept.

    Attributes:
        size: Of the whole message, in bytes.
    """

    size: int


def size_of(data: Buffer) -> int:
    """Return the size in bytes of a message, of which this may be the start."""
    return data.size if isinstance(data, MessageStart) else len(data)


_ADVICE_BYTES = 2**18
"""Linux reads no more for one piece of advice than the disk takes in one request."""


@dataclass(frozen=True)
class StoredChannel(Channel):
    """A topic as stored in a file.

    Attributes:
        encoding: Of the messages: cdr, ros1, protobuf, json, or an unsupported one.
        definition: The text that defines the type and those in it, empty if missing.
        definition_encoding: ros2msg, ros2idl or ros1msg.
        profiles: rosbag2's text of the offered QoS profiles, empty if missing.
        schema: The definition of a protobuf type, a serialised FileDescriptorSet; empty for others.
    """

    encoding: str
    definition: str = ''
    definition_encoding: str = ''
    profiles: str = field(default='', kw_only=True)
    schema: bytes = field(default=b'', kw_only=True, repr=False)


class Piece(NamedTuple):
    """A part of a file that is read at once.

    Attributes:
        start_ns, end_ns: Least and greatest stamp.
        position, length: In the file, in bytes.
        counts: Messages by channel id.
    """

    start_ns: int
    end_ns: int
    position: int
    length: int
    counts: Mapping[int, int]


class FetchedPiece(NamedTuple):
    """The bytes of a piece, read before its messages are asked for.

    Attributes:
        data: As stored, fewer than its length if the file was cut off.
        unpacked: Its records, and whether it is whole; None if it is damaged, or too large to be
            unpacked before its turn.
    """

    data: bytes
    unpacked: tuple[Buffer, bool] | None


class BagFile(ABC):
    """A file open for reading, of any container.

    Attributes:
        channels: By id.
        pieces: In any order.
        compressions: Names of the compressions of chunks found so far, including none.
        is_start_enough: Asked with the id of a channel before a large message is read: whether its
            MessageStart is enough. A file may give the whole message all the same.
        fetches: Whether any thread may fetch pieces.
    """

    channels: Mapping[int, StoredChannel]
    pieces: Sequence[Piece]
    compressions: Collection[str] = ()
    is_start_enough: Callable[[int], bool] | None = None
    fetches: bool = False
    _findings: Findings

    @abstractmethod
    def read(
        self,
        piece: Piece,
        wanted: Collection[int],
        since_ns: int,
        fetched: FetchedPiece | None = None,
    ) -> Iterable[StoredMessage]:
        """Return the messages of some channels in a piece from a stamp on, in time order.

        Unreadable messages are skipped and entered into the bag's findings.

        Args:
            piece: One of pieces.
            wanted: Ids of the requested channels.
            since_ns: The first requested stamp.
            fetched: What fetch returned for the piece; without it the file is read now.
        """

    def fetch(self, piece: Piece) -> FetchedPiece:
        """Read the bytes of a piece for read, on any thread, where the file fetches.

        Raises:
            OSError: The disk refuses.
        """
        raise NotImplementedError

    @abstractmethod
    def close(self) -> None:
        """Close the file."""

    def index(self) -> BagIndex:
        """Return the stamps of all messages, by topic and type."""
        index = BagIndex()
        for channel in self.channels.values():
            index.add((channel.topic, channel.msgtype), [])
        for channel_id, stamps in self._all_stamps():
            if channel_id in self.channels:
                channel = self.channels[channel_id]
                index.add((channel.topic, channel.msgtype), stamps)
        index.compressions.update(self.compressions)
        return index

    def expect(self, piece: Piece) -> None:  # noqa: B027 - a database reads as it is asked
        """Ask the system to read a piece ahead of its turn; it is only advice."""

    def reporting_to(self, findings: Findings) -> Self:
        """Return the same open file, which enters what it finds damaged into other findings."""
        other = copy(self)
        other._findings = findings  # noqa: SLF001 - of the same class
        return other

    @abstractmethod
    def _all_stamps(self) -> Iterable[tuple[int, npt.ArrayLike]]:
        """Return the stamps of all messages, nanoseconds, by channel id."""


class NamedFile(NamedTuple):
    """A file of a bag that is to be opened.

    Attributes:
        path: The file; a copy of it if it had to be unpacked.
        name: The path in messages.
        packed: Bytes of the file that was unpacked, None if none was.
    """

    path: Path
    name: Path
    packed: int | None = None


class FileBytes:
    """A file's bytes by position; not memory-mapped, as a file may be truncated while it is read.

    Attributes:
        name: The path in messages.
        size: In bytes, when it was opened.
        waits: Whether each read waits for a store, so that what is needed is best requested early.

    Raises:
        OSError: The file cannot be opened.
    """

    waits = False
    _packed: int | None = None

    @cached_property
    def limits(self) -> FileLimits:
        """What it may hold: as much as its compressed form allows, if it was unpacked."""
        return FileLimits(self.size if self._packed is None else self._packed)

    def __init__(self, file: NamedFile) -> None:
        self.name = file.name
        self._packed = file.packed
        self._file = file.path.open('rb', buffering=0)
        with naming(self.name):
            self.size = os.fstat(self._file.fileno()).st_size

    def read(self, position: int, length: int) -> bytes:
        """Read `length` bytes, fewer at the end of the file, none outside of it.

        Raises:
            OSError: The disk refuses.
        """
        if length <= 0 or not 0 <= position < self.size:
            return b''
        length = min(length, self.size - position)  # a damaged length asks for more than memory
        try:
            data = os.pread(self._file.fileno(), length, position)
            while 0 < len(data) < length:
                more = os.pread(self._file.fileno(), length - len(data), position + len(data))
                if not more:
                    break
                data += more
        except OSError as error:
            error.filename = str(self.name)
            raise
        return data

    def read_part(self, position: int, length: int) -> bytes:
        """Read as read does a part that is held in memory as a whole, such as an index.

        Raises:
            ValueError: It is larger than a file of its packed size may have.
            OSError: The disk refuses.
        """
        if length > self.limits.largest_part:
            raise ValueError(f'{length} bytes, at most {self.limits.largest_part} are read')
        return self.read(position, length)

    def read_into(self, position: int, target: npt.NDArray[np.uint8]) -> int:
        """Read into a contiguous array; return the number of bytes, fewer at the end of the file.

        Raises:
            OSError: The disk refuses.
        """
        view = target.data.cast('B')
        done = 0
        try:
            while done < len(view):
                count = os.preadv(self._file.fileno(), [view[done:]], position + done)
                if not count:
                    break
                done += count
        except OSError as error:
            error.filename = str(self.name)
            raise
        return done

    def scatter(
        self, scatter: PageScatter, position: int, count: int, target: Bytes
    ) -> npt.NDArray[np.uint32] | None:
        """Read pages, as PageScatter.read; None also outside of the file.

        Raises:
            OSError: The disk refuses.
        """
        if position < 0:
            return None
        try:
            return scatter.read(self._file.fileno(), position, count, target)
        except OSError as error:
            error.filename = str(self.name)
            raise

    def expect(self, position: int, length: int) -> None:
        """Ask the system to read bytes from the disk meanwhile; it is only advice."""
        if hasattr(os, 'posix_fadvise'):
            with suppress(OSError):  # of a file system without a page cache
                file, end = self._file.fileno(), min(position + length, self.size)
                for start in range(position, end, _ADVICE_BYTES):
                    os.posix_fadvise(file, start, _ADVICE_BYTES, os.POSIX_FADV_WILLNEED)

    def is_cut(self) -> bool:
        """Whether it has become shorter since it was opened."""
        return os.fstat(self._file.fileno()).st_size < self.size

    def close(self) -> None:
        """Close the file; does nothing if it is closed."""
        self._file.close()
