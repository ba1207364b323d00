# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""RemotePath is a path whose text is its URL; nothing becomes a local path in silence."""

from __future__ import annotations

import os
import pickle
from pathlib import Path, PurePath

import pytest

pytest.importorskip('fsspec', reason='URLs need fsspec')

from counted_store import PROTOCOL, CountedStore, put

from kitti_ros2.files.remote import RemotePath, as_path, canonical_path, common_folder
from kitti_ros2.files.remote_reads import forget
from kitti_ros2.files.remote_requests import key_of
from kitti_ros2.files.url_path import LocalPathError
from kitti_ros2.model.errors import UsageError

KEY = as_path('s3://bucket/folder/name.tar.gz')


def test_names():
    assert isinstance(KEY, RemotePath)
    assert str(KEY) == KEY.as_posix() == 's3://bucket/folder/name.tar.gz'
    assert (KEY.name, KEY.stem, KEY.suffix) == ('name.tar.gz', 'name.tar', '.gz')
    assert KEY.suffixes == ['.tar', '.gz']
    assert str(KEY.parent) == 's3://bucket/folder'
    assert [str(each) for each in KEY.parents] == ['s3://bucket/folder', 's3://bucket', 's3://']
    assert KEY.parents[2].parent == KEY.parents[2]
    assert KEY.parts == ('s3://', 'bucket', 'folder', 'name.tar.gz')
    assert str(KEY / 'a/b' / 'c') == 's3://bucket/folder/name.tar.gz/a/b/c'
    assert str(KEY.parent.joinpath('x', Path('y'))) == 's3://bucket/folder/x/y'
    assert str(KEY.with_name('x')) == 's3://bucket/folder/x'
    assert str(KEY.with_suffix('.xz')) == 's3://bucket/folder/name.tar.xz'
    assert str(KEY.with_stem('x')) == 's3://bucket/folder/x.gz'
    assert str(as_path('S3://bucket/a/../b/').resolve()) == 's3://bucket/b'
    assert KEY.is_absolute()
    assert KEY.absolute() is KEY.expanduser() is KEY
    assert KEY.match('*.gz')


def test_relations():
    assert KEY.relative_to(KEY.parent) == Path('name.tar.gz')
    assert KEY.relative_to('s3://bucket') == Path('folder/name.tar.gz')
    assert KEY.is_relative_to(KEY.parent)
    assert not KEY.is_relative_to('/bucket')
    for other in ('gs://bucket', Path('/'), KEY / 'x'):
        with pytest.raises(ValueError, match='is not in the subpath'):
            KEY.relative_to(other)
    assert Path('/local') / KEY == KEY
    assert common_folder([KEY, KEY.parent / 'x' / 'y']) == KEY.parent
    assert common_folder([Path('/a/b'), Path('/a/c')]) == Path('/a')
    assert canonical_path(KEY) == str(KEY)


def test_values():
    same = as_path(str(KEY))
    assert same == KEY
    assert hash(same) == hash(KEY)
    assert Path('/bucket/folder/name.tar.gz') != KEY
    assert Path('/') != KEY
    assert pickle.loads(pickle.dumps(KEY)) == KEY
    assert sorted([KEY, KEY.parent]) == [KEY.parent, KEY]


@pytest.mark.parametrize(
    'use',
    [
        lambda: Path(KEY),
        lambda: str(PurePath(KEY, 'x')),
        lambda: os.path.exists(KEY),  # noqa: PTH110 - as local functions ask
        lambda: Path('/a').joinpath(KEY),
        lambda: os.fspath(KEY),
        KEY.mkdir,
        lambda: KEY.write_bytes(b''),
    ],
)
def test_local_functions_fail_aloud(use):
    with pytest.raises(LocalPathError, match='a URL is not possible here') as caught:
        use()
    assert isinstance(caught.value, UsageError)


def test_texts():
    assert as_path('file:///a%20b/c') == Path('/a b/c')
    assert as_path('file://localhost/a') == Path('/a')
    assert type(as_path('s3:/a')) is type(as_path('./s3://a')) is type(Path())
    assert as_path(Path('x')) == Path('x')
    signed = as_path('https://host/x.mcap?signature=a/b')
    assert str(signed) == 'https://host/x.mcap'
    assert signed == pickle.loads(pickle.dumps(signed)) != as_path('https://host/x.mcap')
    assert '?' not in str(signed.parent)
    assert str(as_path('s3://bucket/odd?name')) == 's3://bucket/odd?name'
    for bad in ('s3://a:b@host/x', 'zip://a::s3://x', 'simplecache::s3://x', 'file://host/a'):
        with pytest.raises(UsageError):
            as_path(bad)


def test_asking_the_store(tmp_path: Path):
    (tmp_path / 'set' / 'inner').mkdir(parents=True)
    (tmp_path / 'set' / 'inner' / 'a.txt').write_bytes(b'abc')
    (tmp_path / 'set' / 'b.txt').write_bytes('ä\r\n'.encode())
    url = put(tmp_path / 'set')
    assert url.is_dir()
    assert not url.is_file()
    assert [each.name for each in url.iterdir()] == ['b.txt', 'inner']
    assert (url / 'inner' / 'a.txt').stat().st_size == 3
    assert not (url / 'inner' / 'x' / 'y').exists()
    assert not (url / 'b.txt' / 'x').exists()
    assert CountedStore.requests == {'ls': 2}
    assert (url / 'b.txt').read_text('utf-8') == 'ä\n'
    assert (url / 'b.txt').read_bytes() == 'ä\r\n'.encode()
    with (url / 'inner' / 'a.txt').open('rb') as file:
        file.seek(1)
        assert file.read() == b'bc'
    CountedStore().pipe_file(key_of(url / 'new'), b'')
    assert not (url / 'new').exists()
    forget(url / 'new')
    assert (url / 'new').is_file()
    assert not as_path(f'{PROTOCOL}://nothing').exists()


def test_signatures_are_sent():
    pytest.importorskip('aiohttp', reason='http:// needs aiohttp')
    assert key_of(as_path('https://host/x.mcap?a=b/c')) == 'https://host/x.mcap?a=b/c'
