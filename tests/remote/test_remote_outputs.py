# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-bag and to-kitti write the same bytes to a URL as to a local path."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip('s3fs', reason='s3:// needs s3fs')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')
from remote.s3_server import Fault

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout


def files_in(path):
    """Return the files at and below a path by name; its own name is empty."""
    if path.is_file():
        return {'': path.read_bytes()}
    return {
        each.relative_to(path).as_posix(): each.read_bytes()
        for each in path.rglob('*')
        if each.is_file()
    }


def objects_in(bucket, name):
    return {
        key[len(name) :].lstrip('/'): data
        for key, data in bucket.objects().items()
        if key == name or key.startswith(f'{name}/')
    }


OUTPUTS = {
    'mcap file': ('out.mcap', ()),
    'mcap folder': ('out', ()),
    'sqlite3': ('out', ('--storage', 'sqlite3')),
    'ros1': ('out.bag', ()),
    'split': ('out', ('--split-size', '1MB')),
}


@pytest.mark.parametrize('kind', OUTPUTS)
def test_bags_of_all_containers(kind, recordings, s3, tmp_path):
    name, options = OUTPUTS[kind]
    source = str(recordings[Layout.RAW])
    (tmp_path / 'local').mkdir()
    local = tmp_path / 'local' / name
    assert main(['to-bag', source, str(local), '-q', *options]) == 0
    assert main(['to-bag', source, f'{s3.url}/to/{name}', '-q', *options]) == 0
    assert objects_in(s3, f'to/{name}') == files_in(local)
    assert set(s3.objects()) == {f'to/{name}/{each}'.rstrip('/') for each in files_in(local)}


def test_bags_and_folders_of_all_layouts(recording_path, s3, tmp_path):
    bag, out = tmp_path / 'a.mcap', tmp_path / 'out'
    assert main(['to-bag', str(recording_path), str(bag), '-q']) == 0
    assert main(['to-bag', str(recording_path), f'{s3.url}/a.mcap', '-q']) == 0
    assert objects_in(s3, 'a.mcap') == files_in(bag)
    assert main(['to-kitti', str(bag), str(out), '-q']) == 0
    assert main(['to-kitti', str(bag), f'{s3.url}/out', '-q']) == 0
    assert objects_in(s3, 'out') == files_in(out)


def test_an_output_is_replaced_only_when_asked(recordings, s3, tmp_path, capsys):
    source, bag, out = str(recordings[Layout.RAW]), tmp_path / 'a.mcap', f'{s3.url}/out'
    for each in (str(bag), out):
        assert main(['to-bag', source, each, '-q']) == 0
    before = objects_in(s3, 'out')
    assert main(['to-bag', source, out, '-q']) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert f'{out}: exists already' in line
    assert main(['to-bag', source, out, '-q', '--overwrite', '--exclude-topics', '*image*']) == 0
    assert objects_in(s3, 'out').keys() == before.keys()
    assert objects_in(s3, 'out') != before
    assert main(['to-kitti', str(bag), out, '-q', '--overwrite']) != 0  # it is a bag
    assert main(['to-kitti', str(bag), f'{out}-kitti', '-q']) == 0
    s3.put('out-kitti/2011_09_26/calib_old.txt', b'old')
    assert main(['to-kitti', str(bag), f'{out}-kitti', '-q', '--overwrite']) == 0
    assert 'out-kitti/2011_09_26/calib_old.txt' not in s3.objects()
    s3.put('out-kitti/photo.jpg', b'theirs')
    assert main(['to-kitti', str(bag), f'{out}-kitti', '-q', '--overwrite']) != 0


def test_append_to_a_url_is_refused_in_one_line(recordings, s3, tmp_path, capsys):
    bag = tmp_path / 'a.mcap'
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(bag), '-q']) == 0
    assert (
        main(['to-kitti', str(bag), f'{s3.url}/out', '-q', '--append', '--layout', 'object']) != 0
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert '--append' in line
    assert s3.objects() == {}


@pytest.mark.parametrize('name', ['out', 'out.mcap'])
def test_a_store_that_fails_is_one_line(name, recordings, impatient, capsys, monkeypatch):
    s3 = impatient
    monkeypatch.setattr('kitti_ros2.files.remote_requests.TRIES', 1)
    s3.put('bucket-is-known', b'')
    first = 2 if name == 'out' else 1
    s3.server.fail(Fault.ERROR, first, 10**9, kinds={'put', 'create', 'part'})
    code = main(['to-bag', str(recordings[Layout.RAW]), f'{s3.url}/{name}', '-q'])
    assert code not in {0, 1}
    (line,) = capsys.readouterr().err.splitlines()
    s3.server.clear()
    if name == 'out':
        assert '.out.partial marks it' in line
        for command in (['info'], ['to-kitti']):
            extra = ['elsewhere'] if command == ['to-kitti'] else []
            assert main([*command, f'{s3.url}/out', *extra]) not in {0, 1}
            assert 'its upload was not completed' in capsys.readouterr().err
        assert main(['to-bag', str(recordings[Layout.RAW]), f'{s3.url}/out', '-q']) == 0
        assert '.out.partial' not in s3.objects()
    else:
        assert 'nothing was left behind' in line
        assert s3.objects().keys() == {'bucket-is-known'}


@pytest.mark.parametrize('name', ['out', 'out.mcap'])
def test_a_copy_that_stays_here_is_named_too(name, recordings, impatient, capsys, monkeypatch):
    s3 = impatient
    monkeypatch.setattr('kitti_ros2.files.remote_requests.TRIES', 1)
    monkeypatch.setattr('kitti_ros2.files.local_staging._remove', lambda _: None)
    s3.put('bucket-is-known', b'')
    first = 2 if name == 'out' else 1
    s3.server.fail(Fault.ERROR, first, 10**9, kinds={'put', 'create', 'part'})
    assert main(['to-bag', str(recordings[Layout.RAW]), f'{s3.url}/{name}', '-q']) not in {0, 1}
    (line,) = capsys.readouterr().err.splitlines()
    assert 'nothing was left behind' not in line
    assert f'.{name}.partial was left behind' in line
    assert ('marks it' in line) == (name == 'out')


def test_a_local_path_loads_nothing_of_stores(tmp_path):
    program = 'import sys; import kitti_ros2.bags.writer; print("fsspec" in sys.modules)'
    result = subprocess.run(
        [sys.executable, '-c', program], check=True, capture_output=True, text=True, cwd=tmp_path
    )
    assert result.stdout.strip() == 'False'
