# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs in a store are whole, absent or marked, whichever request fails."""

from __future__ import annotations

import hashlib

import pytest

pytest.importorskip('s3fs', reason='s3:// needs s3fs')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')
from remote.s3_server import Fault

from kitti_ros2.files import remote_requests, uploads
from kitti_ros2.files.remote import as_path, marker_of
from kitti_ros2.files.staging import staged, staged_file
from kitti_ros2.model.errors import KittiRos2Error, OutputError, OutputExistsError

PART = 32 << 10
LARGE = b''.join(hashlib.sha256(b'%d' % at).digest() for at in range(PART // 32 + 100))
FILES = {
    'metadata.yaml': b'bag',
    'b/large.mcap': LARGE,
    **{f'a/{number}.png': b'%d' % number for number in range(2)},
}
ALWAYS = 10**9


def keep(_path):
    return 'it is kept'


def replace(_path):
    return None


@pytest.fixture
def store(impatient, monkeypatch):
    """The bucket, in small parts."""
    monkeypatch.setattr('moto.s3.models.S3_UPLOAD_PART_MIN_SIZE', PART)
    monkeypatch.setattr(uploads, 'PART', PART)
    return impatient


def write_file(url, data=LARGE, refusal=keep):
    with staged_file(as_path(url), refusal) as path:
        path.write_bytes(data)


def write_folder(url, files=FILES, refusal=keep):
    with staged(as_path(url), refusal) as folder:
        for name, data in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(data)


def below(prefix, files=FILES):
    return {f'{prefix}/{name}': data for name, data in files.items()}


def test_a_file_becomes_one_object_of_several_parts(store):
    write_file(f'{store.url}/to/bag.mcap')
    assert store.objects() == {'to/bag.mcap': LARGE}
    counts = store.server.counts()
    assert counts['part'] == 2
    assert (counts['create'], counts['complete'], counts['abort']) == (1, 1, 0)


@pytest.mark.parametrize('size', [0, 1, PART, PART + 1])
def test_sizes_around_a_part(size, store):
    write_file(f'{store.url}/bag.mcap', LARGE[:size])
    assert store.objects() == {'bag.mcap': LARGE[:size]}


def test_a_folder_becomes_objects_under_a_marker(store):
    write_folder(f'{store.url}/to/out')
    assert store.objects() == below('to/out')
    written = [
        each.path.removeprefix(f'/{store.name}/')
        for each in store.server.requests
        if each.kind in {'put', 'complete', 'delete'}
    ]
    assert written[0] == 'to/.out.partial'
    assert written[-2:] == ['to/out/metadata.yaml', 'to/.out.partial']


def test_nothing_is_left_in_the_temporary_folder(store, tmp_path, monkeypatch):
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    write_folder(f'{store.url}/out')
    with pytest.raises(ZeroDivisionError), staged(as_path(f'{store.url}/other')):
        raise ZeroDivisionError
    assert [path for path in tmp_path.rglob('*') if path.is_file()] == []
    assert store.objects() == below('out')


def test_an_output_that_exists_is_kept(store):
    store.put('file', b'theirs')
    store.put('folder/file', b'theirs')
    before = store.objects()
    for name in ('file', 'folder'):
        with pytest.raises(OutputExistsError, match=f'{name}: exists already; it is kept'):
            write_file(f'{store.url}/{name}')
        with pytest.raises(OutputExistsError, match=f'{name}: exists already; it is kept'):
            write_folder(f'{store.url}/{name}')
    assert store.objects() == before


def test_names_that_begin_alike_are_not_the_output(store):
    store.put('out2/file', b'theirs')
    store.put('out.mcap', b'theirs')
    write_folder(f'{store.url}/out')
    assert store.objects() == {
        **below('out'), 'out2/file': b'theirs', 'out.mcap': b'theirs',
    }  # fmt: skip


def test_an_output_that_is_replaced_keeps_no_old_object(store):
    write_folder(f'{store.url}/out')
    files = {'a/1.png': b'new', 'c': b'new'}
    write_folder(f'{store.url}/out', files, replace)
    assert store.objects() == below('out', files)
    write_file(f'{store.url}/out', b'file', replace)
    assert store.objects() == {'out': b'file'}
    write_folder(f'{store.url}/out', files, replace)
    assert store.objects() == below('out', files)


def test_a_bucket_and_a_url_of_a_web_server_are_no_outputs(store):
    for url in (store.url, 'https://127.0.0.1/out'):
        with pytest.raises(OutputError):
            write_file(url)


def test_a_bucket_that_is_absent_is_one_line(store):  # noqa: ARG001 - for its environment
    with pytest.raises(OutputError) as caught:
        write_file('s3://no-such-bucket/out')
    assert 's3://no-such-bucket/out' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_an_upload_that_was_not_completed_is_replaced_without_being_asked(store):
    store.server.fail(Fault.ERROR, 3, ALWAYS, kinds={'put'})
    with pytest.raises(OutputError, match='the next run with this output replaces it'):
        write_folder(f'{store.url}/out')
    store.server.clear()
    assert '.out.partial' in store.objects()
    files = {'other': b'1'}
    write_folder(f'{store.url}/out', files)
    assert store.objects() == below('out', files)


def test_an_upload_that_fails_is_aborted(store):
    store.server.fail(Fault.ERROR, 2, ALWAYS, kinds={'part'})
    with pytest.raises(OutputError):
        write_file(f'{store.url}/out.mcap')
    assert store.objects() == {}
    assert store.unfinished() == []


def test_two_runs_with_one_output_are_noticed(store, monkeypatch):
    """The other run begins and ends while this one sends."""
    done = []
    whole = uploads.send

    def send(these):
        these = list(these)
        if not done:
            done.append(True)
            monkeypatch.setattr('tempfile.tempdir', None)
            store.put('.out.partial', b'another run')
            store.put('out/theirs', b'theirs')
        return whole(these)

    monkeypatch.setattr('kitti_ros2.files.uploads.send', send)
    with pytest.raises(KittiRos2Error, match='another run is writing it'):
        write_folder(f'{store.url}/out')
    assert '.out.partial' in store.objects()


def test_an_object_that_differs_is_sent_again(store, monkeypatch):
    done = []
    whole = uploads.send

    def send(these):
        sent = list(whole(these))
        if not done:
            done.append(True)
            store.put('out/a/1.png', b'?')
        return iter(sent)

    monkeypatch.setattr('kitti_ros2.files.uploads.send', send)
    write_folder(f'{store.url}/out')
    assert store.objects() == below('out')


def test_marker_has_a_name_beside_the_output(store):
    assert str(marker_of(as_path(f'{store.url}/a/out'))) == f'{store.url}/a/.out.partial'


def test_a_store_in_memory():
    pytest.importorskip('fsspec')
    path = as_path('memory://kitti_ros2_uploads/out')
    write_folder(path)
    system = remote_requests.filesystem_of(path)
    found = {name.partition('/out/')[2]: system.cat_file(name) for name in system.find('')}
    assert {name: data for name, data in found.items() if name} == FILES
    system.rm('kitti_ros2_uploads', recursive=True)
