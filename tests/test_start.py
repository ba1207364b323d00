# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The library and each command import what they need, which is most of the time that they take."""

from __future__ import annotations

import subprocess
import sys

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

DRAWN = {'cv2', 'kitti_ros2.pictures.panel', 'matplotlib'}
BAGS = {
    *('rosbags', 'mcap', 'sqlite3', 'zstandard', 'lz4', 'yaml'),
    *('kitti_ros2.importer', 'kitti_ros2.own_bags', 'kitti_ros2.bags.reader'),
}
OTHERS_BAGS = {'kitti_ros2.importer.guess', 'kitti_ros2.importer.planned_recording'}
RARE = {*OTHERS_BAGS, 'yaml', 'sqlite3', 'kitti_ros2.messages.foxglove'}
STORES = {'fsspec', 'kitti_ros2.files.remote_reads', 'kitti_ros2.files.remote_requests'}
SHELL = {'typer', 'rich', 'kitti_ros2.cli'}
OPEN = 'import kitti_ros2; kitti_ros2.open'

LIBRARY = {
    'import kitti_ros2': {'numpy', 'typing', 'dataclasses', 'pathlib', 'kitti_ros2.api'},
    'import kitti_ros2.datasets': {'numpy', 'kitti_ros2.datasets.extracting', 'kitti_ros2.api'},
    'import kitti_ros2.bags.writer': DRAWN | STORES | SHELL | OTHERS_BAGS,
    OPEN: DRAWN | BAGS | STORES | SHELL,
    f'{OPEN}(FOLDER)[0].points': DRAWN | BAGS | STORES | SHELL,
    f'{OPEN}(FOLDER)[0].pose': DRAWN | BAGS | STORES | SHELL,
    f'{OPEN}(FOLDER)[0].calibration.transform(2, "velo_link")': DRAWN | STORES | SHELL,
    f'{OPEN}(BAG)[0].points': DRAWN | RARE | STORES | SHELL,
    f'{OPEN}(BAG)[0].pose': DRAWN | RARE | STORES | SHELL,
}
"""By code: the modules that it does without."""

COMMANDS = {
    '--help': {'numpy', 'rich', 'yaml', 'kitti_ros2.options.table'},
    'to-bag --help': {'numpy', 'rich', 'yaml'},
    'play --help': {'numpy', 'rich', 'yaml', 'rclpy'},
    'info FOLDER': DRAWN | STORES | RARE | {'kitti_ros2.importer', 'kitti_ros2.options.table'},
    'info BAG': DRAWN | STORES | RARE | {'kitti_ros2.importer', 'kitti_ros2.options.table'},
    'stats FOLDER': DRAWN | STORES | RARE | {'kitti_ros2.importer.survey'},
    'validate FOLDER': DRAWN | STORES | RARE | {'rosbags'},
    'report FOLDER -o OUT.html -q': STORES | {'yaml', 'kitti_ros2.importer.survey'},
    'view FOLDER --mode boxes -o OUT.png -q': STORES | {'yaml', 'rich'} | OTHERS_BAGS,
    'to-bag FOLDER OUT.mcap -q': DRAWN | STORES | OTHERS_BAGS | {'sqlite3', 'rich'},
    'to-kitti BAG OUT -q': DRAWN | STORES | {'sqlite3', 'rich'},
}
"""The same by words of the command line."""


@pytest.fixture(scope='module')
def sources(recordings, tmp_path_factory):
    folder, bag = recordings[Layout.RAW], tmp_path_factory.mktemp('bag') / 'own.mcap'
    assert main(['to-bag', str(folder), str(bag), '-q']) == 0
    return {'FOLDER': str(folder), 'BAG': str(bag)}


def imported(code, folder):
    """Return the modules of a new interpreter after code."""
    code = f'import sys; {code}; sys.stderr.write(" ".join(sys.modules))'
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split())


@pytest.mark.parametrize('code', LIBRARY)
def test_the_library_imports_no_more(code, sources, tmp_path):
    run = code
    for name, path in sources.items():
        run = run.replace(name, repr(path))
    before = imported('pass', tmp_path)  # an editable installation imports pathlib
    assert sorted((imported(run, tmp_path) - before) & LIBRARY[code]) == []


@pytest.mark.parametrize('words', COMMANDS)
def test_a_command_imports_no_more(words, sources, tmp_path):
    run = [sources.get(word, word) for word in words.split()]
    before = imported('import typer', tmp_path)  # versions before 0.16 import rich
    after = imported(f'from kitti_ros2.cli import main; main({run!r})', tmp_path)
    assert sorted((after - before) & COMMANDS[words]) == []


THREADS = """
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
import kitti_ros2

sys.setswitchinterval(1e-5)
together = Barrier(4)

def first_use(path):
    together.wait()
    frame = kitti_ros2.open(path)[0]
    assert frame.points.shape[1] == 4
    assert frame.transform('map', 'velo_link').shape == (4, 4)
    return path == BAG or len(kitti_ros2.encode(frame)) > 5

with ThreadPoolExecutor(4) as pool:
    assert all(pool.map(first_use, [FOLDER, BAG] * 2))
"""


def test_threads_may_use_the_library_first_at_once(sources, tmp_path):
    """Modules, and the classes of messages, are made when a thread first needs them."""
    run = THREADS
    for name, path in sources.items():
        run = run.replace(name, repr(path))
    imported(f'exec({run!r})', tmp_path)
