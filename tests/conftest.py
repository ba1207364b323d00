# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of all tests: the synthetic recording in every layout, real KITTI, a browser."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING
from zlib import crc32

import pytest
from chromium import Chromium, find_chromium
from hypothesis import settings

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout

from builders import SHARED  # isort: skip
from shared_files import SyntheticRecordings  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Mapping

# A busy machine makes any test slow now and then.
settings.register_profile('patient', deadline=None)
settings.load_profile('patient')


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--every-case', action='store_true', help='also those that one_in leaves out')


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        'markers', 'one_in(n): of its many cases about one in n runs, and each with --every-case'
    )
    config.addinivalue_line(
        'markers', 'programs: starts players, shells, viewers or stacks; runs if it is asked for'
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out cases of long tables, and from a run of all tests those that start programs.

    The cases are always the same ones, and none is left out that is asked for by its id.
    """
    if config.getoption('every_case') or any('::' in word for word in config.args):
        return
    left_out = [
        case
        for _, cases in groupby(items, lambda item: item.nodeid.partition('[')[0])
        for number, case in enumerate(cases)
        if number and (mark := case.get_closest_marker('one_in'))
        if crc32(case.name.encode()) % mark.args[0]
    ]
    if config.args_source is not pytest.Config.ArgsSource.ARGS and not config.option.markexpr:
        left_out += [item for item in items if item.get_closest_marker('programs')]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        gone = {id(item) for item in left_out}
        items[:] = [item for item in items if id(item) not in gone]


@pytest.fixture(scope='session')
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Mapping[Layout, Path]:
    """The folder to convert, by layout; small, and not to be changed: all processes share it."""
    return SyntheticRecordings(tmp_path_factory)


@pytest.fixture(params=list(Layout), ids=[layout.value for layout in Layout])
def recording_path(request: pytest.FixtureRequest, recordings: Mapping[Layout, Path]) -> Path:
    """The same, one layout after the other."""
    return recordings[request.param]


@pytest.fixture
def recording(recording_path: Path):
    """The recording open for reading, one layout after the other."""
    return open_recording(recording_path)


@pytest.fixture
def drive(recordings: Mapping[Layout, Path], tmp_path: Path) -> Path:
    """A raw drive of one's own, to break."""
    date = tmp_path / recordings[Layout.RAW].parent.name
    shutil.copytree(recordings[Layout.RAW].parent, date)
    return date / recordings[Layout.RAW].name


@pytest.fixture(scope='session')
def real_kitti() -> Path:
    """Real KITTI files; they are not part of the project."""
    folder = SHARED / 'kitti'
    if not folder.is_dir():
        pytest.skip(f'no real KITTI samples at {folder}')
    return folder


@pytest.fixture(scope='session')
def real_360() -> Path:
    """Real KITTI-360 files; they are not part of the project."""
    folder = SHARED / 'kitti360'
    if not folder.is_dir():
        pytest.skip(f'no real KITTI-360 samples at {folder}')
    return folder


@pytest.fixture(scope='session')
def make_drive(real_kitti: Path, tmp_path_factory: pytest.TempPathFactory):
    """A function that lays out a drive of n real frames; gaps as STREAM:FIRST-LAST."""
    tool = real_kitti.parent / 'tools' / 'make_drive.py'
    if not tool.is_file():
        pytest.skip(f'no drive maker at {tool}')

    def make(frames: int, *missing: str) -> Path:
        out = tmp_path_factory.mktemp('drive')
        words = [sys.executable, tool, out, str(frames)]
        if missing:
            words += ['--missing', *missing]
        done = subprocess.run(words, check=True, capture_output=True, text=True)
        return Path(done.stdout.strip())

    return make


@pytest.fixture(scope='module')
def browser():
    """A browser without a window, for the pages of a module."""
    program = find_chromium()
    if program is None:
        pytest.skip('no Chromium: install chromium, or name one in CHROMIUM')
    with (
        # A profile may still be written while its browser ends.
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        Chromium(program, Path(profile)) as chromium,
    ):
        yield chromium


@pytest.fixture(scope='session')
def axe() -> str:
    """The script of axe-core, which checks accessibility."""
    path = os.environ.get('AXE_CORE', '')
    if not path:
        pytest.skip('no axe-core: name its axe.min.js (npm install axe-core) in AXE_CORE')
    return Path(path).read_text(encoding='utf-8')
