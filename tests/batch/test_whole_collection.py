# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-bag --all: bytes, skipped and repeated units, losses, failures."""

from __future__ import annotations

import errno
import json
import os
import shutil
import sqlite3
import subprocess
import sys

import pytest

from kitti_ros2.batch.manifest import MANIFEST, read_manifest
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import copied_drives, files_of  # isort: skip

DRIVES = 4


@pytest.fixture
def root(tmp_path, recordings):
    """Four drives; images only of one camera, to be fast."""
    return copied_drives(recordings[Layout.RAW], tmp_path / 'root', DRIVES)


@pytest.fixture
def out(tmp_path):
    return tmp_path / 'bags'


def to_bag(root, out, *words):
    return main(['to-bag', str(root), str(out), '--all', '-q', *words])


def drives(root):
    return sorted(path for path in root.glob('*/*') if path.is_dir())


def bags(out):
    return {name: data for name, data in files_of(out).items() if name != MANIFEST}


def states(out):
    return {record.name.split('_')[-2]: record.state for record in read_manifest(out)[0]}


def times(out):
    return {path.name: path.stat().st_mtime_ns for path in out.rglob('*.mcap')}


def test_bytes_are_those_of_the_plain_command_for_any_number_of_jobs(root, out, tmp_path):
    assert to_bag(root, out, '--jobs', '2') == 0
    assert to_bag(root, tmp_path / 'serial', '--jobs', '1') == 0
    assert bags(out) == bags(tmp_path / 'serial')
    assert len(bags(out)) == DRIVES
    for drive in drives(root):
        plain = tmp_path / 'plain' / f'{drive.name}.mcap'  # a bag has its own name in it
        assert main(['to-bag', str(drive), str(plain), '-q']) == 0
        name = f'{drive.parent.name}/{drive.name}.mcap'
        assert bags(out)[name] == plain.read_bytes()


def test_what_is_done_is_skipped_until_input_options_or_output_change(root, out):
    words = ('--jobs', '1', '--topics', '/kitti/oxts/*')
    assert to_bag(root, out, *words) == 0
    before = times(out)
    assert to_bag(root, out, *words) == 0
    assert times(out) == before
    changed, removed = [f'{drive.name}.mcap' for drive in drives(root)[:2]]
    os.utime(drives(root)[0] / 'oxts' / 'timestamps.txt', ns=(1, 1))
    next(out.rglob(removed)).unlink()
    assert to_bag(root, out, *words) == 0
    after = times(out)
    assert {name for name in before if before[name] != after[name]} == {changed, removed}
    assert to_bag(root, out, '--jobs', '1', '--topics', '/tf') == 0
    assert not after.items() & times(out).items()


def test_another_version_runs_all_again(root, out, monkeypatch):
    words = ('--jobs', '1', '--topics', '/kitti/oxts/*')
    assert to_bag(root, out, *words) == 0
    before = times(out)
    monkeypatch.setattr('kitti_ros2.__version__', '99.0')
    assert to_bag(root, out, *words) == 0
    assert not before.items() & times(out).items()


@pytest.mark.parametrize('place', ['temporary', 'temporary' * 10])
def test_nothing_is_left_among_the_temporary_files(root, out, tmp_path, place):
    """Sockets in a folder of a long name would have names that are too long."""
    folder = tmp_path / place
    folder.mkdir()
    command = [sys.executable, '-m', 'kitti_ros2', 'to-bag', str(root), str(out), '--all', '-q']
    words = ['--jobs', '2', '--topics', '/kitti/oxts/*']
    subprocess.run([*command, *words], env={**os.environ, 'TMPDIR': str(folder)}, check=True)
    assert times(out)
    assert not [*folder.iterdir()]


@pytest.mark.parametrize('jobs', ['1', '2'])
def test_one_bad_unit_does_not_stop_the_rest(root, out, jobs, capsys):
    bad = drives(root)[1]
    for folder in bad.iterdir():
        shutil.rmtree(folder) if folder.is_dir() else folder.unlink()
    (bad / 'oxts' / 'data').mkdir(parents=True)
    (bad / 'oxts' / 'timestamps.txt').write_text('no time\n')
    assert to_bag(root, out, '--jobs', jobs) == 1
    complained = capsys.readouterr().err
    assert f'failed {bad.parent.name}/{bad.name}: ' in complained
    assert 'Traceback' not in complained
    assert states(out) == {'0001': 'done', '0002': 'failed', '0003': 'done', '0004': 'done'}
    assert len(bags(out)) == DRIVES - 1


def test_a_failed_unit_runs_again_with_retry_or_with_new_input(root, out, capsys):
    path = out / drives(root)[0].parent.name / f'{drives(root)[0].name}.mcap'
    path.parent.mkdir(parents=True)
    path.write_text('mine')
    words = ('--jobs', '1', '--topics', '/kitti/oxts/*')
    assert to_bag(root, out, *words) == 1
    assert 'exists already' in capsys.readouterr().err
    assert path.read_text() == 'mine'
    path.unlink()
    assert to_bag(root, out, *words) == 1, 'a failed unit stays failed'
    assert not path.exists()
    assert to_bag(root, out, *words, '--retry') == 0
    assert path.exists()
    assert set(states(out).values()) == {'done'}


def test_files_of_others_are_replaced_with_overwrite_only(root, out):
    path = out / drives(root)[0].parent.name / f'{drives(root)[0].name}.mcap'
    shutil.copytree(root, out.parent / 'other')
    assert to_bag(out.parent / 'other', out, '--jobs', '1', '--topics', '/tf') == 0
    before = path.read_bytes()
    assert to_bag(root, out, '--jobs', '1', '--topics', '/kitti/oxts/*') == 1
    assert path.read_bytes() == before
    words = ('--jobs', '1', '--topics', '/kitti/oxts/*', '--overwrite', '--retry')
    assert to_bag(root, out, *words) == 0
    assert path.read_bytes() != before


def test_losses_are_counted_listed_and_remembered(root, out, capsys):
    scan = sorted((drives(root)[2] / 'velodyne_points' / 'data').iterdir())[1]
    scan.write_bytes(b'12345')
    for _ in range(2):
        assert to_bag(root, out, '--jobs', '2') == 1
        assert str(scan) in capsys.readouterr().err
    assert main(['status', str(out), '--json']) == 1
    units = json.loads(capsys.readouterr().out)['units']
    assert [unit['bad'] > 0 for unit in units] == [False, False, True, False]
    assert {unit['state'] for unit in units} == {'done'}


def test_retry_runs_units_again_that_skipped_data(root, out, monkeypatch, tmp_path):
    """Such as for a disk that failed once."""
    words = ('--jobs', '1', '--topics', '/kitti/oxts/*')
    unread = drives(root)[1] / 'oxts' / 'data'
    listdir = os.listdir

    def fail(folder):
        if folder == unread:
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(folder))
        return listdir(folder)

    with monkeypatch.context() as broken:
        broken.setattr(os, 'listdir', fail)
        assert to_bag(root, out, *words) == 1
        before = times(out)
        assert to_bag(root, out, *words, '--retry') == 1
    again = times(out)
    changed = [name for name in again if again[name] != before[name]]
    assert changed == [f'{drives(root)[1].name}.mcap']
    assert to_bag(root, out, *words) == 1
    assert times(out) == again
    assert to_bag(root, out, *words, '--retry') == 0
    assert to_bag(root, tmp_path / 'undisturbed', *words) == 0
    assert bags(out) == bags(tmp_path / 'undisturbed')


def test_slices_of_an_object_set(recordings, out, capsys):
    words = ('--jobs', '2', '--slice-frames', '2', '--json')
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(out), '--all', *words]) == 0
    result = json.loads(capsys.readouterr().out)
    counts = [unit['counts']['frames'] for unit in result['units']]
    assert sum(counts) == 5
    assert max(counts) == 2
    assert len(list(out.rglob('*.mcap'))) == len(counts) == 3


@pytest.mark.parametrize('words', [('--storage', 'sqlite3'), ('--split-size', '1MB')])
def test_outputs_that_are_directories(root, out, words):
    assert to_bag(root, out, '--jobs', '1', '--topics', '/kitti/oxts/*', *words) == 0
    for drive in drives(root):
        assert (out / drive.parent.name / drive.name / 'metadata.yaml').is_file()


def test_ros1_outputs_end_in_bag(root, out):
    assert to_bag(root, out, '--jobs', '1', '--topics', '/kitti/oxts/*', '--storage', 'ros1') == 0
    assert len(list(out.rglob('*.bag'))) == DRIVES


def test_summary_and_status(root, out, capsys):
    words = ['--all', '--jobs', '2', '--topics', '/kitti/oxts/*']
    assert main(['to-bag', str(root), str(out), *words]) == 0
    text = capsys.readouterr().out
    assert f'done {DRIVES} ' in ' '.join(text.split())
    assert f'{DRIVES} units run on 2 workers' in text
    assert main(['status', str(out)]) == 0
    text = capsys.readouterr().out
    assert f'{DRIVES} done, 0 failed, 0 left' in text
    assert 'units/hour' in text


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--retry'], '--retry is for whole collections'),
        (['--slice-frames', '9'], '--slice-frames is for whole collections'),
        (['--all', '--jobs', '0'], 'expected 1 to'),
        (['--all', '--jobs', '-3'], 'expected 1 to'),
        (['--all', '--slice-frames', '0'], 'expected 1 to'),
        (['--all', '--sequence', '1'], 'give one of them'),
    ],
)
def test_options_that_do_not_go_together_are_one_line(root, out, words, complaint, capsys):
    assert main(['to-bag', str(root), str(out), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line
    assert not out.exists()


def test_an_output_may_lie_inside_the_root_but_not_inside_a_unit(root, capsys):
    assert to_bag(root, drives(root)[0] / 'bags') == 2
    assert 'lies inside' in capsys.readouterr().err
    words = ('--jobs', '1', '--topics', '/tf')
    assert to_bag(root, root / 'bags', *words) == 0
    before = times(root / 'bags')
    assert to_bag(root, root / 'bags', *words) == 0
    assert times(root / 'bags') == before
    assert len(before) == DRIVES


@pytest.mark.parametrize('content', [b'', b'no database at all', None])
def test_status_of_what_is_no_manifest_is_one_line(tmp_path, content, capsys):
    if content is not None:
        (tmp_path / MANIFEST).write_bytes(content)
    code = main(['status', str(tmp_path)])
    complained = capsys.readouterr().err
    assert code == (0 if content == b'' else 2)
    assert len(complained.splitlines()) == (content != b'')


def test_a_database_of_others_is_kept(root, out, capsys):
    out.mkdir()
    with sqlite3.connect(out / MANIFEST) as database:
        database.execute('CREATE TABLE theirs (x)')
    database.close()
    assert to_bag(root, out) == 2
    assert 'the manifest of a collection' in capsys.readouterr().err


@pytest.mark.parametrize('state', ['done', 'failed'])
def test_what_an_earlier_run_could_not_clear_is_cleared_by_the_next(root, out, state):
    if state == 'failed':
        (drives(root)[1] / 'velodyne_points' / 'timestamps.txt').write_text('no time\n')
    words = ('--jobs', '1', '--topics', '/kitti/velo/*')
    assert to_bag(root, out, *words) == (state == 'failed')
    before = times(out)
    drive = drives(root)[1]
    partial = out / drive.parent.name / f'.{drive.name}.mcap.partial'
    (partial / 'content-12345678').mkdir(parents=True)
    foreign = partial.with_name(f'.{drives(root)[2].name}.mcap.partial')
    foreign.mkdir()
    (foreign / 'notes.txt').touch()
    assert to_bag(root, out, *words) == (state == 'failed')
    assert times(out) == before
    assert not partial.exists()
    assert (foreign / 'notes.txt').exists()
