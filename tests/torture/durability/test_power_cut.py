# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""After a power cut, what exit code 0 promised is there, and nothing else under a final name."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import foreign
import pytest
from power_cut import Record

from kitti_ros2.batch.manifest import DONE, MANIFEST, read_manifest
from kitti_ros2.cli import main
from kitti_ros2.kitti.append import mend
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from collections.abc import Callable

MOMENTS = 50
STATES = 4
"""At each moment, of the many that are possible."""


@pytest.fixture(scope='session')
def recorder(tmp_path_factory):
    """The library that records what a process does to files."""
    compiler = shutil.which('cc') or shutil.which('gcc')
    if compiler is None or sys.platform != 'linux':
        pytest.skip('no C compiler for Linux')
    out = tmp_path_factory.mktemp('recorder') / 'recorder.so'
    source = Path(__file__).with_name('recorder.c')
    subprocess.run([compiler, '-shared', '-fPIC', '-O1', '-o', out, source, '-ldl'], check=True)
    return out


@dataclass
class Sources:
    """What the commands read: a drive, an object set, bags of them, archives."""

    folder: Path
    recordings: object

    def drive(self) -> Path:
        return self.recordings[Layout.RAW]

    def bag(self) -> Path:
        out = self.folder / 'bag.mcap'
        if not out.exists():
            assert main(['to-bag', str(self.drive()), str(out), '-q']) == 0
        return out

    def cut_bag(self) -> Path:
        out = self.folder / 'cut.mcap'
        data = self.bag().read_bytes()
        out.write_bytes(data[: len(data) * 3 // 4])
        return out

    def foreign_bag(self) -> Path:
        out = self.folder / 'foreign.mcap'
        if not out.exists():
            foreign.write_foreign(out, foreign.make_truth())
        return out

    def archive(self) -> Path:
        out = self.folder / '2011_09_26_drive_0001_sync.zip'
        top = self.drive().parent
        with zipfile.ZipFile(out, 'w') as packed:
            for path in sorted(self.drive().rglob('*')):
                packed.write(path, Path(top.name) / path.relative_to(top))
        return out


@pytest.fixture(scope='module')
def sources(recordings, tmp_path_factory):
    return Sources(tmp_path_factory.mktemp('sources'), recordings)


def tree(path):
    """Return the files at a path by name, without those in hidden folders; None: it is absent."""
    if path.is_file():
        return {'': path.read_bytes()}
    if not path.exists():
        return None
    return {
        str(each.relative_to(path)): each.read_bytes()
        for each in path.rglob('*')
        if each.is_file() and not any(n.startswith('.') for n in each.relative_to(path).parts)
    }


def run_recorded(words, root, recorder, folder, *, codes=(0,)):
    """Run a command, and return the record of what it did below a root."""
    record = Record(root)
    copies, log = folder / 'copies', folder / 'log'
    copies.mkdir()
    environment = {
        **os.environ,
        'LD_PRELOAD': str(recorder),
        'WATCH_ROOT': os.path.realpath(root),
        'WATCH_LOG': str(log),
        'WATCH_COPIES': str(copies),
    }
    command = [sys.executable, '-m', 'kitti_ros2', *map(str, words)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode in codes, run.stderr
    record.read(log, copies)
    return record


def cut_power(record, folder, check: Callable[[Path, bool], None]):
    """Check states of the disk at moments during the run, and after it."""
    last = record.moments
    moments = sorted({round(last * i / MOMENTS) for i in range(MOMENTS)} | {last})
    for moment in moments:
        for seed in range(STATES):
            state = folder / 'state'
            record.rebuild(state, moment, Random(moment * STATES + seed))
            check(state, moment == last)
            shutil.rmtree(state)
    return len(moments)


def whole_old_or_absent(name, old, new):
    def check(state, done):
        found = tree(state / name)
        assert found == new if done else found in (old, new)

    return check


WRITERS = {
    'to-bag mcap': (lambda s: ['to-bag', s.drive(), 'OUT/o.mcap'], 'o.mcap'),
    'to-bag deep': (lambda s: ['to-bag', s.drive(), 'OUT/a/b/o.mcap'], 'a/b/o.mcap'),
    'to-bag sqlite3': (lambda s: ['to-bag', s.drive(), 'OUT/o', '--storage', 'sqlite3'], 'o'),
    'to-bag ros1': (lambda s: ['to-bag', s.drive(), 'OUT/o.bag'], 'o.bag'),
    'to-bag split': (lambda s: ['to-bag', s.drive(), 'OUT/o', '--split-size', '1MB'], 'o'),
    'to-kitti own': (lambda s: ['to-kitti', s.bag(), 'OUT/o'], 'o'),
    'to-kitti object': (lambda s: ['to-kitti', s.bag(), 'OUT/o', '--layout', 'object'], 'o'),
    'recover': (lambda s: ['recover', s.cut_bag(), 'OUT/o.mcap'], 'o.mcap'),
    'crop': (lambda s: ['crop', s.drive(), 'OUT/o', '--range', '1:30'], 'o'),
    'report': (lambda s: ['report', s.drive(), '-o', 'OUT/o.html'], 'o.html'),
}


def words_of(case, sources, root):
    return [str(each).replace('OUT', str(root)) for each in WRITERS[case][0](sources)]


@pytest.mark.parametrize('case', WRITERS)
def test_an_output_is_whole_or_absent_and_there_after_exit_0(case, sources, recorder, tmp_path):
    root = tmp_path / 'root'
    root.mkdir()
    words = words_of(case, sources, root)
    record = run_recorded([*words, '-q'], root, recorder, tmp_path, codes=(0, 1))
    name = WRITERS[case][1]
    new = tree(root / name)
    assert new
    assert cut_power(record, tmp_path, whole_old_or_absent(name, None, new)) > 10


@pytest.mark.parametrize('case', WRITERS)
def test_what_is_replaced_is_old_or_new(case, sources, recorder, tmp_path):
    root = tmp_path / 'root'
    root.mkdir()
    words = words_of(case, sources, root)
    assert main([*words, '-q']) in (0, 1)
    name = WRITERS[case][1]
    old = tree(root / name)
    if case != 'report':
        words += ['--end', '1'] if case.startswith('to-') else []
    record = run_recorded([*words, '-q', '--overwrite'], root, recorder, tmp_path, codes=(0, 1))
    new = tree(root / name)
    cut_power(record, tmp_path, whole_old_or_absent(name, old, new))


def test_the_next_run_clears_what_a_power_cut_left(sources, recorder, tmp_path):
    root = tmp_path / 'root'
    root.mkdir()
    words = words_of('to-kitti own', sources, root)
    record = run_recorded([*words, '-q'], root, recorder, tmp_path)
    new = tree(root / 'o')
    for number in range(1, 6):
        state = tmp_path / f'state{number}'
        record.rebuild(state, record.moments * number // 6, Random(number))
        again = words_of('to-kitti own', sources, state)
        assert main([*again, '-q', '--overwrite']) == 0
        assert [each.name for each in state.iterdir()] == ['o']
        assert tree(state / 'o') == new


def test_an_append_is_undone_or_complete(sources, recorder, tmp_path):
    root = tmp_path / 'root'
    first = ['to-kitti', str(sources.foreign_bag()), str(root / 'o'), '--layout', 'object', '-q']
    root.mkdir()
    assert main(first) in (0, 1)
    old = tree(root / 'o')
    record = run_recorded([*first, '--append'], root, recorder, tmp_path, codes=(0, 1))
    new = tree(root / 'o')
    assert new != old

    def check(state, done):
        mend(state / 'o')
        found = tree(state / 'o')
        assert found == new if done else found in (old, new)

    cut_power(record, tmp_path, check)


def test_extracted_files_are_whole_or_absent(sources, recorder, tmp_path):
    root = tmp_path / 'root'
    root.mkdir()
    words = ['extract', sources.archive(), root / 'o', '-q']
    record = run_recorded(words, root, recorder, tmp_path)
    new = tree(root / 'o')

    def check(state, done):
        found = tree(state / 'o') or {}
        assert found == new if done else found.items() <= new.items()

    cut_power(record, tmp_path, check)


@pytest.mark.parametrize('jobs', ['1', '2'])
def test_units_that_the_manifest_has_as_done_are_whole(sources, recorder, tmp_path, jobs):
    root, drives = tmp_path / 'root', tmp_path / 'drives'
    root.mkdir()
    date = sources.drive().parent
    for number in range(1, 5):
        shutil.copytree(sources.drive(), drives / date.name / f'{date.name}_drive_000{number}_sync')
    for path in date.glob('calib*'):
        shutil.copy(path, drives / date.name)
    words = ['to-bag', drives, root / 'o', '--all', '-q', '--jobs', jobs]
    record = run_recorded(words, root, recorder, tmp_path)
    new = {name: data for name, data in tree(root / 'o').items() if name.endswith('.mcap')}
    assert len(new) == 4

    def check(state, done):
        found = tree(state / 'o') or {}
        bags = {name: data for name, data in found.items() if name.endswith('.mcap')}
        assert bags == new if done else bags.items() <= new.items()
        if done or (state / 'o' / MANIFEST).exists():
            records, _ = read_manifest(state / 'o')
            finished = {f'{each.name}.mcap' for each in records if each.state == DONE}
            assert finished <= set(bags)
            assert not done or finished == set(new)

    cut_power(record, tmp_path, check)


def test_the_states_are_harsh_enough_to_find_what_is_not_synced(sources, recorder, tmp_path):
    """Without fsync, names without their content are found."""
    root = tmp_path / 'root'
    root.mkdir()
    words = ['to-bag', sources.drive(), root / 'o.mcap', '-q', '--no-fsync']
    record = run_recorded(words, root, recorder, tmp_path)
    new = tree(root / 'o.mcap')
    with pytest.raises(AssertionError):
        cut_power(record, tmp_path, whole_old_or_absent('o.mcap', None, new))
