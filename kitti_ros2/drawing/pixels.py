# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The pixel array that is drawn on."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Pixels: TypeAlias = npt.NDArray[np.uint8]
"""(H, W, 3) uint8, BGR."""


def colour_pixels(pixels: npt.NDArray[np.uint8 | np.uint16]) -> Pixels:
    """Convert (H, W) grey or (H, W, 3) BGR pixels to (H, W, 3) uint8 BGR; of 16 bits the upper 8.

    Colour pixels of 8 bits are returned without a copy.
    """
    import cv2  # noqa: PLC0415 - takes 0.2 s; commands without drawing skip it

    upper = pixels if pixels.dtype == np.uint8 else pixels // 256
    values = upper.astype(np.uint8, copy=False)
    return values if values.ndim == 3 else np.asarray(cv2.cvtColor(values, cv2.COLOR_GRAY2BGR))
