# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decompression of whole blocks, files and messages, and of the beginning of truncated ones."""

from __future__ import annotations

import bz2
from typing import TYPE_CHECKING

import zstandard
from lz4 import frame as lz4_frame

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import BinaryIO, Protocol

    from .pieces import Buffer

    class _Stream(Protocol):
        def decompress(self, data: Buffer, /) -> bytes: ...


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

_BLOCKS: dict[str, Callable[[Buffer, int], bytes]] = {
    'zstd': lambda data, size: zstandard.ZstdDecompressor().decompress(data, max_output_size=size),
    'lz4': lambda data, _: lz4_frame.decompress(data),
    'bz2': lambda data, _: bz2.decompress(data),
}
_STREAMS: dict[str, Callable[[], _Stream]] = {
    'zstd': lambda: zstandard.ZstdDecompressor().decompressobj(),
    'lz4': lz4_frame.LZ4FrameDecompressor,
    'bz2': bz2.BZ2Decompressor,
}
UNCOMPRESSED = ('', 'none')


def decompress(name: str, data: Buffer, size: int) -> Buffer:
    """Decompress a whole block.

    Args:
        name: zstd, lz4 (frame format), bz2; empty or none for uncompressed data.
        data: The block.
        size: Of the data before compression, in bytes.

    Raises:
        ValueError: The block is damaged, or the compression is unknown.
    """
    if name not in UNCOMPRESSED:
        if name not in _BLOCKS:
            raise ValueError(f'unknown compression {name!r}')
        try:
            data = _BLOCKS[name](data, size)
        except _ERRORS as error:
            raise ValueError(' '.join(str(error).split())) from error
    if len(data) != size:
        raise ValueError(f'{len(data)} bytes instead of {size}')
    return data


def decompress_beginning(name: str, data: Buffer) -> Buffer:
    """Decompress as much as possible of a truncated block."""
    if name in UNCOMPRESSED:
        return data
    if name not in _STREAMS:
        return b''
    view, stream = memoryview(data), _STREAMS[name]()
    found = bytearray()
    for start in range(0, len(view), _STEP):
        try:
            found += stream.decompress(view[start : start + _STEP])
        except _ERRORS:
            break
    return bytes(found)


def decompress_file(source: BinaryIO) -> Iterator[bytes]:
    """Decompress a zstd file in small blocks, up to the first damage."""
    blocks = zstandard.ZstdDecompressor().read_to_iter(source, _STEP_IN, _STEP)
    while True:
        try:
            block = next(blocks, b'')
        except zstandard.ZstdError:
            return
        if not block:
            return
        yield block


def decompress_message(data: Buffer) -> bytes:
    """Decompress a message of rosbag2's message mode.

    Raises:
        ValueError: The message is damaged.
    """
    stream = zstandard.ZstdDecompressor().decompressobj()
    try:
        plain: bytes = stream.decompress(data)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    if not stream.eof:
        raise ValueError('cut off')
    return plain
