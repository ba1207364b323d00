# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Colours of points in Rerun's format: 0xRRGGBBAA."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.samples import Float32Array

# Nine of the colours of viridis (S. van der Walt, N. Smith; CC0), evenly spaced.
_VIRIDIS = (
    (68, 1, 84),
    (71, 44, 122),
    (59, 81, 139),
    (44, 113, 142),
    (33, 144, 141),
    (39, 173, 129),
    (92, 200, 99),
    (170, 220, 50),
    (253, 231, 37),
)
_HEIGHTS_M = (-2.5, 2.5)


def _palette() -> npt.NDArray[np.uint32]:
    """Return (256,) colours from dark to bright."""
    places = np.linspace(0, len(_VIRIDIS) - 1, 256)
    channels = np.array(_VIRIDIS, np.float64).T
    red, green, blue = (
        np.interp(places, range(len(_VIRIDIS)), channel).round().astype(np.uint32)
        for channel in channels
    )
    packed: npt.NDArray[np.uint32] = red << 24 | green << 16 | blue << 8 | 0xFF
    return packed


_PALETTE = _palette()


def reflectance_colors(reflectance: Float32Array) -> npt.NDArray[np.uint32]:
    """Return (N,) colours of reflectances 0..1, by their square root, as most are low."""
    return _PALETTE.take((np.sqrt(reflectance) * 255).astype(np.uint8))


def height_colors(points: Float32Array) -> npt.NDArray[np.uint32]:
    """Return (N,) colours of (N, 3+) points by z, from 2.5 m below to 2.5 m above the sensor."""
    low, high = _HEIGHTS_M
    share: Float32Array = np.clip((points[:, 2] - low) / (high - low), 0, 1)
    return _PALETTE.take((share * 255).astype(np.uint8))
