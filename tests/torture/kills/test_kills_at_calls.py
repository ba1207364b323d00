# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""SIGKILL at calls spread over a run: of a worker, of the run, of its whole group."""

from __future__ import annotations

import errno
import os
import shutil
from functools import cache

import pytest
from faulty_runs import Faulty, build_faults, check_completed, check_left, outputs, states

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

UNITS = 4
MANY = 200
TINY = SyntheticOptions(frames=1, image_size=(62, 20), lidar_columns=20)
ONLY_SCANS = ('--topics', '/kitti/velo/*')


def copies(drive, count):
    """Copy a drive, by hard links, until there are so many."""
    for number in range(2, count + 1):
        copy = drive.with_name(drive.name.replace('0001', f'{number:04d}'))
        shutil.copytree(drive, copy, copy_function=os.link)


@pytest.fixture(scope='module')
def library(tmp_path_factory):
    return build_faults(tmp_path_factory.mktemp('faults'))


@pytest.fixture(scope='module')
def root(tmp_path_factory):
    """Drives of one tiny frame."""
    folder = tmp_path_factory.mktemp('few') / 'root'
    copies(write_synthetic(folder, Layout.RAW, TINY), UNITS)
    return folder


@pytest.fixture(scope='module')
def undisturbed(root):
    """The output folder of a run without faults."""
    out = root.with_name('undisturbed') / 'bags'
    assert main(['to-bag', str(root), str(out), '--all', '--jobs', '1', '-q']) == 0
    return out


@pytest.fixture(scope='module')
def calls(library, root, tmp_path_factory):
    """A function that returns how many calls an undisturbed run makes."""

    @cache
    def count(jobs, path):
        folder = tmp_path_factory.mktemp('calls')
        return Faulty(library, root, folder / 'bags').count(folder, jobs, of='main', path=path)

    return count


@pytest.fixture
def run(library, root, tmp_path):
    return Faulty(library, root, tmp_path / 'bags')


@pytest.mark.parametrize('moment', range(1, 6))
@pytest.mark.parametrize(('jobs', 'what'), [(1, 'self'), (2, 'self'), (2, 'group')])
def test_a_run_killed_at_a_change_of_the_manifest(jobs, what, moment, run, undisturbed, calls):
    faults = {'of': 'main', 'path': 'manifest.sqlite'}
    at = max(1, calls(jobs, faults['path']) * moment // 6)
    code, _ = run.run(jobs, at=at, do=what, **faults)
    assert code == -9
    check_completed(run, jobs, undisturbed)


@pytest.mark.parametrize('moment', range(1, 5))
def test_a_serial_run_killed_at_a_change_of_an_output(moment, run, undisturbed, calls):
    at = max(1, calls(1, '.partial') * moment // 5)
    code, _ = run.run(1, at=at, do='self', path='.partial')
    assert code == -9
    check_completed(run, 1, undisturbed)


@pytest.mark.parametrize('call', [1, 3, 8, 21, 26])
def test_a_worker_killed_at_a_change_of_an_output(call, run, undisturbed, tmp_path):
    once = tmp_path / 'once'
    once.touch()
    code, complaints = run.run(2, at=call, do='self', path='.partial', once=once)
    assert (code, complaints) == (0, '')
    assert not once.exists(), 'a worker was killed'
    assert outputs(run.out) == outputs(undisturbed)
    check_completed(run, 2, undisturbed)


def test_two_workers_killed_by_one_unit_leave_no_partial_output(run, undisturbed):
    """Every worker is killed at its first unit, so that all units fail."""
    code, complaints = run.run(2, at=5, do='self', of='workers', path='.partial')
    assert code == 1
    assert complaints.count('its worker process was killed by signal 9, 2 times') == UNITS
    assert set(states(run.out).values()) == {'failed'}
    assert not list(run.out.rglob('.*.partial'))
    retried = Faulty(run.library, run.root, run.out, ('--retry',))
    check_completed(retried, 2, undisturbed)


@pytest.mark.parametrize('moment', range(1, 5))
@pytest.mark.parametrize('path', ['manifest.sqlite', '.partial'])
def test_a_full_disk_is_one_line_and_loses_nothing(moment, path, run, undisturbed, calls):
    at = max(1, calls(1, path) * moment // 5)
    code, complaints = run.run(1, at=at, do='errors', code=errno.ENOSPC, path=path)
    assert 'Traceback' not in complaints
    assert 'internal error' not in complaints
    lines = complaints.splitlines()
    if path == 'manifest.sqlite':
        assert (code, len(lines)) == (2, 1)
        assert 'check the room on the disk' in lines[0]
        check_completed(run, 1, undisturbed)
    else:
        assert code == 1
        assert all(each.startswith('failed ') for each in lines[:-1])
        assert 'the disk is full' in lines[0]
        check_left(run.out, outputs(undisturbed))
        check_completed(Faulty(run.library, run.root, run.out, ('--retry',)), 1, undisturbed)


def test_five_kills_of_a_run_over_many_units(library, tmp_path):
    root, out = tmp_path / 'root', tmp_path / 'bags'
    copies(write_synthetic(root, Layout.RAW, TINY), MANY)
    undisturbed = tmp_path / 'undisturbed' / 'bags'
    words = ['to-bag', str(root), str(undisturbed), '--all', '--jobs', '1', '-q', *ONLY_SCANS]
    assert main(words) == 0
    run = Faulty(library, root, out, ONLY_SCANS)
    faults = {'of': 'main', 'path': 'manifest.sqlite', 'do': 'group'}
    done = set()
    for calls in (150, 300, 500, 200, 350):
        code, _ = run.run(2, at=calls, **faults)
        assert code == -9
        now = check_left(out, outputs(undisturbed))
        assert done <= now
        done = now
    assert 0 < len(done) < MANY
    check_completed(run, 2, undisturbed)
