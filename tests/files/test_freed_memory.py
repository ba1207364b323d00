# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Freed memory is kept, and given back once a minute."""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from kitti_ros2.files import processes
from kitti_ros2.files.processes import FreeMemory

FREED = """
import re
from pathlib import Path
from kitti_ros2.files import processes as freed_memory

def megabytes():
    return int(re.search(r'RssAnon:\\s+(\\d+) kB', Path('/proc/self/status').read_text())[1]) >> 10

freed_memory.keep_freed_memory()
freed_memory._GIVEN_BACK_EVERY_S = 0
memory = freed_memory.FreeMemory()
blocks = [b'x' * 100_000 for _ in range(1000)]  # filled: empty ones have no pages yet
before = megabytes()
del blocks[::2]
kept = megabytes()
memory.give_back()
print(before, kept, megabytes())
"""


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), 'malloc_trim') or not Path('/proc/self/status').exists(),
    reason='needs glibc and /proc',
)
def test_free_pages_between_used_ones_are_given_back():
    done = subprocess.run([sys.executable, '-c', FREED], capture_output=True, check=True)
    before, kept, after = map(int, done.stdout.split())
    assert before - 5 < kept
    assert after < before - 40  # of 50 that are free


def test_memory_is_given_back_once_a_minute(monkeypatch):
    now, given_back = [1000.0], []
    monkeypatch.setattr(processes.time, 'monotonic', lambda: now[0])
    memory = FreeMemory()
    monkeypatch.setattr(memory, '_trim', lambda kept: given_back.append((now[0], kept)))
    for _ in range(1300):
        now[0] += 0.1
        memory.give_back()
    assert [round(moment) for moment, _ in given_back] == [1060, 1120]


def test_without_glibc_nothing_is_given_back(monkeypatch):
    monkeypatch.setattr(processes, '_GIVEN_BACK_EVERY_S', 0)
    monkeypatch.setattr(processes.ctypes, 'CDLL', lambda _: object())  # as musl's or macOS's
    FreeMemory().give_back()
