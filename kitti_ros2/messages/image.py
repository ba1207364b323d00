# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image <-> sensor_msgs/CompressedImage (the PNG's own bytes) and sensor_msgs/Image (pixels)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.png.encode import encode_png
from ..files.png.header import parse_image
from ..model.samples import Image
from .header import make_header
from .pixels import decode_pixels
from .ros_types import CompressedImage, ImageMsg

if TYPE_CHECKING:
    from pathlib import PurePath

    import numpy.typing as npt

_ENCODINGS = {('uint8', 2): 'mono8', ('uint16', 2): 'mono16', ('uint8', 3): 'bgr8'}


def encode_compressed(image: Image, stamp_ns: int, frame_id: str) -> CompressedImage:
    """Wrap the PNG file's own bytes; format is 'png', which image_transport and viewers read."""
    data = np.frombuffer(image.png, dtype=np.uint8)
    return CompressedImage(make_header(stamp_ns, frame_id), 'png', data)


def decode_compressed(message: CompressedImage, path: PurePath) -> Image:
    """Decode an image made by encode_compressed; path is its place, for errors.

    Raises:
        BadFileError: It is empty, not a PNG, truncated or damaged.
    """
    return parse_image(message.data.tobytes(), str(path))


def encode_pixels(
    pixels: npt.NDArray[np.uint8 | np.uint16], stamp_ns: int, frame_id: str
) -> ImageMsg:
    """Wrap the pixels of decode_png: mono8 or mono16 of grey ones, bgr8 of colour."""
    return ImageMsg(
        header=make_header(stamp_ns, frame_id),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=_ENCODINGS[pixels.dtype.name, pixels.ndim],
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
