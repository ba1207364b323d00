# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: image files, whose headers are read before they are decoded."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from kitti_ros2.files.image_files import (
    decode_png,
    inflated,
    is_webp,
    is_whole_webp,
    jpeg_size,
    parse_png,
    png_chunks,
    png_size,
    webp_size,
)

from .inputs import files, found
from .target import Target

PATH = Path('folder/image.png')


def _png(data: bytes) -> None:
    for read in (png_size, jpeg_size, webp_size, is_webp, is_whole_webp):
        read(data)
    with suppress(ValueError):  # what its callers report
        png_chunks(data)
    with suppress(ValueError):
        inflated(data)
    image = parse_png(data, PATH)
    with suppress(ValueError):
        decode_png(image)


def _checksummed(data: bytes) -> bytes:
    """Correct the checksums of the chunks of a PNG."""
    parts, at = [data[:8]], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from('>I', data, at)
        body = data[at + 4 : at + 8 + length]
        parts += [data[at : at + 4], body, struct.pack('>I', zlib.crc32(body))]
        at += 12 + length
    return b''.join(parts) + data[at:]


def _pngs() -> list[bytes]:
    png = files('*.png', most=1)[0]
    at = png.index(b'IDAT') - 4
    damaged = (png[:20], png[:-8], png[: at + 30], png[:-6] + b'xxIEND', png[:-12], png[:at])
    wide = png[:16] + struct.pack('>II', 2**15, 2**15) + png[24:]
    return [
        *files('*.png', most=1),
        *damaged,
        wide,
        *_pictures(),
        *found('png4g/*/*/image_?/*.png')[:2],
    ]


def _pictures() -> list[bytes]:
    """JPEG and WebP files, and the headers of each kind of WebP."""
    grey = np.arange(96, dtype=np.uint8).reshape(8, 12)
    made = [cv2.imencode(suffix, grey)[1].tobytes() for suffix in ('.jpg', '.webp')]
    kinds = (b'VP8 ', b'VP8L', b'VP8X', b'VP9 ')
    webps = [b'RIFF' + struct.pack('<I', 30) + b'WEBP' + kind + bytes(range(24)) for kind in kinds]
    return [*made, *webps, b'\xff\xd8\xff\xff\xff\xe0\0\2\xff\xd9', webps[0][:22]]


TARGETS = (
    Target('png', _png, _pngs,
           ('files/image_files.py',),
           (b'IHDR', b'IDAT', b'IEND', b'PLTE', b'tRNS', b'\xff\xd8\xff\xc0', b'RIFF', b'WEBP'),
           mend=_checksummed, long=100_000),
)  # fmt: skip
"""All of them."""
