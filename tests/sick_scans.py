# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of the SICK for a drive of KITTI-360, as its documentation and scripts have them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.kitti.text_file import format_timestamps, parse_timestamps

if TYPE_CHECKING:
    from pathlib import Path

D = '2013_05_28_drive_0000_sync'
SICK = f'data_3d_raw/{D}/sick_points'
TO_VELO = 'calibration/calib_sick_to_velo.txt'
MOUNT = '0 -1 0 -0.4 1 0 0 -0.01 0 0 1 -0.07'
PERIOD_NS = 13_400_000
AROUND_NS = 500_000_000
"""Before the first and after the last scan of the Velodyne: more than a selection's margin."""
POINTS = 5


def sick_file(root: Path, number: int) -> Path:
    return root / SICK / f'data/{number:010d}.bin'


def sick_stamps(root: Path) -> list[int]:
    path = root / SICK / 'timestamps.txt'
    return parse_timestamps(path.read_text(), path).values


def add_sick(root: Path, missing: tuple[int, ...] = ()) -> int:
    """Add its scans; returns how many stamps there are."""
    path = root / f'data_3d_raw/{D}/velodyne_points/timestamps.txt'
    frames = parse_timestamps(path.read_text(), path).values
    stamps = [*range(frames[0] - AROUND_NS, frames[-1] + AROUND_NS, PERIOD_NS)]
    (root / SICK / 'data').mkdir(parents=True)
    (root / SICK / 'timestamps.txt').write_text(format_timestamps(stamps))
    rng = np.random.default_rng(360)
    for number in range(len(stamps)):
        if number not in missing:
            pairs = rng.uniform(-80, 80, (POINTS + number % 3, 2)).astype('<f4')
            pairs[0] = 0.0, -0.0
            sick_file(root, number).write_bytes(pairs.tobytes())
    (root / TO_VELO).write_text(f'{MOUNT}\n')
    return len(stamps)
