#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How long kitti-ros2 eval detection takes, start included, and how its memory grows.

    python benchmarks/evaluation.py [--frames N] [--objects N] [--repeat N] [--dir DIR]

Labels and results are random: as many frames as KITTI's usual validation set has, with as many
objects in each. The floor is a program that only reads the files and converts their numbers.
"""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from yardsticks import make_parser, parse_in_folder, peak_mb, report, seconds

if TYPE_CHECKING:
    from pathlib import Path

FloatArray = npt.NDArray[np.float64]
LIMIT_S = 10.0
LIMIT_MB = 1000.0
RATIO = 10.0
SIZES_HWL = {'Car': (1.5, 1.6, 3.9), 'Pedestrian': (1.8, 0.7, 0.8), 'Cyclist': (1.7, 0.6, 1.8)}
FOCAL_PX = 720.0


def write_set(folder: Path, frames: int, objects: int) -> None:
    """Write labels to label_2/ and the results of a detector that errs to data/."""
    rng = np.random.default_rng(7)
    for name in ('label_2', 'data'):
        (folder / name).mkdir(parents=True)
    for number in range(frames):
        labels, results = [], []
        for class_name in rng.choice([*SIZES_HWL], objects):
            size = np.array(SIZES_HWL[class_name])
            place = np.array([rng.normal(0, 8), 1.7, rng.uniform(5, 50)])
            angle = rng.uniform(-np.pi, np.pi)
            labels.append(_line(class_name, size, place, angle))
            shift, turn = rng.normal(0, 0.1, 3), rng.normal(0, 0.05)
            results.append(f'{_line(class_name, size, place + shift, angle + turn)} {rng.random()}')
        (folder / 'label_2' / f'{number:06d}.txt').write_text('\n'.join(labels))
        (folder / 'data' / f'{number:06d}.txt').write_text('\n'.join(results))


def _line(class_name: str, size: FloatArray, place: FloatArray, angle: float) -> str:
    u, v = 610 + FOCAL_PX * place[0] / place[2], 172 + FOCAL_PX * place[1] / place[2]
    height, width = FOCAL_PX * size[0] / place[2], FOCAL_PX * size[2] / place[2]
    numbers = (angle, u - width / 2, v - height, u + width / 2, v, *size, *place, angle)
    return f'{class_name} 0 0 {" ".join(f"{each:.2f}" for each in numbers)}'


def read_bare(folder: Path) -> int:
    """Read all files, and convert all numbers."""
    return sum(
        len([float(word) for word in line.split()[1:]])
        for path in folder.rglob('*.txt')
        for line in path.read_text().splitlines()
    )


def main() -> None:
    """Measure."""
    parser = make_parser(__doc__)
    parser.add_argument('--frames', type=int, default=3769)
    parser.add_argument('--objects', type=int, default=12)
    parser.add_argument('--repeat', type=int, default=5)
    peaks: list[float] = []
    with parse_in_folder(parser, 'where to write') as (given, folder):
        write_set(folder, given.frames, given.objects)
        words = ('eval', 'detection', str(folder / 'label_2'), str(folder), '-q')
        rounds = [
            (seconds(lambda: peaks.append(peak_mb(*words))), seconds(lambda: read_bare(folder)))
            for _ in range(given.repeat)
        ]
        taken, bare = (median(values) for values in zip(*rounds, strict=True))
        note = f'{given.frames} frames, {given.objects} objects each'
        report('eval detection, seconds', taken, f'<= {LIMIT_S:.0f}', note)
        report('the same / reading the numbers', taken / bare, f'<= {RATIO:.0f}')
        report('peak memory, MB', median(peaks), f'<= {LIMIT_MB:.0f}')


if __name__ == '__main__':
    main()
