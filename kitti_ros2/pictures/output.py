# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes pictures in the format of their file names, and limits what --overwrite replaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.replacing import keep_all_but_files
from ..model.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from ..drawing.pixels import Pixels

# An MP4 file begins with the length of its first box, which is short.
_FILMS = tuple(bytes([0, 0, 0, length]) for length in range(16, 64))
keep_all_but_pictures = keep_all_but_files(
    'picture or film', (b'\x89PNG', b'\xff\xd8\xff', b'RIFF', *_FILMS)
)
"""The refusal for --overwrite: it replaces only pictures and films."""

PICTURES = ('.png', '.jpg', '.jpeg', '.webp')
_JPEG_QUALITY = 92


def write_picture(path: Path, picture: Pixels) -> None:
    """Write (H, W, 3) uint8 BGR in the format of the file name's suffix.

    Raises:
        UsageError: The suffix is unsupported.
        OSError: The file cannot be written.
    """
    path.write_bytes(encode_picture(picture, path.suffix))


def encode_picture(picture: Pixels, suffix: str, jpeg_quality: int = _JPEG_QUALITY) -> bytes:
    """Encode a picture in the format of a suffix, such as .png.

    Raises:
        UsageError: The suffix is unsupported.
    """
    import cv2  # noqa: PLC0415 - 0.2 s that a command which draws nothing does not need

    from ..files.png.encode import encode_png  # noqa: PLC0415 - as above

    ending = suffix.lower()
    if ending not in PICTURES:
        raise UsageError(f'a picture ends in {", ".join(PICTURES)}, not in {suffix or "nothing"}')
    if ending == '.png':
        return encode_png(picture)
    settings = [] if ending == '.webp' else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    done, data = cv2.imencode(ending, picture, settings)
    if not done:
        raise UsageError(f'this OpenCV writes no {suffix}; choose .png')
    return data.tobytes()
