# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image <-> sensor_msgs/CompressedImage (the file's own bytes) and sensor_msgs/Image (pixels)."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ..files.image_files import parse_image
from ..files.png.encode import encode_png
from ..model.samples import Image
from ..options.messages import ColorEncoding
from .header import make_header
from .pixels import decode_pixels
from .ros_types import CompressedImage, ImageMsg

if TYPE_CHECKING:
    from pathlib import PurePath

    from .pixels import Pixels

_GREY = {'uint8': 'mono8', 'uint16': 'mono16'}
_FROM_BGR = {ColorEncoding.RGB8: 'COLOR_BGR2RGB', ColorEncoding.MONO8: 'COLOR_BGR2GRAY'}


def encode_compressed(image: Image, stamp_ns: int, frame_id: str) -> CompressedImage:
    """Wrap the file's own bytes; format is png or jpeg, which image_transport and viewers read."""
    data = np.frombuffer(image.data, dtype=np.uint8)
    return CompressedImage(make_header(stamp_ns, frame_id), image.format, data)


def decode_compressed(message: CompressedImage, path: PurePath) -> Image:
    """Decode an image made by encode_compressed; path is its place, for errors.

    Raises:
        BadFileError: It is empty, no PNG or JPEG, truncated or damaged.
    """
    return parse_image(message.data.tobytes(), str(path))


def encode_pixels(
    pixels: Pixels,
    stamp_ns: int,
    frame_id: str,
    color: ColorEncoding = ColorEncoding.BGR8,
) -> ImageMsg:
    """Wrap the pixels of decode_image: mono8 or mono16 of grey ones, the given encoding of colour.

    Colour becomes mono8 by OpenCV's weights, 0.299 R + 0.587 G + 0.114 B, as in cv_bridge.
    """
    encoding = _GREY[pixels.dtype.name] if pixels.ndim == 2 else color.value
    if pixels.ndim == 3 and color in _FROM_BGR:
        import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

        pixels = cast('Pixels', cv2.cvtColor(pixels, getattr(cv2, _FROM_BGR[color])))
    return ImageMsg(
        header=make_header(stamp_ns, frame_id),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].nbytes,
        data=pixels.reshape(-1).view(np.uint8),
    )


def decode_image(message: ImageMsg) -> Image:
    """Decode any Image to a PNG file of its pixels.

    Raises:
        ValueError: As decode_pixels.
    """
    pixels = decode_pixels(message)
    height, width = pixels.shape[:2]
    return Image(encode_png(pixels), width, height, 1 if pixels.ndim == 2 else 3)
