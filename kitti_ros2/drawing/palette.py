# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Colours of classes and tracks, and the size of the recording car."""

from __future__ import annotations

import colorsys
from zlib import crc32

from ..model.matching import Verdict
from ..options.markers import MarkerColors

CLASS_COLORS = {
    'Car': (2, 150, 249),
    'Van': (5, 163, 183),
    'Truck': (36, 84, 225),
    'Tram': (141, 71, 142),
    'Pedestrian': (203, 84, 76),
    'Person_sitting': (181, 86, 131),
    'Person (sitting)': (181, 86, 131),
    'Cyclist': (189, 140, 0),
    'Misc': (154, 147, 135),
}
"""KITTI's classes: red, green, blue, 0..255.

Any two, and PREDICTION_COLOR, are a CIEDE2000 difference of 12 apart, also for people with
deuteranopia (G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, "A Physiologically-based Model for
Simulation of Color Vision Deficiency", IEEE TVCG 15(6), 2009; severity 1). Each has a contrast of
3:1 to white and to the background of pictures (WCAG 2.1, 1.4.11).
"""

PREDICTION_COLOR = (248, 87, 172)
"""Predictions of any class: red, green, blue, 0..255."""

VERDICT_COLORS = {
    Verdict.TRUE_POSITIVE: (0, 158, 115),
    Verdict.FALSE_POSITIVE: (213, 94, 0),
    Verdict.FALSE_NEGATIVE: (240, 228, 66),
}
"""Compared predictions, and labels that none finds: red, green, blue, 0..255.

M. Okabe, K. Ito, "Color Universal Design", 2008: bluish green, vermilion, yellow. Any two of them,
NEUTRAL_COLOR and PREDICTION_COLOR are a CIEDE2000 difference of 15 apart, as above.
"""

NEUTRAL_COLOR = (215, 215, 215)
"""Labels that are found, and what a comparison does not count: red, green, blue, 0..255."""

EGO_COLOR = (0.30, 0.69, 0.31)
"""Red, green, blue, 0..1."""

EGO_SIZE_LWH = (4.0, 1.7, 1.5)
"""The recording car, a Passat, metres."""

_GOLDEN_TURN = 0.6180339887498949


def rgb_of(class_name: str) -> tuple[int, int, int]:
    """Return red, green, blue, 0..255, of a class."""
    red, green, blue = color_of(class_name, 0, MarkerColors.CLASS)
    return round(255 * red), round(255 * green), round(255 * blue)


def color_of(class_name: str, number: int, colors: MarkerColors) -> tuple[float, float, float]:
    """Return red, green, blue, 0..1, of a class, or of a track's number.

    Unknown classes get a colour by their name, the same in every run.
    """
    if colors is MarkerColors.CLASS and class_name in CLASS_COLORS:
        red, green, blue = CLASS_COLORS[class_name]
        return red / 255, green / 255, blue / 255
    seed = number if colors is MarkerColors.TRACK else crc32(class_name.encode())
    return colorsys.hsv_to_rgb(seed * _GOLDEN_TURN % 1.0, 0.75, 0.95)
