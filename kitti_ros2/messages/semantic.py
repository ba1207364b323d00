# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of SemanticKITTI's classes, as the rgb field of point clouds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

# Class to 0xRRGGBB; source: color_map of semantic-kitti.yaml in semantic-kitti-api.
COLORS = {
    0: 0x000000, 1: 0xFF0000, 10: 0x6496F5, 11: 0x64E6F5, 13: 0x6450FA, 15: 0x1E3C96,
    16: 0x0000FF, 18: 0x501EB4, 20: 0x0000FF, 30: 0xFF1E1E, 31: 0xFF28C8, 32: 0x961E5A,
    40: 0xFF00FF, 44: 0xFF96FF, 48: 0x4B004B, 49: 0xAF004B, 50: 0xFFC800, 51: 0xFF7832,
    52: 0xFF9600, 60: 0x96FFAA, 70: 0x00AF00, 71: 0x873C00, 72: 0x96F050, 80: 0xFFF096,
    81: 0xFF0000, 99: 0x32FFFF, 252: 0x6496F5, 253: 0xFF28C8, 254: 0xFF1E1E, 255: 0x961E5A,
    256: 0x0000FF, 257: 0x6450FA, 258: 0x501EB4, 259: 0x0000FF,
}  # fmt: skip
_UNKNOWN = 0x808080

_TABLE = np.full(1 << 16, _UNKNOWN, dtype=np.uint32)
_TABLE[list(COLORS)] = list(COLORS.values())


def packed_colors(classes: npt.NDArray[np.uint16]) -> npt.NDArray[np.float32]:
    """Return (N,) float32 with the bits 0x00RRGGBB, the format of the field rgb in PCL and RViz."""
    return _TABLE[classes].view(np.float32)
