# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decompression, and limits of the content of a bag file by its size on the disk.

Some files are made to fill the memory.
"""

from __future__ import annotations

import bz2
import os
from contextlib import suppress
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import zstandard
from lz4 import frame as lz4_frame

from ..model.errors import UsageError, format_bytes, shown
from ..options.declare import parse_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from typing import BinaryIO, Protocol


# Limits of the content of a bag file, by its size on the disk: some are made to fill the memory.

Record = TypeVar('Record')
LARGEST_BLOCK = 'KITTI_ROS2_LARGEST_BLOCK'
_ALWAYS = 64 * 10**6
_RATIO = 16
_FILE_ALWAYS = 10**9
_FILE_RATIO = 100
_RECORDS_ALWAYS = 2 * 10**5
_COUNTED = 1000
_BYTES_PER_RECORD = 10  # compressed; a stamp alone has 8
_DESCRIPTIONS_ALWAYS = 20_000
_BYTES_PER_DESCRIPTION = 60
_TEXTS_ALWAYS = 16 * 10**6
_TEXTS_RATIO = 4
_SEARCHED_ALWAYS = 32 * 10**6
_SEARCHED_RATIO = 32
_SEARCHED_STEP = 10**4
_ATTEMPT_COST = 100  # bytes that are searched in the time of one attempt


class LimitError(ValueError):
    """A file holds more than one of its size may."""


def largest_block(stored: int) -> int:
    """Return the most bytes that a compressed block of so many bytes may have.

    Sensors' data shrink to a third, and blank images to a hundredth, but those are small.

    Raises:
        UsageError: The environment variable that sets it is no size.
    """
    return max(_limit(_ALWAYS), _RATIO * stored)


def check_block(stored: int, size: int) -> None:
    """Check the size of a block before compression.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, largest_block(stored))


def check_file(stored: int, size: int) -> None:
    """Check the size of a file that is compressed as a whole; it goes to the disk.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, max(_limit(_FILE_ALWAYS), _FILE_RATIO * stored))


class FileLimits:
    """Limits of all blocks of a file together: each alone may be within its own.

    Args:
        stored: Bytes of the file, compressed if all of it is.
    """

    def __init__(self, stored: int) -> None:
        self._stored = stored
        self._sizes: dict[int, int] = {}
        self._size = 0
        self._counts: dict[int, int] = {}
        self._count = 0
        self._refused = ''
        self._searched: dict[int, int] = {}
        self._all_searched = 0

    @property
    def largest_part(self) -> int:
        """The most bytes of a part in memory, such as an index or a message."""
        return largest_block(self._stored)

    def descriptions(self) -> DescriptionLimits:
        """Return limits of what describes topics and types, of which nothing is entered yet."""
        return DescriptionLimits(self._stored)

    @property
    def most_records(self) -> int:
        """The most records of all blocks."""
        return max(_times(_RECORDS_ALWAYS), self._stored // _BYTES_PER_RECORD)

    def add_block(self, position: int, size: int) -> None:
        """Enter the size of a block before it is decompressed; the same position counts once.

        Raises:
            ValueError: The blocks so far are too large, or have too many records.
        """
        if self._refused and position not in self._counts:
            raise LimitError(self._refused)
        if position not in self._sizes:
            check_file(self._stored, self._size + size)
            self._sizes[position] = size
            self._size += size

    def add_records(self, position: int, count: int) -> None:
        """Enter the number of records in a block, of which more than before may be known.

        Raises:
            LimitError: The blocks so far have too many.
        """
        more = count - self._counts.get(position, 0)
        if more <= 0:
            return
        if self._refused or self._count + more > self.most_records:
            what = f'hold more than {self.most_records} records'
            self._refused = _exceeded(self._stored, what)
            raise LimitError(self._refused)
        self._counts[position] = count
        self._count += more

    def add_searched(self, position: int, cost: int) -> None:
        """Enter what it has cost so far to search the damaged bytes of a block.

        Args:
            position: Offset of the block.
            cost: In bytes that are searched in that time; of all searches the largest counts.

        Raises:
            LimitError: The blocks so far cost too much.
        """
        more = cost - self._searched.get(position, 0)
        if more <= 0:
            return
        most = max(_times(_SEARCHED_ALWAYS), _SEARCHED_RATIO * self._stored)
        if self._all_searched + more > most:
            raise LimitError(_exceeded(self._stored, 'hold too many damaged bytes to search'))
        self._searched[position] = cost
        self._all_searched += more

    def counted(self, position: int, records: Iterable[Record]) -> Iterator[Record]:
        """Yield the records of a block while they are within the limit.

        Raises:
            LimitError: The blocks so far have too many.
        """
        for count, record in enumerate(records):
            if count % _COUNTED == 0:
                self.add_records(position, count)
            yield record


class Search:
    """A search of the damaged bytes of a block.

    Args:
        limits: Those of the file.
        position: Offset of the block.
    """

    def __init__(self, limits: FileLimits, position: int) -> None:
        self._limits = limits
        self._position = position
        self._cost = self._entered = 0

    def spend(self, size: int, attempts: int = 0) -> None:
        """Enter more searched bytes, and the attempts to read a record among them.

        Raises:
            LimitError: The file has cost too much.
        """
        self._cost += size + attempts * _ATTEMPT_COST
        if self._cost - self._entered >= _SEARCHED_STEP:
            self._entered = self._cost
            self._limits.add_searched(self._position, self._cost)


class DescriptionLimits:
    """Limits of the number and the text of the topics and types that a file describes.

    Args:
        stored: Bytes of the file, compressed if all of it is.
    """

    def __init__(self, stored: int) -> None:
        self._stored = stored
        self._most = max(_times(_DESCRIPTIONS_ALWAYS), stored // _BYTES_PER_DESCRIPTION)
        self._longest = max(_times(_TEXTS_ALWAYS), _TEXTS_RATIO * stored)
        self._count = 0
        self._size = 0

    def add(self, size: int) -> None:
        """Enter one more before it is kept.

        Args:
            size: Bytes of its texts.

        Raises:
            LimitError: There are too many, or their texts are too long.
        """
        if self._count == self._most:
            what = f'describe more than {self._most} topics and types'
            raise LimitError(_exceeded(self._stored, what))
        if self._size + size > self._longest:
            what = f'describe topics and types by more than {format_bytes(self._longest)}'
            raise LimitError(_exceeded(self._stored, what))
        self._count += 1
        self._size += size


def _exceeded(stored: int, what: str) -> str:
    return (
        f'{format_bytes(stored)} that {what}; {LARGEST_BLOCK}=SIZE in the environment allows more'
    )


def _times(always: int) -> int:
    """Return what any file may have, more where a user has raised the size of a block."""
    return always * (_limit(_ALWAYS) // _ALWAYS)


def _check(stored: int, size: int, most: int) -> None:
    if size > most:
        raise ValueError(
            f'{format_bytes(stored)} that become {format_bytes(size)}; expected at most'
            f' {format_bytes(most)}; {LARGEST_BLOCK}=SIZE in the environment allows more'
        )


def _limit(default: int) -> int:
    text = os.environ.get(LARGEST_BLOCK)
    if not text:
        return default
    try:
        return max(parse_bytes(text), default)
    except ValueError:
        raise UsageError(f'{LARGEST_BLOCK} takes a size such as 2GB, not {shown(text)}') from None


# Decompression of whole blocks, files and messages, and of the beginning of truncated ones.

if TYPE_CHECKING:

    class _Stream(Protocol):
        def read(self, length: int, /) -> bytes: ...


Buffer: TypeAlias = 'bytes | memoryview'

# Raised by the libraries: lz4 raises RuntimeError, bz2 OSError; a damaged size is too large.
_ERRORS = (
    zstandard.ZstdError,
    RuntimeError,
    OSError,
    ValueError,
    EOFError,
    MemoryError,
    OverflowError,
)
_STEP = 2**16
_STEP_IN = 2**14  # damage costs the data of its whole step

_STREAMS: dict[str, Callable[[Buffer], _Stream]] = {
    'zstd': lambda data: zstandard.ZstdDecompressor().stream_reader(data),
    'lz4': lambda data: _Stepwise(data, lz4_frame.LZ4FrameDecompressor),
    'bz2': lambda data: _Stepwise(data, bz2.BZ2Decompressor),
}
UNCOMPRESSED = ('', 'none')


def decompress(name: str, data: Buffer, size: int) -> Buffer:
    """Decompress a whole block; what it has beyond its size is not decompressed.

    Args:
        name: zstd, lz4 (frame format), bz2; empty or none for uncompressed data.
        data: The block.
        size: Bytes of the data before compression.

    Raises:
        ValueError: The block is damaged or too large, or the compression is unknown.
    """
    if name not in UNCOMPRESSED:
        if name not in _STREAMS:
            raise ValueError(f'unknown compression {name!r}')
        check_block(len(data), size)
        try:
            data = _decompress(name, data, size)
        except _ERRORS as error:
            raise ValueError(' '.join(str(error).split())) from error
    if len(data) > size:
        raise ValueError(f'more than the {size} bytes that it declares')
    if len(data) < size:
        raise ValueError(f'{len(data)} bytes instead of {size}')
    return data


def _decompress(name: str, data: Buffer, size: int) -> Buffer:
    """Return a block's data, and no more than one byte beyond a size."""
    declared = _declared_size(name, data)
    if declared not in {None, size}:
        raise ValueError(f'{declared} bytes instead of {size}')
    if declared:  # faster than in steps
        return _whole(name, data, size)
    return b''.join(_parts(name, data, size + 1))


def _whole(name: str, data: Buffer, size: int) -> bytes:
    """Return the data of a block that declares its size, which may be a lie: not much more."""
    if name == 'zstd':
        return zstandard.ZstdDecompressor().decompress(data)
    stream = lz4_frame.LZ4FrameDecompressor()
    plain: bytes = stream.decompress(data, size + 1)
    if len(plain) <= size and not stream.eof:
        raise EOFError('cut off')
    return plain


def _declared_size(name: str, data: Buffer) -> int | None:
    """Return the size that a block itself declares."""
    if name == 'zstd':
        size = zstandard.frame_content_size(data)
        return size if size >= 0 else None
    if name == 'lz4':
        return lz4_frame.get_frame_info(data)['content_size'] or None
    return None


def _parts(name: str, data: Buffer, most: int) -> Iterator[bytes]:
    stream = _STREAMS[name](data)
    while part := stream.read(min(_STEP, most)):
        most -= len(part)
        yield part


def decompress_beginning(name: str, data: Buffer, size: int) -> Buffer:
    """Decompress as much as possible of a truncated block.

    Args:
        name: As of decompress.
        data: The beginning of a block.
        size: Bytes of the whole data before compression; 0 if unknown.
    """
    if name in UNCOMPRESSED:
        return data
    if name not in _STREAMS:
        return b''
    most = min(size or largest_block(len(data)), largest_block(len(data)))
    # The system moves pages that grow; a bytearray may be copied.
    buffer, end = mmap(-1, min(most, _STEP), flags=MAP_PRIVATE | MAP_ANONYMOUS), 0
    with suppress(*_ERRORS):
        for part in _parts(name, data, most):
            if end + len(part) > len(buffer):
                buffer.resize(min(2 * len(buffer), most))
            buffer[end : end + len(part)] = part
            end += len(part)
    return memoryview(buffer)[:end].toreadonly()


def decompress_file(source: BinaryIO) -> Iterator[bytes]:
    """Decompress a zstd file in small blocks, up to the first damage.

    Raises:
        ValueError: It is larger than a limit.
    """
    blocks = zstandard.ZstdDecompressor().read_to_iter(source, _STEP_IN, _STEP)
    done = 0
    while True:
        try:
            block = next(blocks, b'')
        except zstandard.ZstdError:
            return
        if not block:
            return
        done += len(block)
        check_file(source.tell(), done)
        yield block


def decompress_message(data: Buffer) -> bytes:
    """Decompress a message of rosbag2's message mode.

    Raises:
        ValueError: The message is damaged or too large.
    """
    try:
        size = _declared_size('zstd', data)
        if size:
            check_block(len(data), size)
            return _whole('zstd', data, size)
        size = sum(map(len, _parts('zstd', data, largest_block(len(data)) + 1)))
        check_block(len(data), size)
        stream = zstandard.ZstdDecompressor().decompressobj()
        plain: bytes = stream.decompress(data)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    if not stream.eof:
        raise ValueError('cut off')
    return plain


class _Stepwise:
    """A block of lz4 or bz2, which may have several parts, decompressed as far as is asked for."""

    def __init__(self, data: Buffer, kind: Callable[[], Any]) -> None:
        self._data: Buffer = data
        self._kind = kind
        self._stream = kind()

    def read(self, length: int) -> bytes:
        if self._stream.eof and self._stream.unused_data:
            self._data, self._stream = self._stream.unused_data, self._kind()
        if self._stream.eof or not length:
            return b''
        data, self._data = self._data, b''
        plain: bytes = self._stream.decompress(data, length)
        return plain
