# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The compressions that bags know, undone: whole blocks, and the beginning of one that is cut."""

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
# What their libraries let out: lz4 raises RuntimeError, bz2 OSError; a damaged size is too large.
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
_STEP_IN = 2**14  # what is decompressed of a step is lost where the step is damaged

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
    """A whole block.

    Args:
        name: zstd, lz4 (frame format), bz2; empty or none for what is not compressed.
        data: The block.
        size: Its bytes before compression.

    Raises:
        ValueError: It is damaged, or the compression is unknown.
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
    """As much of a block that was cut off as can be had."""
    if name in UNCOMPRESSED:
        return data
    return b''.join(decompress_stream(name, _slices(data))) if name in _STREAMS else b''


def decompress_stream(name: str, slices: Iterator[Buffer]) -> Iterator[bytes]:
    """What slices of a block hold, one after the other, up to where it is damaged or cut."""
    stream = _STREAMS[name]()
    for piece in slices:
        try:
            data = stream.decompress(piece)
        except _ERRORS:
            return
        yield data


def decompress_file(source: BinaryIO) -> Iterator[bytes]:
    """What a file that was compressed by zstd holds, in small blocks, up to where it is damaged."""
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
    """A message that rosbag2 compressed by itself.

    Raises:
        ValueError: It is damaged.
    """
    stream = zstandard.ZstdDecompressor().decompressobj()
    try:
        plain: bytes = stream.decompress(data)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    if not stream.eof:
        raise ValueError('cut off')
    return plain


def _slices(data: Buffer) -> Iterator[memoryview]:
    view = memoryview(data)
    return (view[start : start + _STEP] for start in range(0, len(view), _STEP))
