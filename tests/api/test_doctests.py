# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of the library run, on synthetic data and on real ones."""

from __future__ import annotations

import doctest
import importlib
import shutil
from pathlib import Path

import pytest

import kitti_ros2
from kitti_ros2 import api, datasets, evaluation, validation
from kitti_ros2.model.streams import Layout

NAMES = (
    'kitti_ros2',
    *(
        f'{room.__name__}.{path.stem}'
        for room in (api, datasets, evaluation, validation)
        for path in Path(room.__path__[0]).glob('*.py')
    ),
)
MODULES = [importlib.import_module(name) for name in sorted(NAMES) if '__' not in name]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
DRIVE = Path('2011_09_26/2011_09_26_drive_0005_sync')


def lay_out(drive, object_set, folder):
    shutil.copytree(drive.parent, folder / DRIVE.parent)
    (folder / DRIVE.parent / drive.name).rename(folder / DRIVE)
    shutil.copytree(object_set, folder / 'object')


def run(module, folder, monkeypatch):
    """Run the examples of a module in a folder that has their drive and object set."""
    monkeypatch.chdir(folder)
    recording = kitti_ros2.open(DRIVE)
    names = {'kitti_ros2': kitti_ros2, 'recording': recording, 'frame': recording[1]}
    found = [test for test in doctest.DocTestFinder().find(module, globs=names) if test.examples]
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    for test in found:
        runner.run(test)
    assert runner.failures == 0
    return runner.tries


@pytest.fixture
def folder(recordings, tmp_path):
    """A folder with synthetic recordings, under the names of the examples."""
    lay_out(recordings[Layout.RAW], recordings[Layout.OBJECT], tmp_path)
    return tmp_path


@pytest.mark.parametrize('module', MODULES, ids=lambda module: module.__name__)
def test_examples_run(module, folder, monkeypatch):
    run(module, folder, monkeypatch)


def test_there_are_examples(folder, monkeypatch):
    assert run(kitti_ros2, folder, monkeypatch) > 15


@pytest.mark.parametrize('module', MODULES, ids=lambda module: module.__name__)
def test_examples_run_on_real_data(module, make_drive, real_kitti, tmp_path, monkeypatch):
    lay_out(make_drive(3), real_kitti / 'object', tmp_path)
    run(module, tmp_path, monkeypatch)
