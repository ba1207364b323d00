# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PNG files as OpenCV decodes them fastest and without a word: inflated, checked, nothing else.

Two thirds of decoding is inflating, and isal inflates twice as fast as the zlib in OpenCV's
wheels. So the image data is inflated here and passed on in a PNG whose data is merely stored.
libpng prints what it does not like to standard error, and OpenCV allocates what a file declares;
so what they would find is found here, and chunks that do not change pixels are left out.
Formats: PNG (W3C, 3rd edition) sections 5.3, 8 and 11.2, zlib RFC 1950, deflate RFC 1951 section
3.2.4.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..checksums import adler32, crc32
from ..picture_headers import PNG_SIGNATURE

if TYPE_CHECKING:
    from collections.abc import Iterator

_LIBRARY: Any = zlib
try:
    from isal import isal_zlib
except ImportError:
    pass  # a workspace may do without
else:
    _LIBRARY = isal_zlib

_CHUNK = struct.Struct('>I4s')
_NUMBER = struct.Struct('>I')
_CRC_BYTES = 4
_HEADER = struct.Struct('>IIBBBBB')
_MOST_SIDE = 10**6
"""Pixels of a row or a column that libpng takes."""
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Of a pixel, by colour type."""
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
_PALETTE = 3
_ENTRY_BYTES = 3
_LAST_FILTER = 4
_PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
           (0, 1, 1, 2))  # fmt: skip
"""Of Adam7: first column and row, and the distance of columns and rows."""
_MOST_INFLATED = 1032
"""Bytes that a byte of deflated data becomes at most: 258 of each two bits."""
_MOST_BEYOND = 2**16
"""Bytes of image data beyond the image that some encoders write, and decoders ignore."""
_UPPER_CASE = 0x20
_BLOCK = struct.Struct('<BHH')
_BLOCK_BYTES = 0xFFFF
_STORED_HEAD = b'\x78\x01'


class _PixelRows(NamedTuple):
    """The rows of an image, or of a part if it is interlaced: each a filter's number, and bytes."""

    rows: int
    row_bytes: int


def inflated(png: bytes) -> bytes:
    """Return a PNG of the same pixels, stored instead of compressed, without any other chunk.

    Args:
        png: A file that begins with PNG's signature. Checksums of chunks are not checked.

    Raises:
        ValueError: It is damaged or cut off; it has fewer image data than its header states, or so
            many that they would fill the memory; or libpng does not take it.
    """
    header, palette, parts = _essence(png)
    width, height, depth, colour, *methods = header
    if depth not in _DEPTHS.get(colour, ()) or methods not in ([0, 0, 0], [0, 0, 1]):
        raise ValueError(f'a PNG of colour type {colour} with {depth} bits, methods {methods}')
    passes = _passes(width, height, depth * _SAMPLES[colour], interlaced=methods[-1] == 1)
    size = sum(each.rows * each.row_bytes for each in passes)
    stored = sum(map(len, parts))
    if size > _MOST_INFLATED * stored:
        raise ValueError(
            f'a PNG of {width} x {height} pixels with {stored} bytes of image data, which is too'
            f' little'
        )
    if not (0 < width <= _MOST_SIDE and 0 < height <= _MOST_SIDE):
        raise ValueError(f'a PNG of {width} x {height} pixels')
    raw = _inflate(parts, size)
    _check_filters(raw, passes)
    made = [PNG_SIGNATURE, *_chunk(b'IHDR', _HEADER.pack(*header))]
    if colour == _PALETTE:
        # All entries that pixels may name: libpng complains about others.
        most = _ENTRY_BYTES << depth
        made += _chunk(b'PLTE', bytes(palette[:most]).ljust(most, b'\0'))
    made += _chunk(b'IDAT', _STORED_HEAD, *_blocks(raw), _NUMBER.pack(adler32(raw)))
    return b''.join([*made, *_chunk(b'IEND')])


def _essence(png: bytes) -> tuple[tuple[int, ...], memoryview, list[memoryview]]:
    """Return the header, the palette, and the consecutive pieces of image data.

    Raises:
        ValueError: A chunk is longer than the file, unknown and critical, or missing.
    """
    header: tuple[int, ...] = ()
    palette, parts, last = memoryview(b''), list[memoryview](), b''
    for kind, body in _chunks(png):
        if kind == b'IHDR' and len(body) == _HEADER.size and not header:
            header = _HEADER.unpack(body)
        elif kind == b'IDAT':
            if not parts or last == kind:
                parts.append(body)
        elif kind == b'PLTE':
            palette = palette if parts else body
        elif not kind[0] & _UPPER_CASE:
            raise ValueError(f'a PNG with a chunk {kind!r} that no decoder knows')
        last = kind
    if not header:
        raise ValueError('a PNG whose header is cut off')
    if header[3] == _PALETTE and (not palette or len(palette) % _ENTRY_BYTES):
        raise ValueError('a PNG without the palette that its pixels refer to')
    return header, palette, parts


def _chunks(png: bytes) -> Iterator[tuple[bytes, memoryview]]:
    """Yield the kind and the body of the chunks up to the end, or to where the file is cut.

    Raises:
        ValueError: One is longer than the file: OpenCV would allocate what it declares.
    """
    view, offset = memoryview(png), len(PNG_SIGNATURE)
    while offset + _CHUNK.size <= len(png):
        length, kind = _CHUNK.unpack_from(png, offset)
        body = offset + _CHUNK.size
        if body + length > len(png):
            raise ValueError(
                f'a PNG with a chunk of {length} bytes at byte {offset}, beyond its end'
            )
        if kind == b'IEND':
            return
        yield kind, view[body : body + length]
        offset = body + length + _CRC_BYTES


def _passes(width: int, height: int, bits: int, *, interlaced: bool) -> list[_PixelRows]:
    """Return the rows of an image's passes, which are one unless it is interlaced."""
    found = []
    for left, top, right, down in _PASSES if interlaced else ((0, 0, 1, 1),):
        columns, rows = -(-(width - left) // right), -(-(height - top) // down)
        if columns > 0 and rows > 0:
            found.append(_PixelRows(rows, 1 + (columns * bits + 7) // 8))
    return found


def _inflate(parts: list[memoryview], size: int) -> bytes:
    """Return the bytes of an image.

    Raises:
        ValueError: The data are damaged, or inflate to fewer or to many more.
    """
    inflater = _LIBRARY.decompressobj()
    most = size + _MOST_BEYOND
    try:
        raw: bytes = inflater.decompress(b''.join(parts), most)
    except _LIBRARY.error:
        raise ValueError('a PNG whose image data are damaged') from None
    if len(raw) < size:
        raise ValueError(f'a PNG with {len(raw)} of the {size} bytes of its image')
    if len(raw) == most and not inflater.eof:
        raise ValueError('a PNG with more image data than its header states')
    return raw if len(raw) == size else raw[:size]


def _check_filters(raw: bytes, passes: list[_PixelRows]) -> None:
    """Refuse a row with a filter that does not exist.

    Raises:
        ValueError: There is one.
    """
    values, start = np.frombuffer(raw, np.uint8), 0
    for rows, row_bytes in passes:
        end = start + rows * row_bytes
        if values[start:end:row_bytes].max() > _LAST_FILTER:
            raise ValueError('a PNG with a row whose filter does not exist')
        start = end


def _chunk(kind: bytes, *parts: bytes | memoryview) -> list[bytes | memoryview]:
    """Return the parts of a chunk: joined later, with those of others, they are copied once."""
    checksum = crc32(kind)
    for part in parts:
        checksum = crc32(part, checksum)
    return [_NUMBER.pack(sum(map(len, parts))), kind, *parts, _NUMBER.pack(checksum)]


def _blocks(raw: bytes) -> list[bytes | memoryview]:
    """Split data into stored deflate blocks, each preceded by its header."""
    view = memoryview(raw)
    blocks: list[bytes | memoryview] = []
    for start in range(0, len(raw), _BLOCK_BYTES):
        block = view[start : start + _BLOCK_BYTES]
        final = start + _BLOCK_BYTES >= len(raw)
        blocks += [_BLOCK.pack(final, len(block), len(block) ^ 0xFFFF), block]
    return blocks
