# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of PNG files without decoding: header, chunks and their checksums.

Source: the PNG specification (W3C, 3rd edition), sections 5.2 to 5.6 and 11.2.2.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from ...model.errors import BadFileError
from ...model.samples import Image
from ..checksums import crc32
from ..picture_headers import PNG_SIGNATURE

if TYPE_CHECKING:
    from pathlib import Path

_SIGNED_HEADER = struct.Struct('>8s4s4sIIBB')
_END = b'\x00\x00\x00\x00IEND\xaeB\x60\x82'
_CHUNK = struct.Struct('>I4s')
_CRC_AND_CHUNK = struct.Struct('>II4s')
TRAILING_BYTES = 64
"""The end of a PNG is searched in so many of the last bytes."""

_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 1, 6: 3}


_REMEDY = 'copy the file again from its source'


def parse_png(data: bytes, path: Path | str, size: int | None = None) -> Image:
    """Parse an image from the bytes of a PNG file.

    Args:
        data: The whole file, or its two ends of 64 bytes, whose checksums are not checked.
        path: The file, for errors.
        size: Bytes of the file, where data is only its ends.

    Raises:
        BadFileError: The file is empty, not a PNG, truncated or damaged.
    """
    if not data:
        raise BadFileError(path, 'the file is empty', 'a PNG image', remedy=_REMEDY)
    if len(data) < _SIGNED_HEADER.size or not data.startswith(PNG_SIGNATURE):
        raise BadFileError(path, 'no PNG signature and header', 'a PNG image', remedy=_REMEDY)
    _, _, kind, width, height, _, colour = _SIGNED_HEADER.unpack_from(data)
    if kind != b'IHDR' or colour not in _CHANNELS or not width or not height:
        raise BadFileError(path, 'a broken PNG header', 'a PNG image', remedy=_REMEDY)
    # Some programs put a few bytes behind the end, which decoders ignore.
    if data.rfind(_END, -TRAILING_BYTES) < 0:
        raise BadFileError(
            path,
            f'the PNG is cut after {len(data) if size is None else size} bytes',
            'an image with its end',
            remedy=_REMEDY,
        )
    if size is None:
        found = _find_damage(data)
        if found:
            raise BadFileError(path, f'the PNG is damaged: {found}', 'an image', remedy=_REMEDY)
    return Image(data, width, height, _CHANNELS[colour])


def _find_damage(data: bytes) -> str:
    """Return the first chunk with a wrong length or checksum; '' for a valid PNG.

    Args:
        data: A PNG file that ends with IEND and at most TRAILING_BYTES.
    """
    view = memoryview(data)
    offset, head, unpack = len(PNG_SIGNATURE), _CHUNK.size, _CRC_AND_CHUNK.unpack_from
    last = len(data) - _CRC_AND_CHUNK.size
    length, kind = _CHUNK.unpack_from(data, offset)
    kinds = set()
    while kind != b'IEND':
        end = offset + head + length
        if end > last:
            return f'its {_name(kind)} at byte {offset} has a wrong length, {length}'
        crc, next_length, next_kind = unpack(data, end)
        # The length is not part of the checksum, but a wrong one leads to a wrong place.
        if crc32(view[offset + 4 : end]) != crc:
            return f'its {_name(kind)} at byte {offset} has a wrong checksum or length'
        kinds.add(kind)
        offset, length, kind = end + 4, next_length, next_kind
    if not data.startswith(_END, offset) or len(data) - offset > TRAILING_BYTES:
        return f'its IEND at byte {offset} is not its end'
    return '' if b'IDAT' in kinds else 'it has no image data (IDAT)'


def _name(kind: bytes) -> str:
    """A chunk's type, whatever its bytes are."""
    return kind.decode('ascii', 'backslashreplace')
