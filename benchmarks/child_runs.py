# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What benchmarks of several processes share: time, CPU time and memory of process trees."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

Words: TypeAlias = Sequence[str | Path]
_POLL_S = 0.02
_PR_SET_CHILD_SUBREAPER = 36  # Linux's prctl.h


@dataclass(frozen=True)
class Usage:
    """What processes took.

    Attributes:
        wall: Seconds from the start of the first to the end of the last.
        cpu: Seconds of user and system time, with those of their children.
        memory: Peak sum of the resident bytes of all; pages that they share count for each.
    """

    wall: float
    cpu: float
    memory: int


def to_bag(*words: str | Path) -> list[str]:
    """Return the command kitti-ros2 to-bag."""
    return [sys.executable, '-m', 'kitti_ros2', 'to-bag', *map(str, words), '-q']


def run_together(commands: Sequence[Sequence[str]], cpus: Sequence[set[int]] = ()) -> Usage:
    """Run commands at the same time, each on some CPUs, all by default.

    Raises:
        CalledProcessError: One has failed.
    """
    everything = os.sched_getaffinity(0)
    _adopt_orphans()
    before, started, memory = _children_cpu(), time.perf_counter(), 0
    running = []
    for number, command in enumerate(commands):
        os.sched_setaffinity(0, cpus[number] if cpus else everything)
        running.append(subprocess.Popen(command, start_new_session=True))
    os.sched_setaffinity(0, everything)
    while any(each.poll() is None for each in running):
        memory = max(memory, sum(resident(each.pid) for each in running))
        time.sleep(_POLL_S)
    wall = time.perf_counter() - started
    for each in running:
        if each.returncode:
            raise subprocess.CalledProcessError(each.returncode, each.args)
    _reap()
    return Usage(wall, _children_cpu() - before, memory)


def best(times: int, command: Sequence[str], clear: Callable[[], None]) -> Usage:
    """Run a command some times; return the run of the least CPU time."""
    runs = []
    for _ in range(times):
        clear()
        runs.append(run_together([command]))
    return min(runs, key=lambda usage: usage.cpu)


def kill_when(command: Sequence[str], condition: Callable[[], bool]) -> bool:
    """Run a command and kill its process group when a condition holds; return whether it was."""
    _adopt_orphans()
    process = subprocess.Popen(command, start_new_session=True)
    while process.poll() is None:
        if condition():
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            _reap()
            return True
        time.sleep(_POLL_S)
    return False


def resident(pid: int) -> int:
    """Return the resident bytes of a process and its descendants."""
    total = 0
    try:
        pages = int(Path(f'/proc/{pid}/statm').read_text('ascii').split()[1])
        total = pages * os.sysconf('SC_PAGE_SIZE')
        for task in Path(f'/proc/{pid}/task').iterdir():
            children = (task / 'children').read_text('ascii').split()
            total += sum(resident(int(child)) for child in children)
    except OSError:  # it has ended
        pass
    return total


def _adopt_orphans() -> None:
    """Become the parent of descendants whose parent ends, to count the server of workers, too."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _reap() -> None:
    """Wait for the adopted processes."""
    with suppress(ChildProcessError):
        while True:
            os.wait()


def _children_cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
