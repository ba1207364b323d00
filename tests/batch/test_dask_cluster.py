# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-bag --all on a Dask cluster: bytes, paths, versions, errors."""

from __future__ import annotations

import os
import socket
import subprocess
import sys

import cv2
import pytest
from dask_processes import Processes

from kitti_ros2.batch.dask_cluster import DaskCluster, DaskTask, run_dask_task
from kitti_ros2.batch.jobs import Job
from kitti_ros2.batch.manifest import MANIFEST
from kitti_ros2.batch.pool import JobResult, JobTask
from kitti_ros2.cli import main
from kitti_ros2.files.threads import worker_count
from kitti_ros2.model.streams import Layout

from builders import copied_drives, files_of, one_line  # isort: skip

pytestmark = pytest.mark.programs

distributed = pytest.importorskip('distributed', reason='clusters need the extra cluster')

DRIVES = 3
VERSION = __import__('kitti_ros2').__version__


@pytest.fixture(scope='session')
def cluster():
    """Two worker processes of one thread."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host='127.0.0.1', dashboard_address=None, memory_limit=0
    ) as found:
        yield found


@pytest.fixture
def root(tmp_path, recordings):
    """Three drives."""
    return copied_drives(recordings[Layout.RAW], tmp_path / 'root', DRIVES)


def drives(root):
    return sorted(path for path in root.glob('*/*') if path.is_dir())


@pytest.fixture
def out(tmp_path):
    return tmp_path / 'bags'


@pytest.fixture
def processes(tmp_path):
    with Processes(tmp_path / 'processes') as found:
        yield found


def to_bag(root, out, *words):
    return main(['to-bag', str(root), str(out), '--all', '-q', *words])


def bags(out):
    return {name: data for name, data in files_of(out).items() if name != MANIFEST}


@pytest.mark.parametrize('images', ['raw', 'compressed'])
def test_bytes_are_those_of_one_process_and_of_several(root, tmp_path, cluster, images):
    for path in sorted(drives(root)[1].glob('*/data/*'))[::3]:
        path.unlink()  # holes in the numbers
    ways = {
        'serial': ['--jobs', '1'],
        'processes': ['--jobs', '2'],
        'dask': ['--scheduler', cluster.scheduler_address],
    }
    codes = {
        name: to_bag(root, tmp_path / name, '--images', images, *words)
        for name, words in ways.items()
    }
    assert len(set(codes.values())) == 1, codes
    serial, *others = (bags(tmp_path / name) for name in ways)
    assert len(serial) == DRIVES
    for other in others:
        assert other == serial


def test_losses_and_failures_are_those_of_processes(root, tmp_path, cluster, capsys):
    first, _, last = drives(root)
    sorted((first / 'velodyne_points' / 'data').iterdir())[1].write_bytes(b'12345')
    (last / 'oxts' / 'timestamps.txt').write_text('no time\n')
    said = []
    for name, words in {
        'processes': ['--jobs', '2'],
        'dask': ['--scheduler', cluster.scheduler_address],
    }.items():
        assert to_bag(root, tmp_path / name, *words) == 1
        said.append(capsys.readouterr().err.replace(str(tmp_path / name), 'OUT'))
    assert said[0] == said[1]


def test_what_is_done_is_skipped(root, out, cluster):
    words = ('--scheduler', cluster.scheduler_address, '--topics', '/kitti/oxts/*')
    assert to_bag(root, out, *words) == 0
    before = {path: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}
    assert len(before) == DRIVES
    next(iter(before)).unlink()
    assert to_bag(root, out, *words) == 0
    after = {path: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}
    assert len(before.items() & after.items()) == DRIVES - 1


def test_the_number_of_workers_is_shown(root, out, cluster, capsys):
    words = ['--scheduler', cluster.scheduler_address, '--topics', '/kitti/oxts/*']
    assert main(['to-bag', str(root), str(out), '--all', *words]) == 0
    assert f'{DRIVES} units run on 2 workers' in capsys.readouterr().out


def test_a_cluster_of_this_machine_leaves_no_folders(root, out, tmp_path):
    folder = tmp_path / ('temporary' * 10)  # its sockets would have names that are too long
    folder.mkdir()
    command = [sys.executable, '-m', 'kitti_ros2', 'to-bag', str(root), str(out), '--all', '-q']
    words = ['--scheduler', 'local', '--jobs', '1', '--topics', '/kitti/oxts/*']
    subprocess.run([*command, *words], env={**os.environ, 'TMPDIR': str(folder)}, check=True)
    assert len(bags(out)) == DRIVES
    assert not [*folder.iterdir()]


@pytest.mark.usefixtures('root')
def test_workers_have_working_folders_of_their_own(tmp_path, processes, monkeypatch, capsys):
    processes.scheduler()
    for name in ('one', 'two'):
        (tmp_path / name).mkdir()
        processes.worker(cwd=tmp_path / name)
    monkeypatch.chdir(tmp_path)
    words = ('--scheduler', processes.address, '--topics', '/kitti/oxts/*')
    assert to_bag('root', 'bags', *words) == 0, capsys.readouterr().err
    assert to_bag('root', 'serial', '--jobs', '1', '--topics', '/kitti/oxts/*') == 0
    assert bags(tmp_path / 'bags') == bags(tmp_path / 'serial')
    assert not [*(tmp_path / 'one').iterdir(), *(tmp_path / 'two').iterdir()]


@pytest.mark.parametrize('place', ['source', 'witness', 'out'])
def test_a_worker_that_does_not_see_a_path_says_what_is_needed(tmp_path, cluster, place):
    (tmp_path / 'witness').touch()
    places = {'source': tmp_path, 'witness': tmp_path / 'witness', 'out': tmp_path / 'out.mcap'}
    places[place] = tmp_path / 'elsewhere' / 'x'
    job = Job('x', places['source'], Layout.RAW)
    task = DaskTask(_refuse, JobTask(job, places['out'], {}), '', VERSION, places['witness'])
    with distributed.Client(cluster, set_as_default=False) as client:
        result = client.submit(run_dask_task, task).result()
    unseen = places[place].parent if place == 'out' else places[place]
    assert result.reason.startswith(f'{unseen}: not found on the worker tcp://')
    assert 'must be at the same path on all workers, or be URLs' in result.reason


def _refuse(_job, _advance):
    raise AssertionError


def test_workers_use_one_thread(tmp_path, cluster):
    (tmp_path / 'witness').touch()
    job = Job('x', tmp_path, Layout.RAW)
    task = DaskTask(_threads, JobTask(job, tmp_path / 'o', {}), '', VERSION, tmp_path / 'witness')
    with distributed.Client(cluster, set_as_default=False) as client:
        assert client.submit(run_dask_task, task).result().counts == {'ours': 1, 'opencv': 1}


def _threads(_job, _advance):
    return JobResult(counts={'ours': worker_count(), 'opencv': cv2.getNumThreads()})


class Tasks:
    """A number of tasks; counts those that are out."""

    def __init__(self, count, folder):
        self.left, self.folder = list(range(count)), folder
        self.taken = 0

    def take(self):
        if not self.left:
            return None
        self.taken += 1
        job = Job(str(self.left.pop()), self.folder, Layout.RAW)
        return JobTask(job, self.folder / 'out', {})


def test_few_jobs_are_at_the_scheduler_at_a_time(tmp_path, cluster):
    (tmp_path / 'witness').touch()
    tasks, ended, most = Tasks(12, tmp_path), 0, 0
    with distributed.Client(cluster, set_as_default=False) as client:
        found = DaskCluster(client, 'it', VERSION, pytest.fail)
        for task, result in found.run(tasks, _report, lambda *_: None, tmp_path / 'witness'):
            assert result.counts == {'name': int(task.job.name)}
            most = max(most, tasks.taken - ended)
            ended += 1
    assert ended == 12
    assert most <= 2 * 2


def _report(task, advance):
    advance(1, 1)
    return JobResult(counts={'name': int(task.job.name)})


def test_a_unit_that_raises_has_failed(tmp_path, cluster):
    (tmp_path / 'witness').touch()
    with distributed.Client(cluster, set_as_default=False) as client:
        found = DaskCluster(client, 'it', VERSION, pytest.fail)
        outcomes = list(found.run(Tasks(2, tmp_path), _refuse, print, tmp_path / 'witness'))
    assert ['AssertionError' in result.reason for _, result in outcomes] == [True, True]


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ("__version__ = '0.0.1'", 'has kitti_ros2 0.0.1, expected'),
        ('raise ImportError', 'has no kitti_ros2, expected'),
    ],
)
def test_workers_of_another_version_are_refused(
    root, out, tmp_path, processes, capsys, text, complaint
):
    (tmp_path / 'other' / 'kitti_ros2').mkdir(parents=True)
    (tmp_path / 'other' / 'kitti_ros2' / '__init__.py').write_text(text)
    processes.scheduler()
    processes.worker(path=[tmp_path / 'other'])
    assert to_bag(root, out, '--scheduler', processes.address) == 2
    line = one_line(capsys.readouterr().err.splitlines()[-1])
    assert complaint in line
    assert 'the worker tcp://' in line
    assert not out.exists()


def test_a_scheduler_that_does_not_answer_is_one_line(root, out, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.batch.dask_cluster._CONNECT_S', 0.5)
    with socket.create_server(('127.0.0.1', 0)) as silent:
        address = f'tcp://127.0.0.1:{silent.getsockname()[1]}'
        assert to_bag(root, out, '--scheduler', address) == 2
    assert f'{address}: no Dask scheduler answers' in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_without_dask_the_extra_is_named(root, out, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.batch.dask_cluster.find_spec', lambda _: None)
    assert to_bag(root, out, '--scheduler', 'local') == 2
    assert "pip install 'kitti_ros2[cluster]'" in one_line(capsys.readouterr().err)


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--scheduler', 'local'], '--scheduler is for whole collections'),
        (['--all', '--scheduler', 'tcp://h:1', '--jobs', '2'], 'leave --jobs out'),
        (['--all', '--scheduler', 'somewhere'], 'expected tcp://HOST:PORT, or local'),
        (['--all', '--scheduler', 'tcp://host'], 'expected tcp://HOST:PORT, or local'),
    ],
)
def test_options_that_do_not_go_together_are_one_line(root, out, words, complaint, capsys):
    assert main(['to-bag', str(root), str(out), *words]) == 2
    assert complaint in one_line(capsys.readouterr().err)
    assert not out.exists()
