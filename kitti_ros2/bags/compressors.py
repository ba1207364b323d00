# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The compressions that bags know, as functions that any thread may call."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_ZSTD_LEVEL = 3
_LZ4_LEVEL = 0


def compressor(name: str, level: int | None) -> Callable[[bytes], bytes]:
    """The function that compresses a block.

    Args:
        name: zstd or lz4 (frame format).
        level: The effort, None for the compressor's own default.
    """
    if name == 'zstd':
        return partial(_zstd, _ZSTD_LEVEL if level is None else level)
    from lz4 import frame  # noqa: PLC0415 - as below

    return partial(frame.compress, compression_level=_LZ4_LEVEL if level is None else level)


def _zstd(level: int, data: bytes) -> bytes:
    import zstandard  # noqa: PLC0415 - most bags are not compressed

    # A compressor is not to be shared between threads, and cheap to make.
    return zstandard.ZstdCompressor(level=level).compress(data)
