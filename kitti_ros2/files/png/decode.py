# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A PNG decoder: OpenCV, after the image data have been inflated and checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ...model.samples import MOST_PIXELS
from .inflate import inflated

if TYPE_CHECKING:
    import numpy.typing as npt

    from ...model.samples import Image


def decode_png(image: Image) -> npt.NDArray[np.uint8 | np.uint16]:
    """Decode to pixels: (H, W) uint8 or uint16, as in the file, or (H, W, 3) uint8 BGR.

    Of colour of 16 bits these are the upper 8.

    Raises:
        ValueError: The PNG cannot be decoded, or is too large.
    """
    if image.width * image.height > MOST_PIXELS:
        raise ValueError(f'a PNG of {image.width} x {image.height} pixels is not decoded')
    import cv2  # noqa: PLC0415 - 0.2 s that passing PNGs through does not need

    grey = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH
    flag = grey if image.channels == 1 else cv2.IMREAD_COLOR
    file = np.frombuffer(inflated(image.data), dtype=np.uint8)
    try:
        pixels = cv2.imdecode(file, flag)
    except cv2.error:  # more pixels than OpenCV allows
        pixels = None
    if pixels is None or pixels.shape[:2] != (image.height, image.width):
        raise ValueError('the PNG cannot be decoded')
    return cast('npt.NDArray[np.uint8 | np.uint16]', pixels)
