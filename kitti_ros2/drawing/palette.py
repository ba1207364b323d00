# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Colours of classes and tracks, and the size of the recording car."""

from __future__ import annotations

import colorsys
from zlib import crc32

from ..options.messages import MarkerColors

CLASS_COLORS = {
    'Car': (0.13, 0.59, 0.95),
    'Van': (0.0, 0.74, 0.83),
    'Truck': (0.25, 0.32, 0.71),
    'Tram': (0.40, 0.23, 0.72),
    'Pedestrian': (0.96, 0.26, 0.21),
    'Person_sitting': (1.0, 0.44, 0.26),
    'Person (sitting)': (1.0, 0.44, 0.26),
    'Cyclist': (1.0, 0.76, 0.03),
    'Misc': (0.62, 0.62, 0.62),
}
"""KITTI's classes: red, green, blue, 0..1."""

EGO_COLOR = (0.30, 0.69, 0.31)
EGO_SIZE_LWH = (4.0, 1.7, 1.5)
"""The recording car, a Passat, metres."""

_GOLDEN_TURN = 0.6180339887498949


def rgb_of(kind: str) -> tuple[int, int, int]:
    """Return red, green, blue, 0..255, of a class."""
    red, green, blue = color_of(kind, 0, MarkerColors.CLASS)
    return round(255 * red), round(255 * green), round(255 * blue)


def color_of(kind: str, number: int, colors: MarkerColors) -> tuple[float, float, float]:
    """Return red, green, blue, 0..1, of a class, or of a track's number.

    Unknown classes get a colour by their name, the same in every run.
    """
    if colors is MarkerColors.CLASS and kind in CLASS_COLORS:
        return CLASS_COLORS[kind]
    seed = number if colors is MarkerColors.TRACK else crc32(kind.encode())
    return colorsys.hsv_to_rgb(seed * _GOLDEN_TURN % 1.0, 0.75, 0.95)
