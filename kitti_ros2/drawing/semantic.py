# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""SemanticKITTI's classes of points.

Source: labels and color_map of semantic-kitti.yaml, in the semantic-kitti-api.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

_CLASSES = {
    0: ('unlabeled', 0x000000),
    1: ('outlier', 0xFF0000),
    10: ('car', 0x6496F5),
    11: ('bicycle', 0x64E6F5),
    13: ('bus', 0x6450FA),
    15: ('motorcycle', 0x1E3C96),
    16: ('on-rails', 0x0000FF),
    18: ('truck', 0x501EB4),
    20: ('other-vehicle', 0x0000FF),
    30: ('person', 0xFF1E1E),
    31: ('bicyclist', 0xFF28C8),
    32: ('motorcyclist', 0x961E5A),
    40: ('road', 0xFF00FF),
    44: ('parking', 0xFF96FF),
    48: ('sidewalk', 0x4B004B),
    49: ('other-ground', 0xAF004B),
    50: ('building', 0xFFC800),
    51: ('fence', 0xFF7832),
    52: ('other-structure', 0xFF9600),
    60: ('lane-marking', 0x96FFAA),
    70: ('vegetation', 0x00AF00),
    71: ('trunk', 0x873C00),
    72: ('terrain', 0x96F050),
    80: ('pole', 0xFFF096),
    81: ('traffic-sign', 0xFF0000),
    99: ('other-object', 0x32FFFF),
    252: ('moving-car', 0x6496F5),
    253: ('moving-bicyclist', 0xFF28C8),
    254: ('moving-person', 0xFF1E1E),
    255: ('moving-motorcyclist', 0x961E5A),
    256: ('moving-on-rails', 0x0000FF),
    257: ('moving-bus', 0x6450FA),
    258: ('moving-truck', 0x501EB4),
    259: ('moving-other-vehicle', 0x0000FF),
}

SEMANTIC_NAMES = {number: name for number, (name, _) in _CLASSES.items()}
"""Class to name."""

SEMANTIC_COLORS = {number: color for number, (_, color) in _CLASSES.items()}
"""Class to 0xRRGGBB."""

OTHER_COLOR = 0x808080
"""Of classes that SemanticKITTI does not have."""

_OTHER = 1
_SHADES = {number: shade for shade, number in enumerate(_CLASSES, _OTHER + 1)}
_SHADE_OF_CLASS = np.full(1 << 16, _OTHER, np.uint8)
_SHADE_OF_CLASS[list(_SHADES)] = list(_SHADES.values())


def semantic_shades(labels: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint8]:
    """Return (N,) shades 1..255 of (N,) labels, one for each class; 1 for unknown classes."""
    shades: npt.NDArray[np.uint8] = _SHADE_OF_CLASS[labels & 0xFFFF]
    return shades


def semantic_table() -> npt.NDArray[np.uint8]:
    """Return (256, 1, 3) BGR of the shades.

    Points without a label, black in SemanticKITTI, are grey: pictures have a dark background.
    """
    colors = np.full(256, OTHER_COLOR, np.uint32)
    for number, shade in _SHADES.items():
        colors[shade] = SEMANTIC_COLORS[number] or OTHER_COLOR
    return np.stack([colors & 0xFF, colors >> 8 & 0xFF, colors >> 16], axis=1)[:, None].astype(
        np.uint8
    )


def semantic_names(shades: npt.NDArray[np.uint8]) -> list[tuple[str, int]]:
    """Return name and shade of the classes of some points, the most frequent first."""
    names = {_SHADES[number]: name for number, (name, _) in _CLASSES.items()}
    counts = np.bincount(shades, minlength=256)
    found = sorted(np.flatnonzero(counts).tolist(), key=lambda shade: -counts[shade])
    return [(names.get(shade, 'other'), shade) for shade in found]
