# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image files of a data set: KITTI's PNG, and the JPEG of sets of others in its folders.

The kind is detected from the bytes: some programs give a JPEG the name of a PNG.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ..model.errors import BadFileError
from ..model.samples import JPEG, MOST_PIXELS, Image
from .jpeg import decode_jpeg
from .picture_headers import JPEG_SIGNATURE, jpeg_frame
from .png.decode import decode_png
from .png.header import parse_png

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

_JPEG_END = b'\xff\xd9'
_REMEDY = 'copy the file again from its source'


def parse_image(data: bytes, path: Path | str, size: int | None = None) -> Image:
    """Parse an image from the bytes of its file, without decoding it.

    Args:
        data: The whole file; of a PNG its two ends are enough, as parse_png says.
        path: The file, for errors.
        size: Bytes of the file, where data is only its ends.

    Raises:
        BadFileError: The file is empty, no PNG or JPEG, truncated or damaged.
    """
    if not data.startswith(JPEG_SIGNATURE):
        return parse_png(data, path, size)
    frame = jpeg_frame(data)
    if frame is None or not frame.width or not frame.height:
        raise BadFileError(path, 'a broken JPEG header', 'a JPEG image', remedy=_REMEDY)
    # A thumbnail before the frame has an end of its own.
    if data.find(_JPEG_END, frame.end) < 0:
        found = f'the JPEG is cut after {len(data) if size is None else size} bytes'
        raise BadFileError(path, found, 'an image with its end', remedy=_REMEDY)
    return Image(data, frame.width, frame.height, 1 if frame.components == 1 else 3, JPEG)


def decode_image(image: Image) -> npt.NDArray[np.uint8 | np.uint16]:
    """Decode to pixels: (H, W) uint8 or uint16, as in the file, or (H, W, 3) uint8 BGR.

    Raises:
        ValueError: The image is corrupt or too large, or cannot be decoded.
    """
    if image.format != JPEG:
        return decode_png(image)
    if image.width * image.height > MOST_PIXELS:
        raise ValueError(f'a JPEG of {image.width} x {image.height} pixels is not decoded')
    import cv2  # noqa: PLC0415 - 0.2 s that passing files through does not need

    # A camera's calibration is of the pixels as stored, whatever the orientation in EXIF.
    kind = cv2.IMREAD_GRAYSCALE if image.channels == 1 else cv2.IMREAD_COLOR
    file = np.frombuffer(image.data, dtype=np.uint8)
    try:
        pixels = decode_jpeg(file, kind | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None or pixels.shape[:2] != (image.height, image.width):
        raise ValueError('the JPEG cannot be decoded')
    return cast('npt.NDArray[np.uint8 | np.uint16]', pixels)
