# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of any number of frames of half a megabyte each, and the bags of it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import kitti_ros2
from kitti_ros2.kitti.text_file import format_timestamps, parse_timestamps
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

if TYPE_CHECKING:
    from pathlib import Path

_DISTINCT = 3
"""Frames that are made; the others are the same again."""
_OPTIONS = SyntheticOptions(frames=_DISTINCT, image_size=(310, 94), lidar_columns=100)
_TIMES = 5  # the points of a scan are repeated: it is large, and costs nothing

_NOT_OURS = {'exclude_topics': ('/kitti/source/*',)}
BAGS: dict[str, tuple[str, dict[str, Any]]] = {
    'mcap': ('drive.mcap', {}),
    'zstd': ('drive.mcap', {'compression': 'zstd'}),
    'sqlite3': ('drive', {'storage': 'sqlite3'}),
    'ros1': ('drive.bag', {}),
    'foreign mcap': ('drive.mcap', _NOT_OURS),
    'foreign sqlite3': ('drive', {'storage': 'sqlite3', **_NOT_OURS}),
    'foreign ros1': ('drive.bag', _NOT_OURS),
}
"""Name of the file and options of to_bag, by container; foreign: without what names them ours."""


def write_drive(folder: Path, count: int) -> Path:
    """Write a raw drive; the folder to give to commands."""
    drive = write_synthetic(folder, Layout.RAW, _OPTIONS)
    for path in drive.rglob('*.bin'):
        path.write_bytes(_TIMES * path.read_bytes())
    for path in sorted(drive.rglob('data/*')):
        for number in range(int(path.stem) + _DISTINCT, count, _DISTINCT):
            os.link(path, path.with_name(f'{number:010d}{path.suffix}'))
    for path in drive.rglob('timestamps*.txt'):
        first, *_, last = parse_timestamps(path.read_text(), path).sound().values()
        period = (last - first) // (_DISTINCT - 1)
        path.write_text(format_timestamps(first + number * period for number in range(count)))
    return drive


def write_bag(folder: Path, drive: Path, container: str) -> Path:
    """Write the bag of a drive into a folder."""
    name, options = BAGS[container]
    folder.mkdir(parents=True)
    kitti_ros2.to_bag(drive, folder / name, **options)
    return folder / name
