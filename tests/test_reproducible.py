# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The same input gives the same bytes, however busy the machine is and whoever comes first."""

from __future__ import annotations

import hashlib
import os
import sys
import threading

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

RUNS = 3
BAGS = {
    'mcap': ('bag.mcap', []),
    'mcap lz4': ('bag.mcap', ['--compression', 'lz4']),
    'mcap zstd': ('bag.mcap', ['--compression', 'zstd']),
    'mcap by size': ('bag', ['--compression', 'zstd', '--split-size', '1MB']),
    'sqlite3': ('bag', ['--storage', 'sqlite3']),
    'sqlite3 zstd': ('bag', ['--storage', 'sqlite3', '--compression', 'zstd']),
    'ros1': ('bag.bag', []),
    'ros1 lz4': ('bag.bag', ['--compression', 'lz4']),
    'ros1 bz2': ('bag.bag', ['--compression', 'bz2']),
}


@pytest.fixture
def busy(monkeypatch):
    """Many workers that take turns every microsecond, and a thread that does nothing but turn."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(8)))
    done = threading.Event()

    def turn():
        while not done.is_set():
            sum(range(50))

    turning = threading.Thread(target=turn)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    turning.start()
    yield
    done.set()
    sys.setswitchinterval(interval)
    turning.join()


def contents(path):
    """The digest of every file of a folder, or of a file."""
    files = [path] if path.is_file() else sorted(each for each in path.rglob('*') if each.is_file())
    assert files
    return {
        each.relative_to(path.parent).as_posix(): hashlib.sha256(each.read_bytes()).hexdigest()
        for each in files
    }


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', ['compressed', 'raw'])
@pytest.mark.parametrize('case', BAGS)
def test_to_bag(busy, recordings, case, images, tmp_path):
    del busy
    name, options = BAGS[case]
    options = [*options, '--images', images, '--end', '1']
    found = []
    for run in range(RUNS):
        out = tmp_path / str(run) / name
        out.parent.mkdir()
        assert main(['to-bag', '-q', str(recordings[Layout.RAW]), str(out), *options]) == 0
        found.append(contents(out))
    assert found[1:] == found[:-1]


@pytest.mark.parametrize(
    ('name', 'target'),
    [('bag.mcap', None), ('bag.bag', None), ('bag', None), ('bag.mcap', 'object')],
)
def test_to_kitti_of_pixels(busy, recordings, name, target, tmp_path):
    """By what our own bags know of their files, and by a plan."""
    del busy
    bag = tmp_path / name
    made = ['to-bag', '-q', str(recordings[Layout.RAW]), str(bag), '--images', 'raw', '--end', '2']
    assert main(made) == 0
    options = ['--layout', target] if target else []
    found = []
    for run in range(RUNS):
        out = tmp_path / str(run) / 'out'
        out.parent.mkdir()
        main(['to-kitti', '-q', str(bag), str(out), *options])
        found.append(contents(out))
    assert any(each.endswith('.png') for each in found[0])
    assert found[1:] == found[:-1]
