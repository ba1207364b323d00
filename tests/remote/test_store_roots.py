# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Collections whose roots, globs and lists are URLs."""

from __future__ import annotations

import json
import shutil

import pytest

pytest.importorskip('fsspec', reason='URLs need fsspec')

from counted_store import CountedStore, put

from kitti_ros2.batch.collection import fingerprint
from kitti_ros2.batch.jobs import Job, find_roots
from kitti_ros2.cli import main
from kitti_ros2.files.remote import as_path
from kitti_ros2.files.remote_reads import RemoteEntry, forget, listing_of
from kitti_ros2.model.streams import Layout

from builders import files_of  # isort: skip

MANIFEST = 'manifest.sqlite'


@pytest.fixture
def drives(recordings, tmp_path):
    """Two dates with a drive each, and three drives in all."""
    drive = recordings[Layout.RAW]
    root = tmp_path / 'raw'
    shutil.copytree(drive.parent, root / drive.parent.name)
    shutil.copytree(drive, root / drive.parent.name / drive.name.replace('0001', '0007'))
    other = root / '2011_09_27'
    shutil.copytree(drive, other / drive.name.replace('09_26', '09_27'))
    for path in drive.parent.glob('calib_*.txt'):
        shutil.copy(path, other)
    return root


@pytest.fixture
def url(drives):
    return put(drives)


def outputs(out):
    return {name: data for name, data in files_of(out).items() if name != MANIFEST}


def run(capsys, *words):
    """Run a command with --all; return its summary."""
    code = main([*map(str, words), '--all', '--json', '--jobs', '1'])
    out, err = capsys.readouterr()
    assert (code, err) == (0, '')
    return json.loads(out)


WAYS = {
    'root': lambda root: root,
    'glob': lambda root: f'{root}/2011_09_26/*_sync',
    'glob of dates': lambda root: f'{root}/2011_*/2011_*0001_sync',
    'all levels': lambda root: f'{root}/**/*_000[17]_sync',
}


@pytest.mark.parametrize('way', WAYS)
def test_bags_of_a_root_and_of_globs(way, drives, url, tmp_path, capsys):
    local = run(capsys, 'to-bag', WAYS[way](drives), tmp_path / 'local')
    remote = run(capsys, 'to-bag', WAYS[way](url), tmp_path / 'remote')
    assert outputs(tmp_path / 'remote') == outputs(tmp_path / 'local')
    names = [each['name'] for each in remote['units']]
    assert names == [each['name'] for each in local['units']]
    assert len(names) == {'root': 3, 'glob': 2}.get(way, len(names))
    assert {each['source'] for each in remote['units']} <= {
        str(each) for each in find_roots(as_path(f'{url}/*/*_sync'))
    }


def test_data_sets_of_the_bags_of_a_root(drives, tmp_path, capsys):
    assert main(['to-bag', str(drives), str(tmp_path / 'bags'), '--all', '-q']) == 0
    (tmp_path / 'bags' / MANIFEST).unlink()
    bags = put(tmp_path / 'bags')
    run(capsys, 'to-kitti', tmp_path / 'bags', tmp_path / 'local')
    assert run(capsys, 'to-kitti', bags, tmp_path / 'remote')['ran'] == 3
    assert outputs(tmp_path / 'remote') == outputs(tmp_path / 'local')


def test_lists_here_and_in_the_store(drives, url, tmp_path, capsys):
    names = [each.relative_to(drives).as_posix() for each in sorted(drives.glob('*/*_sync'))[:2]]
    here = tmp_path / 'list.txt'
    here.write_text('# drives\n' + ''.join(f'{url}/{name}\n' for name in names))
    (drives / 'list.txt').write_text('\n'.join(names))
    there = put(drives) / 'list.txt'
    for number, each in enumerate((here, there)):
        summary = run(capsys, 'to-bag', each, tmp_path / f'out{number}')
        assert summary['ran'] == 2
    assert outputs(tmp_path / 'out0') == outputs(tmp_path / 'out1')


def test_what_is_done_is_skipped_until_the_store_changes(drives, url, tmp_path, capsys):
    out = tmp_path / 'out'
    assert run(capsys, 'to-bag', url, out)['ran'] == 3
    CountedStore.reset()
    forget(url)
    assert run(capsys, 'to-bag', url, out)['ran'] == 0
    folders = {'.', *(str(each.relative_to(drives)) for each in drives.rglob('*') if each.is_dir())}
    assert CountedStore.requests['ls'] <= len(folders) + 1
    assert CountedStore.requests['cat'] == 0
    changed = url / '2011_09_27/2011_09_27_drive_0001_sync/oxts/timestamps.txt'
    store = CountedStore()
    store.pipe_file(store._strip_protocol(str(changed)), changed.read_bytes() + b'\n')
    forget(url)
    assert run(capsys, 'to-bag', url, out)['ran'] == 1


def test_an_etag_is_a_part_of_the_fingerprint(url, monkeypatch):
    folder = url / '2011_09_26'
    job = Job('a', folder)
    before = fingerprint(job)
    (name,) = [each for each in listing_of(folder) if each.startswith('calib_velo')]
    entry = listing_of(folder)[name]
    monkeypatch.setitem(listing_of(folder), name, entry._replace(tag='"1"'))
    assert fingerprint(job) != before
    assert entry == RemoteEntry(is_folder=False, size=entry.size, changed_ns=entry.changed_ns)


@pytest.mark.parametrize(
    ('other', 'said'),
    [
        ('{url}/nothing/*_sync', 'matches; quote the pattern'),
        ('{url}/nothing', 'no such file or folder'),
        ('{list}', 'run one command for each store'),
    ],
)
def test_mistakes_are_one_line_of_text(other, said, drives, url, tmp_path, capsys):
    listed = tmp_path / 'list.txt'
    listed.write_text(f'{url}\n{drives}\n')
    source = other.format(url=url, list=listed)
    assert main(['to-bag', source, str(tmp_path / 'out'), '--all']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (tmp_path / 'out').exists()


def test_other_commands(drives, url, tmp_path, capsys):
    for command in (['validate'], ['stats'], ['report']):
        out = tmp_path / command[0]
        code = main([*command, str(url), '--all', '-o', str(out), '--jobs', '1', '-q'])
        assert (command, code, capsys.readouterr().err) == (command, 0, '')
        local = tmp_path / f'{command[0]}-local'
        assert main([*command, str(drives), '--all', '-o', str(local), '--jobs', '1', '-q']) == 0
        assert outputs(out).keys() == outputs(local).keys()


def test_an_output_inside_a_unit_is_refused(s3, drives, capsys):
    for path in drives.rglob('*'):
        if path.is_file():
            s3.put(f'raw/{path.relative_to(drives)}', path.read_bytes())
    inside = f'{s3.url}/raw/2011_09_26/2011_09_26_drive_0001_sync/out'
    assert main(['to-bag', f'{s3.url}/raw', inside, '--all']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'lies inside the recording' in line
    between = f'{s3.url}/raw/out'
    assert main(['to-bag', f'{s3.url}/raw', between, '--all', '-q', '--jobs', '1']) == 0
    assert main(['to-bag', f'{s3.url}/raw', between, '--all', '-q', '--jobs', '2']) == 0
    assert sum(key.endswith('.mcap') for key in s3.objects()) == 3
