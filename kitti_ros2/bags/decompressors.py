# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decompression of whole blocks, files and messages, and of the beginning of truncated ones."""

from __future__ import annotations

import bz2
from contextlib import suppress
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
from typing import TYPE_CHECKING, Any, TypeAlias

import zstandard
from lz4 import frame as lz4_frame

from .limits import check_block, check_file, largest_block

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import BinaryIO, Protocol

    class _Stream(Protocol):
        def read(self, length: int, /) -> bytes: ...


Buffer: TypeAlias = 'bytes | memoryview'

ZSTD_MAGIC = b'(\xb5/\xfd'
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
        size: Of the data before compression, in bytes.

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
    return b''.join(_pieces(name, data, size + 1))


def _whole(name: str, data: Buffer, size: int) -> bytes:
    """Return the data of a block that declares its size, which may be a lie: not much more."""
    if name == 'zstd':
        return zstandard.ZstdDecompressor().decompress(data)
    stream = lz4_frame.LZ4FrameDecompressor()
    found: bytes = stream.decompress(data, size + 1)
    if len(found) <= size and not stream.eof:
        raise EOFError('cut off')
    return found


def _declared_size(name: str, data: Buffer) -> int | None:
    """Return the size that a block itself declares."""
    if name == 'zstd':
        size = zstandard.frame_content_size(data)
        return size if size >= 0 else None
    if name == 'lz4':
        return lz4_frame.get_frame_info(data)['content_size'] or None
    return None


def _pieces(name: str, data: Buffer, most: int) -> Iterator[bytes]:
    stream = _STREAMS[name](data)
    while piece := stream.read(min(_STEP, most)):
        most -= len(piece)
        yield piece


def decompress_beginning(name: str, data: Buffer, size: int) -> Buffer:
    """Decompress as much as possible of a truncated block.

    Args:
        name: As of decompress.
        data: The beginning of a block.
        size: Of the whole data before compression; 0 if it is not known.
    """
    if name in UNCOMPRESSED:
        return data
    if name not in _STREAMS:
        return b''
    most = min(size or largest_block(len(data)), largest_block(len(data)))
    # The system moves pages that grow; a bytearray may be copied.
    found, end = mmap(-1, min(most, _STEP), flags=MAP_PRIVATE | MAP_ANONYMOUS), 0
    with suppress(*_ERRORS):
        for piece in _pieces(name, data, most):
            if end + len(piece) > len(found):
                found.resize(min(2 * len(found), most))
            found[end : end + len(piece)] = piece
            end += len(piece)
    return memoryview(found)[:end].toreadonly()


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
        size = sum(map(len, _pieces('zstd', data, largest_block(len(data)) + 1)))
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
        found: bytes = self._stream.decompress(data, length)
        return found
