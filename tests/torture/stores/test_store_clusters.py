# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Dask workers that have only a store in common: SRC and OUT are URLs, no disk is shared."""

from __future__ import annotations

import json
import os
import shutil
import signal

import pytest

pytest.importorskip('distributed', reason='clusters need the extra cluster')
pytest.importorskip('s3fs', reason='s3:// needs s3fs')

from dask_processes import Processes, end

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import copied_drives, files_of  # isort: skip

DRIVES = 4


@pytest.fixture
def drives(recordings, tmp_path):
    """Four drives of one date."""
    return copied_drives(recordings[Layout.RAW], tmp_path / 'raw', DRIVES)


@pytest.fixture
def undisturbed(drives, tmp_path):
    """The bags of a local run in one process."""
    out = tmp_path / 'local'
    assert main(['to-bag', str(drives), str(out), '--all', '--jobs', '1', '-q']) == 0
    return {name: data for name, data in files_of(out).items() if name.endswith('.mcap')}


@pytest.fixture
def stored(drives, undisturbed, s3, tmp_path, monkeypatch):  # noqa: ARG001 - it needs the drives
    """The URL of the drives, of which nothing is left on the disk."""
    for path in drives.rglob('*'):
        if path.is_file():
            s3.put(f'raw/{path.relative_to(drives)}', path.read_bytes())
    shutil.rmtree(drives)
    shutil.rmtree(tmp_path / 'local')
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))
    return f'{s3.url}/raw'


@pytest.fixture
def processes(tmp_path):
    with Processes(tmp_path / 'processes') as found:
        yield found


def host(processes, name):
    """Start a worker as on a host of its own: with its own working, home and temporary folder."""
    folder = processes.folder / name
    (folder / 'tmp').mkdir(parents=True)
    return processes.worker(
        cwd=folder, variables={'HOME': folder, 'TMPDIR': folder / 'tmp', 'XDG_STATE_HOME': folder}
    )


def bags(s3):
    return {
        key.removeprefix('bags/'): data
        for key, data in s3.objects().items()
        if key.startswith('bags/') and key.endswith('.mcap')
    }


def files_below(folder):
    return [path for path in folder.rglob('*.mcap*') if path.is_file()]


def test_bytes_are_those_of_a_local_run(processes, stored, undisturbed, s3):
    processes.scheduler()
    hosts = [host(processes, name) for name in ('first', 'second')]
    run = processes.run(stored, f'{s3.url}/bags', '--json')
    code, out, err = end(run)
    assert (code, err) == (0, '')
    assert json.loads(out)['ran'] == DRIVES
    assert bags(s3) == undisturbed
    assert {key for key in s3.objects() if key.startswith('bags/')} == {
        'bags/manifest.sqlite',
        *(f'bags/{name}' for name in undisturbed),
    }
    assert not files_below(processes.folder)
    assert all(each.poll() is None for each in hosts)


def test_the_unit_of_a_killed_host_runs_on_another(processes, stored, undisturbed, s3):
    processes.scheduler()
    processes.arm()
    hosts = [host(processes, name) for name in ('first', 'second')]
    run = processes.run(stored, f'{s3.url}/bags')
    pid = processes.blocked(run)
    assert pid in {each.pid for each in hosts}
    name = (processes.block / 'name').read_text()
    assert f'{name}.mcap' not in bags(s3)
    os.kill(pid, signal.SIGKILL)
    code, _, err = end(run)
    assert (code, err) == (0, '')
    assert bags(s3) == undisturbed
    assert not s3.unfinished()
    assert not [key for key in s3.objects() if '.partial' in key or key.endswith('.lock')]


def test_a_rerun_on_another_cluster_runs_nothing(processes, stored, undisturbed, s3, monkeypatch):
    for name in ('first', 'second'):
        processes.scheduler()
        host(processes, name)
        monkeypatch.setenv('XDG_STATE_HOME', str(processes.folder / f'state of {name}'))
        code, out, err = end(processes.run(stored, f'{s3.url}/bags', '--json'))
        assert (code, err) == (0, '')
        assert json.loads(out)['ran'] == (DRIVES if name == 'first' else 0)
    assert bags(s3) == undisturbed
