# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Image <-> sensor_msgs/CompressedImage (the PNG's own bytes); -> sensor_msgs/Image (pixels)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.png.decode import decode_png
from .header import make_header
from .ros_types import CompressedImage, ImageMsg

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Image

_ENCODINGS = {('uint8', 2): 'mono8', ('uint16', 2): 'mono16', ('uint8', 3): 'bgr8'}


def encode_compressed(image: Image, stamp_ns: int, frame_id: str) -> CompressedImage:
    """Wrap the PNG file's own bytes; format is 'png', which image_transport and viewers read."""
    data = np.frombuffer(image.png, dtype=np.uint8)
    return CompressedImage(make_header(stamp_ns, frame_id), 'png', data)


def decode_compressed(message: CompressedImage) -> bytes:
    """Return the file's bytes of an image made by encode_compressed."""
    return message.data.tobytes()


def encode_image(image: Image, stamp_ns: int, frame_id: str) -> ImageMsg:
    """Decode to pixels: mono8 or mono16 of a grey PNG, bgr8 of a colour one.

    Raises:
        ValueError: The PNG cannot be decoded.
    """
    return encode_pixels(decode_png(image), stamp_ns, frame_id)


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
