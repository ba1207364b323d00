# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Manifests that are truncated, of another version, locked, no file; and clocks that go back."""

from __future__ import annotations

import errno
import shutil
import sqlite3
from contextlib import closing

import pytest
from faulty_runs import Faulty, build_faults, outputs

from kitti_ros2.batch.manifest import (
    DONE,
    MANIFEST,
    CollectionRun,
    Identity,
    JobRecord,
    measure_pace,
)
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

TINY = SyntheticOptions(frames=1, image_size=(62, 20), lidar_columns=20)


@pytest.fixture(scope='module')
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp('hostile') / 'root'
    drive = write_synthetic(folder, Layout.RAW, TINY)
    for number in range(2, 5):
        shutil.copytree(drive, drive.with_name(drive.name.replace('0001', f'{number:04d}')))
    return folder


@pytest.fixture(scope='module')
def finished(root):
    """The output folder of a run."""
    out = root.with_name('finished') / 'bags'
    assert to_bag(root, out) == 0
    return out


@pytest.fixture
def out(finished, tmp_path):
    """A copy of it."""
    return shutil.copytree(finished, tmp_path / 'bags')


def to_bag(root, out):
    return main(['to-bag', str(root), str(out), '--all', '--jobs', '1', '-q'])


def complained(capsys, out):
    """Return the one line that was printed; it names the manifest."""
    (line,) = capsys.readouterr().err.splitlines()
    assert str(out / MANIFEST) in line
    assert 'internal error' not in line
    return line


@pytest.mark.parametrize('part', range(1, 21))
def test_a_truncated_manifest_is_refused_and_outputs_are_kept(part, root, out, finished, capsys):
    whole = (out / MANIFEST).read_bytes()
    cut = whole[: len(whole) * part // 21]
    (out / MANIFEST).write_bytes(cut)
    assert main(['status', str(out)]) == 2
    complained(capsys, out)
    assert to_bag(root, out) == 2
    complained(capsys, out)
    assert outputs(out) == outputs(finished)
    assert (out / MANIFEST).read_bytes() == cut


def test_a_directory_in_the_place_of_the_manifest_is_one_line(root, out, finished, capsys):
    (out / MANIFEST).unlink()
    (out / MANIFEST).mkdir()
    assert main(['status', str(out)]) == 2
    complained(capsys, out)
    assert to_bag(root, out) == 2
    complained(capsys, out)
    assert outputs(out) == outputs(finished)


def test_a_manifest_of_another_version_is_kept(root, out, finished, capsys):
    with closing(sqlite3.connect(out / MANIFEST)) as database:
        database.execute('PRAGMA user_version = 99')
    before = (out / MANIFEST).read_bytes()
    assert main(['status', str(out)]) == 2
    assert 'version 99' in complained(capsys, out)
    assert to_bag(root, out) == 2
    assert 'version 99' in complained(capsys, out)
    assert (out / MANIFEST).read_bytes() == before
    assert outputs(out) == outputs(finished)


def test_a_locked_manifest_is_one_line(root, out, finished, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.batch.manifest._BUSY_S', 0.01)
    with closing(sqlite3.connect(out / MANIFEST, isolation_level=None)) as database:
        database.execute('BEGIN EXCLUSIVE')
        assert main(['status', str(out)]) == 2
        assert 'close the program that has it open' in complained(capsys, out)
        assert to_bag(root, out) == 2
        assert 'close the program that has it open' in complained(capsys, out)
    assert to_bag(root, out) == 0
    assert outputs(out) == outputs(finished)


def test_a_folder_that_becomes_read_only_is_one_line(root, finished, tmp_path):
    run = Faulty(build_faults(tmp_path), root, tmp_path / 'bags')
    shutil.copytree(finished, run.out)
    code, complaints = run.run(1, path='bags', at=1, do='errors', code=errno.EROFS)
    assert code == 2
    assert len(complaints.splitlines()) == 1
    assert 'internal error' not in complaints
    assert outputs(run.out) == outputs(finished)
    assert run.run(1) == (0, '')


def test_a_clock_that_goes_back_gives_no_rate():
    run = CollectionRun(1, 'to-bag', 2, started=1000.0)
    identity = Identity('', '', '', '')
    records = [
        JobRecord('a', DONE, identity, run=1, ended=900.0),
        JobRecord('b', 'todo', identity),
    ]
    pace = measure_pace(records, run)
    assert (pace.recent, pace.recent_seconds, pace.seconds_left) == (1, 0.0, None)


def test_a_clock_that_goes_back_does_not_repeat_units(root, out, monkeypatch):
    monkeypatch.setattr('kitti_ros2.batch.manifest.time.time', lambda: 5.0)
    for path in out.rglob('*.mcap'):
        path.touch()
    before = {path: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}
    assert to_bag(root, out) == 0
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}
