# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The compressions of bags, as thread-safe functions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_ZSTD_LEVEL = 3
_LZ4_LEVEL = 0

POOL_AHEAD = 2  # few, because each pending chunk takes megabytes


def compressor(name: str, level: int | None) -> Callable[[bytes], bytes]:
    """Return the function that compresses a block.

    Args:
        name: zstd or lz4 (frame format).
        level: The compression level, None for the compressor's own default.
    """
    if name == 'zstd':
        return partial(_zstd, _ZSTD_LEVEL if level is None else level)
    from lz4 import frame  # noqa: PLC0415 - as below

    return partial(frame.compress, compression_level=_LZ4_LEVEL if level is None else level)


def ros1_lz4(data: bytes) -> bytes:
    """Compress to an lz4 frame that ROS 1 reads.

    roslz4, the reader of rosbag, rejects a frame unless its blocks are independent, its content
    has a checksum, and its header names no content size. ROS 1 writes blocks of 1 MiB.

    Source: ros_comm, utilities/roslz4/src/lz4s.c, processHeader.
    """
    from lz4 import frame  # noqa: PLC0415 - most bags are not compressed

    compressed: bytes = frame.compress(
        data,
        compression_level=_LZ4_LEVEL,
        block_size=frame.BLOCKSIZE_MAX1MB,
        block_linked=False,
        content_checksum=True,
        store_size=False,
    )
    return compressed


def _zstd(level: int, data: bytes) -> bytes:
    import zstandard  # noqa: PLC0415 - most bags are not compressed

    # A compressor is not thread-safe, and cheap to create.
    return zstandard.ZstdCompressor(level=level).compress(data)
