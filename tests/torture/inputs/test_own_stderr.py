# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever numbers and bytes an input holds, only our own lines reach standard error."""

from __future__ import annotations

import shutil
from functools import partial
from typing import TYPE_CHECKING

import hostile_files as hostile
import pytest
from foreign_output import run_apart

from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from builders import SHARED  # isort: skip
from shared_files import made_once  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TINY = SyntheticOptions(frames=2, image_size=(124, 38), lidar_columns=40)
RAW, OBJECT, ODOMETRY, TRACKING = Layout.RAW, Layout.OBJECT, Layout.ODOMETRY, Layout.TRACKING
FAULTS: dict[str, tuple[tuple[Layout, ...], Callable[[Path], None]]] = {
    'scans': ((RAW, OBJECT), hostile.hostile_scans),
    'images': ((RAW,), hostile.damaged_images),
    'stamps': ((RAW, ODOMETRY), hostile.hostile_stamps),
    'calibration': (tuple(Layout), partial(hostile.with_all_numbers, kind='calib')),
    'calibration of 1e300': (
        (RAW, OBJECT), partial(hostile.with_number, kind='calib', number='1e300')
    ),
    'labels': ((RAW, OBJECT, TRACKING), partial(hostile.with_all_numbers, kind='labels')),
    'labels of 1e160': (
        (OBJECT, TRACKING), partial(hostile.with_number, kind='labels', number='1e160')
    ),
    'poses': ((RAW, ODOMETRY, TRACKING), partial(hostile.with_all_numbers, kind='poses')),
    'poses of 1e300': ((RAW, ODOMETRY), partial(hostile.with_number, kind='poses', number='1e300')),
}  # fmt: skip
"""By name the layouts whose files are changed, and the change."""
CASES = [(fault, layout) for fault, (layouts, _) in FAULTS.items() for layout in layouts]


def of_folder(source: Path, out: Path) -> list[list[object]]:
    """The commands that read a KITTI folder; the last two write bags."""
    return [
        ['info', source],
        ['validate', source, '--decode'],
        ['stats', source, '--count-points'],
        ['report', source, '-o', out / 'folder.html'],
        ['view', source, '-o', out / 'panel.png'],
        ['view', source, '-o', out / 'boxes.png', '--mode', 'boxes'],
        ['crop', source, out / 'crop', '--view', 'reduced', '--voxel', '0.5'],
        ['to-bag', source, out / 'bag'],
        ['to-bag', source, out / 'bag.bag', '--images', 'raw', '--ring-time'],
    ]


def of_bag(bag: Path, out: Path) -> list[list[object]]:
    """The commands that read a bag."""
    return [
        ['info', bag],
        ['validate', bag, '--decode'],
        ['view', bag, '-o', out / f'{bag.name}.png'],
        ['report', bag, '-o', out / f'{bag.name}.html'],
        ['to-kitti', bag, out / f'{bag.name}_kitti'],
        ['to-kitti', bag, out / f'{bag.name}_object', '--layout', 'object'],
    ]


def foreign_lines(commands: list[list[object]]) -> list[str]:
    found = []
    for words in commands:
        found += [f'{words[0]}: {line}' for line in run_apart(*words).unexpected()]
    return found


@pytest.mark.parametrize(
    ('fault', 'layout'), CASES, ids=[f'{fault}-{layout.value}' for fault, layout in CASES]
)
def test_folders_of_absurd_numbers(fault, layout, tmp_path_factory, tmp_path):
    name = f'tiny_{layout.value}'
    tiny = made_once(tmp_path_factory, name, lambda folder: write_synthetic(folder, layout, TINY))
    root = tiny.parent if layout is RAW else tiny
    copy = tmp_path / root.name
    shutil.copytree(root, copy)
    FAULTS[fault][1](copy)
    source = copy / tiny.relative_to(root)
    assert foreign_lines(of_folder(source, tmp_path)) == []
    for bag in (tmp_path / 'bag', tmp_path / 'bag.bag'):
        if bag.exists():
            assert foreign_lines(of_bag(bag, tmp_path)) == []


FOUND = SHARED / 'found'
BROKEN = sorted(path.name for path in FOUND.glob('*') if path.suffix in {'.bag', '.db3', '.mcap'})


@pytest.mark.parametrize('name', BROKEN)
def test_bags_that_broke_something(name, tmp_path):
    commands = [*of_bag(FOUND / name, tmp_path), ['recover', FOUND / name, tmp_path / 'out.mcap']]
    assert foreign_lines(commands) == []
