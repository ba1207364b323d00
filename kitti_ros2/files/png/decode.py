# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A PNG decoder: OpenCV, after isal has inflated the image data if it is installed.

Two thirds of decoding is inflating, and isal inflates twice as fast as the zlib in OpenCV's
wheels. So the image data is inflated here and passed on in a PNG whose data is merely stored;
unsupported files go to OpenCV unchanged. Formats: PNG (W3C, 3rd edition) section 5.3,
zlib RFC 1950, deflate RFC 1951 section 3.2.4.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ...model.samples import Image

_NUMBER = struct.Struct('>I')
_CHUNK = struct.Struct('>I4s')
_CHUNK_END = 4
_SIZE = struct.Struct('>II')
_SIZE_OFFSET = 16
_HEADER = struct.Struct('>16xIIBB')
_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Of a pixel, by colour type."""
_MOST_INFLATED = 1032
"""Bytes that a byte of deflated data becomes at most: 258 of each two bits."""
_MOST_PIXEL_BYTES = 8
_SIGNATURE_BYTES = 8
_BLOCK = struct.Struct('<BHH')
_BLOCK_BYTES = 0xFFFF
_STORED_HEAD = b'\x78\x01'


def decode_png(image: Image) -> npt.NDArray[np.uint8 | np.uint16]:
    """Decode to pixels: (H, W) uint8 or uint16, as in the file, or (H, W, 3) uint8 BGR.

    Of colour of 16 bits these are the upper 8.

    Raises:
        ValueError: The PNG cannot be decoded.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    grey = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
    flag = grey if image.channels == 1 else cv2.IMREAD_COLOR
    file = np.frombuffer(inflated(image.png), dtype=np.uint8)
    try:
        pixels = cv2.imdecode(file, flag)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None or pixels.shape[:2] != (image.height, image.width):
        raise ValueError('the PNG cannot be decoded')
    return cast('npt.NDArray[np.uint8 | np.uint16]', pixels)


def inflated(png: bytes) -> bytes:
    """Return the PNG with its image data stored instead of compressed, or png itself.

    Raises:
        ValueError: The data inflate to more than an image of the size in the header, or cannot
            inflate to as much; or a chunk is longer than the file.
    """
    _check_size(png, _check_chunks(png))
    try:
        from isal import isal_zlib  # noqa: PLC0415 - a workspace may do without
    except ImportError:
        return png
    try:
        first, last, parts = _image_data(png)
        inflater = isal_zlib.decompressobj()
        # A few bytes can inflate to all of the memory.
        most = _most_bytes(png)
        raw = inflater.decompress(b''.join(parts), most)
    except (isal_zlib.IsalError, struct.error):  # type: ignore[misc] # a class, unlike in its stub
        return png
    if not inflater.eof:
        if len(raw) < most:
            return png
        raise ValueError('a PNG with more image data than its header states')
    data = b''.join(
        [b'IDAT', _STORED_HEAD, *_blocks(raw), struct.pack('>I', isal_zlib.adler32(raw))]
    )
    length = struct.pack('>I', len(data) - 4)
    crc = struct.pack('>I', isal_zlib.crc32(data))
    return b''.join([memoryview(png)[:first], length, data, crc, memoryview(png)[last:]])


def _check_chunks(png: bytes) -> int:
    """Refuse a chunk beyond the end of the file: OpenCV allocates what it declares, up to 4 GB.

    Returns:
        Bytes of compressed image data.

    Raises:
        ValueError: There is one.
    """
    offset, stored = _SIGNATURE_BYTES, 0
    while offset + _CHUNK.size <= len(png):
        length, kind = _CHUNK.unpack_from(png, offset)
        if offset + _CHUNK.size + length > len(png):
            raise ValueError(
                f'a PNG with a chunk of {length} bytes at byte {offset}, beyond its end'
            )
        if kind == b'IEND':
            break
        stored += length if kind == b'IDAT' else 0
        offset += _CHUNK.size + length + _CHUNK_END
    return stored


def _check_size(png: bytes, stored: int) -> None:
    """Refuse a header of more pixels than the data can have: OpenCV allocates them first.

    Args:
        png: The file.
        stored: Bytes of compressed image data.

    Raises:
        ValueError: It has more, or is cut off.
    """
    if len(png) < _HEADER.size:
        raise ValueError('a PNG whose header is cut off')
    width, height, depth, colour = _HEADER.unpack_from(png)
    row = (width * depth * _SAMPLES.get(colour, 1) + 7) // 8
    if height * row > _MOST_INFLATED * stored:
        raise ValueError(
            f'a PNG of {width} x {height} pixels with {stored} bytes of image data, which is too'
            f' little'
        )


def _most_bytes(png: bytes) -> int:
    """Return the maximum size of the image data in bytes, including filters and interlacing.

    Raises:
        struct.error: The header is cut off.
    """
    width, height = _SIZE.unpack_from(png, _SIZE_OFFSET)
    return int(2 * height * (width + 1) * _MOST_PIXEL_BYTES)


def _image_data(png: bytes) -> tuple[int, int, list[memoryview]]:
    """Return the start of the first IDAT chunk, the end of the last, and their contents.

    Raises:
        struct.error: A chunk is cut off.
    """
    view = memoryview(png)
    parts: list[memoryview] = []
    first, offset, kind = 0, _SIGNATURE_BYTES, b''
    while kind != b'IEND':
        length, kind = _CHUNK.unpack_from(png, offset)
        body = offset + _CHUNK.size
        if kind == b'IDAT':
            first = first or offset
            parts.append(view[body : body + length])
        elif parts:
            return first, offset, parts
        offset = body + length + _CHUNK_END
    return offset, offset, parts


def _blocks(raw: bytes) -> list[bytes | memoryview]:
    """Split data into stored deflate blocks, each preceded by its header."""
    view = memoryview(raw)
    blocks: list[bytes | memoryview] = []
    for start in range(0, len(raw) or 1, _BLOCK_BYTES):
        block = view[start : start + _BLOCK_BYTES]
        final = start + _BLOCK_BYTES >= len(raw)
        blocks += [_BLOCK.pack(final, len(block), len(block) ^ 0xFFFF), block]
    return blocks
