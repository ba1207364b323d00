# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The size of a PNG or JPEG and the chunks of a PNG, from the bytes of any program's file.

Sources: PNG (W3C, 3rd edition), sections 5.2 and 5.3; ITU T.81 (JPEG), B.1.1.3 and B.2.2.
"""

from __future__ import annotations

import struct

from .checksums import crc32

PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'
_CHUNK = struct.Struct('>I4s')
_CRC_AND_CHUNK = struct.Struct('>II4s')
_CRC_BYTES = 4
_PNG_SIZE = struct.Struct('>16xII')
# Frame headers are C0 to CF without C4, C8 and CC.
_JPEG_SEGMENT = struct.Struct('>BBH')
_JPEG_SIZE = struct.Struct('>BHH')
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def png_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros if the header is truncated."""
    return _PNG_SIZE.unpack_from(data) if len(data) >= _PNG_SIZE.size else (0, 0)


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros without a frame header."""
    offset = 2
    while offset + _JPEG_SEGMENT.size + _JPEG_SIZE.size <= len(data):
        mark, kind, length = _JPEG_SEGMENT.unpack_from(data, offset)
        if mark != 0xFF:
            break
        if kind in _JPEG_FRAMES:
            _, height, width = _JPEG_SIZE.unpack_from(data, offset + _JPEG_SEGMENT.size)
            return width, height
        # Fill bytes before a marker, and markers without a segment, are one and two bytes.
        offset += 1 if kind == 0xFF else 2 + length
    return 0, 0


def png_chunks(png: bytes) -> tuple[set[bytes], int] | None:
    """Return the kinds of a PNG's chunks and the end of the last one, None if it is truncated.

    Raises:
        ValueError: The checksum of a chunk is wrong.
    """
    view, size = memoryview(png), len(png)
    offset = len(PNG_SIGNATURE)
    if offset + _CHUNK.size > size:
        return None
    length, kind = _CHUNK.unpack_from(png, offset)
    kinds = {kind}
    end = offset + _CHUNK.size + length
    # One unpacking a chunk: OpenCV writes one every 8 KiB.
    while kind != b'IEND' and end + _CRC_AND_CHUNK.size <= size:
        crc, length, following = _CRC_AND_CHUNK.unpack_from(png, end)
        if crc32(view[offset + 4 : end]) != crc:
            raise _wrong_checksum(kind, offset)
        offset, kind = end + _CRC_BYTES, following
        kinds.add(kind)
        end = offset + _CHUNK.size + length
    if end + _CRC_BYTES > size:
        return None
    if crc32(view[offset + 4 : end]) != int.from_bytes(view[end : end + _CRC_BYTES], 'big'):
        raise _wrong_checksum(kind, offset)
    return (kinds, end + _CRC_BYTES) if kind == b'IEND' else None


def _wrong_checksum(kind: bytes, offset: int) -> ValueError:
    name = kind.decode('ascii', 'replace')
    return ValueError(f'the PNG is damaged: its {name} at byte {offset} has a wrong checksum')
