# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The size of a PNG, JPEG or WebP and the chunks of a PNG, from the bytes of any program's file.

Sources: PNG (W3C, 3rd edition), sections 5.2 and 5.3; ITU T.81 (JPEG), B.1.1.3 and B.2.2; RFC 9649
(WebP), sections 2.4 to 2.7 and 3.4; RFC 6386 (VP8), section 9.1.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from .checksums import crc32

PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'
JPEG_SIGNATURE = b'\xff\xd8\xff'
_RIFF_HEAD = 8
_WEBP_BODY = 10
_CHUNK = struct.Struct('>I4s')
_CRC_AND_CHUNK = struct.Struct('>II4s')
_CRC_BYTES = 4
_PNG_SIZE = struct.Struct('>16xII')
# Frame headers are C0 to CF without C4, C8 and CC.
_JPEG_SEGMENT = struct.Struct('>BBH')
_JPEG_FRAME = struct.Struct('>BHHB')
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def png_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros if the header is truncated."""
    return _PNG_SIZE.unpack_from(data) if len(data) >= _PNG_SIZE.size else (0, 0)


class JpegFrame(NamedTuple):
    """The frame header of a JPEG: its size, its number of components, and where it ends."""

    width: int
    height: int
    components: int
    end: int


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros without a frame header."""
    frame = jpeg_frame(data)
    return (0, 0) if frame is None else frame[:2]


def jpeg_frame(data: bytes) -> JpegFrame | None:
    """Return the frame header; None without one."""
    offset = 2
    while offset + _JPEG_SEGMENT.size + _JPEG_FRAME.size <= len(data):
        mark, kind, length = _JPEG_SEGMENT.unpack_from(data, offset)
        if mark != 0xFF:
            break
        if kind in _JPEG_FRAMES:
            _, height, width, count = _JPEG_FRAME.unpack_from(data, offset + _JPEG_SEGMENT.size)
            return JpegFrame(width, height, count, offset + 2 + length)
        # Fill bytes before a marker, and markers without a segment, are one and two bytes.
        offset += 1 if kind == 0xFF else 2 + length
    return None


def is_webp(data: bytes) -> bool:
    """Whether data begin as a WebP."""
    return data[:4] == b'RIFF' and data[8:12] == b'WEBP'


def is_whole_webp(data: bytes) -> bool:
    """Whether a WebP has all the bytes that its header states."""
    return len(data) >= _RIFF_HEAD + int.from_bytes(data[4:8], 'little')


def webp_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); zeros if the header is truncated or of an unknown kind."""
    kind, body = data[12:16], data[20:30]
    if len(body) < _WEBP_BODY:
        return 0, 0
    if kind == b'VP8X':
        width, height = (int.from_bytes(body[at : at + 3], 'little') + 1 for at in (4, 7))
        return width, height
    if kind == b'VP8L':
        bits = int.from_bytes(body[1:5], 'little')
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b'VP8 ':
        width, height = (int.from_bytes(body[at : at + 2], 'little') & 0x3FFF for at in (6, 8))
        return width, height
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
