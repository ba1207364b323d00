# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever numbers and bytes an input holds, only our own lines reach standard error."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import hostile_files as hostile
import pytest
from foreign_output import run_apart

from kitti_ros2.model.layouts import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from builders import SHARED  # isort: skip
from shared_files import made_once  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

TINY = SyntheticOptions(frames=2, image_size=(124, 38), lidar_columns=40)
FAULTS: dict[str, tuple[str, Callable[[Path, str], None]]] = {
    'scans': ('', hostile.hostile_scans),
    'images': ('', hostile.damaged_images),
    'stamps': ('', hostile.hostile_stamps),
    'calibration': ('calib', hostile.with_all_numbers),
    'calibration of 1e300': ('calib', hostile.with_number('1e300')),
    'labels': ('labels', hostile.with_all_numbers),
    'labels of 1e160': ('labels', hostile.with_number('1e160')),
    'poses': ('poses', hostile.with_all_numbers),
    'poses of nan': ('poses', hostile.with_number('nan')),
}
"""By name the kind of text files that are changed, and the change."""


@pytest.fixture
def tiny(tmp_path_factory, request) -> Path:
    layout = request.param
    name = f'tiny_{layout.value}'
    return made_once(tmp_path_factory, name, lambda folder: write_synthetic(folder, layout, TINY))


def of_folder(source: Path, out: Path) -> list[list[object]]:
    """The commands that read a KITTI folder; the last two write bags."""
    return [
        ['info', source],
        ['validate', source, '--decode'],
        ['stats', source, '--points'],
        ['report', source, '-o', out / 'folder.html'],
        ['view', source, '-o', out / 'panel.png'],
        ['view', source, '-o', out / 'perspective.png', '--mode', 'perspective'],
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


@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize('tiny', list(Layout), indirect=True, ids=[each.value for each in Layout])
def test_folders_of_absurd_numbers(tiny, fault, tmp_path):
    root = tiny.parent if tiny.parent.name.startswith('2011') else tiny
    copy = tmp_path / root.name
    shutil.copytree(root, copy)
    kind, change = FAULTS[fault]
    change(copy, kind)
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
