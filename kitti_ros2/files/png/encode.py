# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A PNG encoder, several times faster than OpenCV with files of about the same size.

Every row is filtered with Sub, each byte less that of the pixel to its left: the residuals of
photographs compress best with it among the filters that cost next to nothing. What follows is
mostly Huffman coding, so deflate searches as near as it can: a larger window costs time and, by
longer codes, size. isal does it at 0.4 GB/s, and zlib where isal is not installed. Both release the
GIL, and the same pixels give the same bytes in any thread.

Formats: PNG (W3C, 3rd edition) sections 5.3, 9 and 11.2, zlib RFC 1950, deflate RFC 1951.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

from ..checksums import adler32, crc32
from ..picture_headers import PNG_SIGNATURE

if TYPE_CHECKING:
    import numpy.typing as npt

_NUMBER = struct.Struct('>I')
_HEADER = struct.Struct('>IIBBBBB')
_GREY, _RGB = 0, 2
_SUB = 1
_ZLIB_HEAD = b'\x78\x01'
_FASTEST = 1
_RAW_DEFLATE = -15
_RAW_DEFLATE_NEAR = -9  # the smallest window of isal
_START_BYTES = 8
_MOST_MEMORY = 9


def encode_png(pixels: npt.NDArray[np.uint8 | np.uint16]) -> bytes:
    """Encode pixels as a PNG file, lossless.

    Args:
        pixels: (H, W), or (H, W, 3) BGR, uint8 or uint16; any strides.

    Raises:
        ValueError: The pixels have another shape or type, or there are none.
    """
    kind = (pixels.dtype.type, pixels.shape[2:])
    if pixels.ndim < 2 or not pixels.size:
        raise ValueError(f'pixels of shape {pixels.shape}')
    if kind == (np.uint8, ()):
        return _file(pixels.view(np.uint8), _GREY, 1, 1)
    if kind == (np.uint16, ()):
        return _file(pixels.astype('>u2', order='C').view(np.uint8), _GREY, 1, 2)
    if kind == (np.uint8, (3,)):
        return _encode_colour(pixels)
    if kind == (np.uint16, (3,)):
        deep = pixels[..., ::-1].astype('>u2', order='C')
        return _file(deep.view(np.uint8).reshape(len(deep), -1), _RGB, 3, 2)
    raise ValueError(f'pixels of shape {pixels.shape} and type {pixels.dtype}')


def _encode_colour(pixels: npt.NDArray[np.uint8 | np.uint16]) -> bytes:
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    rgb = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    return _file(rgb.reshape(len(rgb), -1), _RGB, 3, 1)


def _file(rows: npt.NDArray[np.uint8], colour: int, channels: int, value_bytes: int) -> bytes:
    """Return a PNG file of (H, N) bytes in the file's order."""
    height, row_bytes = rows.shape
    pixel_bytes = channels * value_bytes
    filtered = _filtered(rows, pixel_bytes)
    header = _HEADER.pack(row_bytes // pixel_bytes, height, value_bytes * 8, colour, 0, 0, 0)
    data = [_ZLIB_HEAD, _deflated(filtered), _NUMBER.pack(adler32(filtered))]
    parts = [PNG_SIGNATURE]
    for kind, body in ((b'IHDR', [header]), (b'IDAT', data), (b'IEND', [])):
        crc = crc32(kind)
        for part in body:
            crc = crc32(part, crc)
        parts += [_NUMBER.pack(sum(map(len, body))), kind, *body, _NUMBER.pack(crc)]
    return b''.join(parts)


def _filtered(rows: npt.NDArray[np.uint8], pixel_bytes: int) -> npt.NDArray[np.uint8]:
    """Return (H, N + 1) filtered rows, each preceded by the number of the filter, Sub."""
    height, width = rows.shape
    filtered = np.empty((height, 1 + width), dtype=np.uint8)
    filtered[:, 0] = _SUB
    filtered[:, 1 : 1 + pixel_bytes] = rows[:, :pixel_bytes]
    np.subtract(rows[:, pixel_bytes:], rows[:, :-pixel_bytes], out=filtered[:, 1 + pixel_bytes :])
    return filtered


def _deflated(data: npt.NDArray[np.uint8]) -> bytes:
    """Return a raw deflate stream that depends on the data alone.

    isal's compression of a stream's first bytes hashes the third of them from a register that it
    did not set (tmp2 in igzip_icf_body_h1_gr_bt.asm, after .write_first_byte): it holds an address
    on the thread's stack, and now and then other matches are found. A start of at most 16 bytes,
    flushed on its own, takes another path (igzip_icf_finish.asm), and no later byte is a first.
    """
    try:
        from isal import isal_zlib  # noqa: PLC0415 - a workspace may do without
    except ImportError:
        packer = zlib.compressobj(_FASTEST, zlib.DEFLATED, _RAW_DEFLATE, _MOST_MEMORY, zlib.Z_RLE)
        return packer.compress(data.data) + packer.flush()
    flat = data.reshape(-1)
    near = isal_zlib.compressobj(_FASTEST, isal_zlib.DEFLATED, _RAW_DEFLATE_NEAR)
    return b''.join(
        [
            near.compress(flat[:_START_BYTES]),
            near.flush(isal_zlib.Z_SYNC_FLUSH),
            near.compress(flat[_START_BYTES:]),
            near.flush(),
        ]
    )
