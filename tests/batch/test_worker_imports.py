# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the processes of a collection import: once for all workers, and nothing that is unused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kitti_ros2.batch.dask_cluster import open_cluster, own_version
from kitti_ros2.batch.jobs import Job
from kitti_ros2.batch.pool import JobResult, JobTask, prepare_workers, run_on_processes
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.table import LOCAL

from builders import copied_drives  # isort: skip

pytestmark = pytest.mark.programs

WORKER = """
import gc, multiprocessing, sys
from kitti_ros2.batch.pool import prepare_workers


def report(connection, modules):
    loaded = [name in sys.modules for name in modules]
    connection.send((gc.isenabled(), gc.get_freeze_count() > 1000, loaded))


if __name__ == '__main__':
    cluster = sys.argv[1] == 'cluster'
    prepare_workers(cluster=cluster)
    context = multiprocessing.get_context('forkserver')
    ours, theirs = context.Pipe()
    modules = ['kitti_ros2.own_bags.to_bag'] + ['distributed.nanny'] * cluster
    context.Process(target=report, args=(theirs, modules)).start()
    print(ours.recv(), gc.get_freeze_count())
"""


@pytest.mark.parametrize(('kind', 'count'), [('pool', 1), ('cluster', 2)])
def test_workers_start_with_what_they_need_and_collect_garbage(tmp_path, kind, count):
    if kind == 'cluster':
        pytest.importorskip('distributed', reason='clusters need the extra cluster')
    program = tmp_path / 'program.py'
    program.write_text(WORKER)
    run = subprocess.run(
        [sys.executable, program, kind], capture_output=True, text=True, check=True
    )
    assert run.stdout == f'(True, True, {[True] * count}) 0\n'


def test_a_local_cluster_does_not_import_pandas(tmp_path, recordings):
    pytest.importorskip('distributed', reason='clusters need the extra cluster')
    root = copied_drives(recordings[Layout.RAW], tmp_path / 'root', 1)
    (tmp_path / 'modules').mkdir()
    planted = f'open({str(tmp_path / "imported")!r}, "w")\n'
    (tmp_path / 'modules' / 'pandas.py').write_text(planted)
    words = ['to-bag', root, tmp_path / 'out', '--all', '--scheduler', 'local', '--jobs', '1', '-q']
    run = subprocess.run(
        [sys.executable, '-m', 'kitti_ros2', *words],
        env={**os.environ, 'PYTHONPATH': str(tmp_path / 'modules')},
        check=False,
    )
    assert run.returncode == 0
    assert not (tmp_path / 'imported').exists()


def _told(task, _advance):
    return JobResult(reason=os.environ.get(task.job.name, ''))


class _Tasks:
    def __init__(self, *names):
        self.names = list(names)

    def take(self):
        if not self.names:
            return None
        return JobTask(Job(self.names.pop(), Path(), Layout.RAW), Path('out'), {})


@pytest.mark.parametrize('value', ['first', 'second'])
def test_workers_see_the_environment_of_now(monkeypatch, value):
    prepare_workers()
    monkeypatch.setenv('KITTI_ROS2_TEST', value)
    (found,) = run_on_processes(_Tasks('KITTI_ROS2_TEST'), _told, print, 1, 0)
    assert found[1].reason == value


@pytest.mark.parametrize('value', ['first', 'second'])
def test_workers_of_a_local_cluster_see_the_environment_of_now(tmp_path, monkeypatch, value):
    pytest.importorskip('distributed', reason='clusters need the extra cluster')
    (tmp_path / 'witness').touch()
    prepare_workers(cluster=True)
    monkeypatch.setenv('KITTI_ROS2_TEST', value)
    with open_cluster(LOCAL, 1, own_version(), print) as cluster:
        tasks = _Tasks('KITTI_ROS2_TEST')
        (found,) = cluster.run(tasks, _told, lambda *_: None, tmp_path / 'witness')
    assert found[1].reason == value
