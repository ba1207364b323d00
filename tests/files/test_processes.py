# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The map on forked processes: the same results as map; errors and deaths are told; none stays."""

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait_until

from kitti_ros2.files.processes import forked_map
from kitti_ros2.model.errors import BadFileError, KittiRos2Error


@pytest.fixture(autouse=True)
def no_process_stays():
    """The processes of a test end with it; a test runner may have others."""
    before = set(multiprocessing.active_children())
    yield
    assert set(multiprocessing.active_children()) <= before


@pytest.mark.parametrize('workers', [1, 2, 3, 8])
@pytest.mark.parametrize('count', [0, 1, 2, 7, 40])
def test_it_is_map(workers, count):
    items = list(range(count))
    assert list(forked_map(str, items, workers)) == [*map(str, items)]


def test_results_larger_than_a_pipe_come_in_order():
    sizes = [300_000, 1, 200_000, 5]
    assert [len(each) for each in forked_map(bytes, sizes, 2)] == sizes


def test_an_error_comes_in_its_place_and_ends_the_processes():
    results = forked_map(lambda item: 1 // item, [1, 1, 0, 1], 2)
    assert [next(results), next(results)] == [1, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_an_error_of_a_file_keeps_its_place():
    def fail(item):
        raise BadFileError(item, 'no number', 'a number', line=3)

    with pytest.raises(BadFileError, match=r'^a\.txt:3: no number; expected a number$') as error:
        next(forked_map(fail, ['a.txt'], 1))
    assert (error.value.path, error.value.line) == ('a.txt', 3)


def test_a_process_that_is_killed_is_named_by_its_signal():
    def kill(item):
        if item == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return item

    results = forked_map(kill, [1, 2, 3], 1)
    assert [next(results), next(results)] == [1, 2]
    with pytest.raises(KittiRos2Error, match='killed by signal 9'):
        next(results)


def test_an_abandoned_map_ends_its_processes():
    results = forked_map(bytes, [300_000] * 10, 2)
    next(results)
    results.close()


def test_processes_end_when_their_parent_is_killed(tmp_path):
    pids = tmp_path / 'pids'
    code = f"""
import os, signal
from kitti_ros2.files.processes import forked_map

def note(item):
    with open({str(pids)!r}, 'a') as file:
        print(os.getpid(), file=file)
    return bytes(300_000)

results = forked_map(note, range(100), 3)
for _ in range(3):
    next(results)
os.kill(os.getpid(), signal.SIGKILL)
"""
    ended = subprocess.run([sys.executable, '-c', code], check=False)
    assert ended.returncode == -signal.SIGKILL
    started = {int(line) for line in pids.read_text().split()}
    assert len(started) == 3
    wait_until(lambda: not any(_runs(pid) for pid in started))


def _runs(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(') ')[2][0] != 'Z'
    except FileNotFoundError:
        return False


def test_a_program_with_threads_is_not_forked():
    code = 'from kitti_ros2.files.processes import can_fork; import threading as t, time\n'
    code += 'print(can_fork()); e = t.Event(); t.Thread(target=e.wait).start(); print(can_fork())\n'
    code += 'e.set()'
    ended = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ['True', 'False']
