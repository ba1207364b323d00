# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PNG headers, read without decoding: enough to name a size and to notice a file that was cut.

Source: the PNG specification (W3C, 3rd edition), sections 5.2, 5.6 and 11.2.2.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from ..errors import BadFileError
from ..samples import Image

if TYPE_CHECKING:
    from pathlib import Path

_SIGNATURE = b'\x89PNG\r\n\x1a\n'
_HEADER = struct.Struct('>8s4s4sIIBB')
_END = b'\x00\x00\x00\x00IEND\xaeB\x60\x82'
TRAILING_BYTES = 64
"""Where the end of a PNG is looked for."""

_GREY = 0
_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 1, 6: 3}


def parse_image(data: bytes, path: Path | str, size: int | None = None) -> Image:
    """An image from a PNG file's bytes.

    Args:
        data: The whole file; its ends of 64 bytes are enough to check it.
        path: The file, for errors.
        size: Bytes of the file, where data is only its ends.

    Raises:
        BadFileError: The file is empty, no PNG, cut short, or of 16 bits a channel and not grey.
    """
    remedy = 'copy the file again from its source'
    if not data:
        raise BadFileError(path, 'the file is empty', 'a PNG image', remedy=remedy)
    if len(data) < _HEADER.size or not data.startswith(_SIGNATURE):
        raise BadFileError(path, 'no PNG signature and header', 'a PNG image', remedy=remedy)
    _, _, kind, width, height, depth, colour = _HEADER.unpack_from(data)
    if kind != b'IHDR' or colour not in _CHANNELS or not width or not height:
        raise BadFileError(path, 'a broken PNG header', 'a PNG image', remedy=remedy)
    if depth > 8 and colour != _GREY:
        expected = 'an image of 8 bits a channel, or of 16 bits grey'
        raise BadFileError(path, f'{depth} bits a channel', expected)
    # Some programs put a few bytes behind the end, which decoders ignore.
    if data.rfind(_END, -TRAILING_BYTES) < 0:
        raise BadFileError(
            path,
            f'the PNG is cut after {len(data) if size is None else size} bytes',
            'an image with its end',
            remedy=remedy,
        )
    return Image(data, width, height, _CHANNELS[colour])
