# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An object set whose predictions are right and wrong in known ways."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

# Boxes are 4 m long and face along z: the IoU of two that are d apart in z is (4 - d) / (4 + d).
LABELS = {
    0: [('Car', 0, 20), ('Car', 5, 40), ('Van', -6, 30)],
    1: [('Car', 0, 20)],
    2: [],
    4: [('Car', 0, 20), ('Cyclist', 3, 12)],
}
RESULTS = {
    0: [('Car', 0, 20.2, 0.9), ('Car', 0, 60, 0.8), ('Car', -6, 30, 0.7)],
    1: [('Car', 0, 21, 0.6)],
    2: [('Pedestrian', 2, 10, 0.4)],
    3: [('Car', 0, 20, 0.5)],
}
"""Frame 0 has a hit, a false positive, one on a van, and a miss; 1 a hit of IoU 0.6; 2 no labels
but a label file; 3 no label file; 4 no result file."""


class PredictionSet(NamedTuple):
    """The folder of a set, and that of its result files."""

    root: Path
    results: Path


def line(kind: str, x: float, z: float, score: float | None = None) -> str:
    """The line of a box on the ground, in a label or a result file."""
    middle = 150 + 5 * x
    box = f'{middle - 10:.2f} 40.00 {middle + 10:.2f} {40 + 400 / z:.2f}'
    text = f'{kind} 0.00 0 -1.57 {box} 1.50 2.00 4.00 {x:.2f} 1.60 {z:.2f} -1.570796'
    return text + ('' if score is None else f' {score:.2f}') + '\n'


def write_results(folder: Path, results: dict[int, list] | None = None) -> Path:
    """Write a result file for each frame of results, and return the folder."""
    folder.mkdir()
    for number, boxes in (RESULTS if results is None else results).items():
        (folder / f'{number:06d}.txt').write_text(''.join(line(*box) for box in boxes))
    return folder


def write_prediction_set(recording: Path, folder: Path) -> PredictionSet:
    """Write LABELS into a copy of an object recording, and RESULTS beside it."""
    root = shutil.copytree(recording, folder / 'object')
    labels = root / 'training' / 'label_2'
    for path in labels.iterdir():
        path.unlink()
    for number, boxes in LABELS.items():
        (labels / f'{number:06d}.txt').write_text(''.join(line(*box) for box in boxes))
    return PredictionSet(root, write_results(folder / 'results'))


def track_lines(results: dict[int, list]) -> str:
    """The text of a tracker's file, track n the n-th box of a frame."""
    return ''.join(
        f'{number} {track} {line(*box)}'
        for number, boxes in results.items()
        for track, box in enumerate(boxes)
    )
