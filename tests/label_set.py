# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An object set of labels alone, with given numbers of labels of each class."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.kitti.label_file import format_object_box
from kitti_ros2.model.boxes import DONT_CARE, Box

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

TRAINING = {
    'Car': 28742,
    'DontCare': 11295,
    'Pedestrian': 4487,
    'Van': 2914,
    'Cyclist': 1627,
    'Truck': 1094,
    'Misc': 973,
    'Tram': 511,
    'Person_sitting': 222,
}
"""The labels of KITTI's object training set."""
FRAMES = 7481

_SIZES_HWL = {
    'Car': (1.53, 1.63, 3.88),
    'Van': (2.21, 1.90, 5.08),
    'Truck': (3.25, 2.59, 10.1),
    'Pedestrian': (1.76, 0.66, 0.84),
    'Person_sitting': (1.27, 0.59, 0.80),
    'Cyclist': (1.74, 0.60, 1.76),
    'Tram': (3.53, 2.54, 16.1),
    'Misc': (1.91, 1.51, 3.58),
}
_FOCAL_PX = 721.5
_DIFFERENT = 64


def write_labels(split: Path, counts: Mapping[str, int], frames: int) -> Path:
    """Write the labels into label_2, spread over the frames, and return the split."""
    rng = np.random.default_rng(0)
    lines: list[list[str]] = [[] for _ in range(frames)]
    for class_name, count in counts.items():
        made = [format_object_box(make_box(class_name, rng)) for _ in range(_DIFFERENT)]
        for place, frame in enumerate(rng.integers(0, frames, count).tolist()):
            lines[frame].append(made[place % _DIFFERENT])
    folder = split / 'label_2'
    folder.mkdir(parents=True)
    for number, found in enumerate(lines):
        (folder / f'{number:06d}.txt').write_text(''.join(f'{line}\n' for line in found))
    return split


def make_box(class_name: str, rng: np.random.Generator) -> Box:
    """A box at a random place, its 2D box as high as the camera sees it."""
    if class_name == DONT_CARE:
        area = (500.0, 170.0, 530.0, 190.0)
        return Box(class_name, -1, -1, -10, area, (-1, -1, -1), (-1000, -1000, -1000), -10)
    distance = float(rng.gamma(3.0, 9.0)) + 4
    scale = float(rng.normal(1, 0.08))
    sizes = tuple(size * scale for size in _SIZES_HWL[class_name])
    height_px = _FOCAL_PX * sizes[0] / distance
    truncated = (0.0, 0.0, 0.0, 0.0, 0.1, 0.15, 0.3, 0.45, 0.8)[rng.integers(9)]
    occluded = (0, 0, 0, 1, 1, 2, 3)[rng.integers(7)]
    area = (600.0, 180.0, 640.0, 180.0 + height_px)
    place = (float(rng.normal(0, 4)), 1.7, distance)
    return Box(class_name, truncated, occluded, 0.0, area, sizes, place, 0.0)
