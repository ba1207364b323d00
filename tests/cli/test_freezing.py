# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The collector skips imports in the program, and nothing where main is called as a function."""

import gc
import subprocess
import sys
from dataclasses import replace

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import write_synthetic

from builders import SMALL  # isort: skip

PROGRAM = """
import atexit, gc, sys
from kitti_ros2.cli import main
atexit.register(lambda: print(gc.get_freeze_count() > 0, gc.isenabled()))
sys.exit(main())
"""


@pytest.fixture
def words(tmp_path):
    options = replace(SMALL, frames=1, image_size=(62, 20), lidar_columns=20)
    drive = write_synthetic(tmp_path / 'raw', Layout.RAW, options)
    return ['to-bag', str(drive), str(tmp_path / 'o.mcap'), '-q']


def test_main_as_a_function_freezes_nothing(words):
    frozen = gc.get_freeze_count()
    assert main(words) == 0
    assert (gc.get_freeze_count(), gc.isenabled()) == (frozen, True)


def test_the_program_freezes_its_imports(words):
    run = [sys.executable, '-c', PROGRAM, *words]
    assert subprocess.run(run, capture_output=True, text=True, check=True).stdout == 'True True\n'
