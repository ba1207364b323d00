# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Dask workers and schedulers that are killed in the middle of a unit, and Ctrl-C."""

from __future__ import annotations

import os
import signal

import pytest
from dask_processes import SPINNING, Processes, end, end_quietly

from kitti_ros2.batch.manifest import MANIFEST, read_manifest
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import copied_drives, files_of  # isort: skip
from waiting import PATIENCE_S, wait_until  # isort: skip

distributed = pytest.importorskip('distributed', reason='clusters need the extra cluster')


OTHER_VERSION = """
import importlib.metadata as metadata
own = metadata.version
metadata.version = lambda name: '0.0.1' if name == 'kitti_ros2' else own(name)
"""


@pytest.fixture
def processes(tmp_path):
    with Processes(tmp_path / 'processes') as found:
        yield found


@pytest.fixture
def root(tmp_path, recordings):
    return copied_drives(recordings[Layout.RAW], tmp_path / 'root', 3)


@pytest.fixture
def out(tmp_path):
    return tmp_path / 'bags'


@pytest.fixture
def undisturbed(root, tmp_path):
    """The bags of a run without a signal."""
    out = tmp_path / 'undisturbed'
    assert main(['to-bag', str(root), str(out), '--all', '--jobs', '1', '-q']) == 0
    return bags(out)


def bags(out):
    return {name: data for name, data in files_of(out).items() if not name.startswith(MANIFEST)}


def test_the_unit_of_a_killed_worker_runs_elsewhere(processes, root, out, undisturbed):
    processes.scheduler()
    processes.arm()
    workers = [processes.worker(), processes.worker()]
    run = processes.run(root, out)
    pid = processes.blocked(run)
    assert pid in {worker.pid for worker in workers}
    os.kill(pid, signal.SIGKILL)
    code, _, err = end(run)
    assert (code, err) == (0, '')
    assert bags(out) == undisturbed


def test_a_unit_that_kills_its_workers_has_failed(processes, root, out, undisturbed):
    processes.scheduler()
    processes.arm()
    for _ in range(3):
        processes.worker()
    run = processes.run(root, out)
    first = processes.blocked(run)
    name = (processes.block / 'name').read_text()
    wait_until(lambda: sum(each.state == 'done' for each in read_manifest(out)[0]) == 2)
    processes.arm()
    os.kill(first, signal.SIGKILL)
    os.kill(processes.blocked(run), signal.SIGKILL)
    code, _, err = end(run)
    assert code == 1
    assert f'failed {name}: its worker was lost, 2 times' in err
    assert main(['to-bag', str(root), str(out), '--all', '--jobs', '1', '-q', '--retry']) == 0
    assert bags(out) == undisturbed


def test_a_run_whose_scheduler_was_killed_is_completed_by_the_next(
    processes, root, out, undisturbed
):
    scheduler = processes.scheduler()
    processes.arm()
    processes.worker()
    processes.worker()
    run = processes.run(root, out, unit=SPINNING)
    processes.blocked(run)
    wait_until(lambda: sum(each.state == 'done' for each in read_manifest(out)[0]) == 2)
    before = {path: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}
    scheduler.kill()
    code, _, err = end(run)
    assert code == 2
    (line,) = err.splitlines()
    assert 'the scheduler has ended' in line
    assert sorted(each.state for each in read_manifest(out)[0]) == ['done', 'done', 'todo']
    processes.scheduler()
    processes.worker()
    end_quietly(processes.run(root, out, '-q'))
    assert bags(out) == undisturbed
    assert {path: path.stat().st_mtime_ns for path in before if path.exists()} == before


@pytest.mark.parametrize('scheduler', [None, 'local'])
def test_ctrl_c_stops_the_units_of_the_workers(processes, root, out, undisturbed, scheduler):
    processes.arm()
    if scheduler is None:
        processes.scheduler()
        processes.worker()
    words = ('--jobs', '2') if scheduler else ()
    run = processes.run(root, out, *words, unit=SPINNING, scheduler=scheduler)
    processes.blocked(run)
    os.killpg(run.pid, signal.SIGINT)  # from a terminal: to all processes
    code, _, err = end(run)
    assert code == 130
    assert err == 'kitti-ros2: interrupted; no incomplete output is left behind\n'
    left = bags(out)
    assert all(undisturbed[each] == data for each, data in left.items())
    assert {each.state for each in read_manifest(out)[0]} <= {'todo', 'done'}


def test_a_worker_that_joins_late_is_waited_for(processes, root, out, undisturbed):
    processes.scheduler()
    run = processes.run(root, out, '-q')
    line = run.stderr.readline()
    assert 'has no workers; waiting for one' in line
    processes.worker()
    end_quietly(run)
    assert bags(out) == undisturbed


def test_a_worker_thought_lost_that_still_writes_publishes_nothing(
    processes, root, out, undisturbed
):
    processes.scheduler()
    processes.arm()
    first = processes.worker()
    run = processes.run(root, out, unit=SPINNING)
    processes.blocked(run)
    os.kill(first.pid, signal.SIGSTOP)  # it keeps its lock
    with distributed.Client(processes.address, set_as_default=False) as client:
        (address,) = client.scheduler_info()['workers']

        async def give_up(dask_scheduler):
            await dask_scheduler.remove_worker(address, stimulus_id='test', close=False)

        client.run_on_scheduler(give_up)
    processes.worker()
    assert end(run)[0] == 0
    assert bags(out) == undisturbed
    (processes.block / 'released').touch()
    os.kill(first.pid, signal.SIGCONT)
    assert first.wait(PATIENCE_S) is not None
    assert bags(out) == undisturbed


def test_a_late_worker_of_another_version_ends_the_run(root, out, tmp_path, processes):
    (tmp_path / 'other').mkdir()
    (tmp_path / 'other' / 'sitecustomize.py').write_text(OTHER_VERSION)
    processes.scheduler()
    worker = processes.worker()
    processes.arm()
    run = processes.run(root, out)
    processes.blocked(run)
    processes.worker(path=[tmp_path / 'other'])
    worker.kill()
    code, _, err = end(run)
    assert code == 2
    assert 'has kitti_ros2 0.0.1, expected' in err.splitlines()[-1]
    assert {each.state for each in read_manifest(out)[0]} <= {'todo', 'done'}
