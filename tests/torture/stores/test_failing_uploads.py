# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Uploads of which any request fails, once or from then on, has no answer, or meets a kill."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip('s3fs', reason='s3:// needs s3fs')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')
import fsspec.config
from remote.s3_server import AT_ONCE, Fault
from test_uploads import (
    ALWAYS,
    FILES,
    LARGE,
    below,
    replace,
    store,
    write_file,
    write_folder,
)

from kitti_ros2.files.remote import as_path, refuse_incomplete
from kitti_ros2.model.errors import BadFileError, OutputError

from s3_buckets import forget_clients  # isort: skip
from waiting import PATIENCE_S  # isort: skip

__all__ = ['store']  # a fixture


@pytest.fixture(params=[write_file, write_folder], ids=['file', 'folder'])
def write(request):
    return request.param


def requests_of(write, store):
    """Return how many requests a run makes that nothing disturbs."""
    write(f'{store.url}/sound/out')
    return sum(store.server.counts().values())


@pytest.mark.parametrize('fault', AT_ONCE, ids=lambda fault: fault.name.lower())
def test_any_request_may_fail_once(fault, write, store):
    for nth in range(1, requests_of(write, store) + 1):
        store.server.clear()
        store.server.fail(fault, nth)
        write(f'{store.url}/{nth}/out')
        assert store.server.failures() == 1
    found = store.objects()
    sound = {key: data for key, data in found.items() if key.startswith('sound/')}
    for name in range(1, nth + 1):
        for key, data in sound.items():
            assert found.pop(key.replace('sound', str(name))) == data, f'request {name}'
    assert found == sound
    assert store.unfinished() == []


@pytest.mark.parametrize('fault', [Fault.ERROR, Fault.LOST], ids=['error', 'lost'])
def test_a_store_that_fails_from_a_request_on_leaves_nothing_that_looks_whole(fault, write, store):
    for nth in range(1, requests_of(write, store) + 1):
        store.server.clear()
        store.server.fail(fault, nth, ALWAYS)
        with pytest.raises(OutputError) as caught:
            write(f'{store.url}/{nth}/out')
        assert f'{store.url}/{nth}/' in str(caught.value)
        assert '\n' not in str(caught.value)
        store.server.clear()
        found = {key for key in store.objects() if key.startswith(f'{nth}/')}
        if write is write_file:
            assert found <= {f'{nth}/out'}
            assert store.objects().get(f'{nth}/out', LARGE) == LARGE
        elif found and f'{nth}/.out.partial' not in found:
            # The answer to the very last request, that removes the marker, was lost.
            assert found == {f'{nth}/out/{name}' for name in FILES}
        if f'{nth}/.out.partial' in found:
            with pytest.raises(BadFileError, match='its upload was not completed'):
                refuse_incomplete(as_path(f'{store.url}/{nth}/out/a/1.png'))
        write(f'{store.url}/{nth}/out', refusal=replace if write is write_file else keep_complete)
        refuse_incomplete(as_path(f'{store.url}/{nth}/out'))
        got = {key: data for key, data in store.objects().items() if key.startswith(f'{nth}/')}
        whole = {f'{nth}/out': LARGE} if write is write_file else below(f'{nth}/out')
        assert got == whole


def keep_complete(path):
    """Let an output be replaced that is complete though the run that wrote it did not know."""
    return None if path.scheme == 's3' else 'local'


@pytest.mark.parametrize('kind', ['put', 'part', 'complete'])
def test_a_request_without_an_answer_is_made_again(kind, store, monkeypatch):
    monkeypatch.setitem(fsspec.config.conf, 's3', {'config_kwargs': {'read_timeout': 5}})
    forget_clients()
    store.server.fail(Fault.STALL, kinds={kind})
    write_folder(f'{store.url}/out')
    assert store.server.failures() == 1
    assert store.objects() == below('out')


_PROGRAM = """
import sys
from pathlib import Path
from kitti_ros2.files.remote import as_path
from kitti_ros2.files.staging import staged
from kitti_ros2.files import uploads

uploads.PART = 32 << 10
with staged(as_path(sys.argv[1])) as folder:
    for each in sorted(Path(sys.argv[2]).iterdir()):
        (folder / each.name).write_bytes(each.read_bytes())
"""


@pytest.mark.parametrize('kind', ['create', 'part', 'complete', 'delete'])
def test_a_run_that_is_killed_in_the_middle_is_done_again(kind, store, tmp_path):
    source = tmp_path / 'source'
    source.mkdir()
    files = {'a': b'1', 'b.mcap': LARGE, 'metadata.yaml': b'bag'}
    for name, data in files.items():
        (source / name).write_bytes(data)
    command = [sys.executable, '-c', _PROGRAM, f'{store.url}/out', str(source)]
    store.server.fail(Fault.STALL, kinds={kind})
    with subprocess.Popen(command) as process:
        assert store.server.stalled.wait(PATIENCE_S)
        process.kill()
    store.server.clear()
    assert '.out.partial' in store.objects()
    with pytest.raises(BadFileError, match='its upload was not completed'):
        refuse_incomplete(as_path(f'{store.url}/out'))
    subprocess.run(command, check=True, timeout=300)
    assert store.objects() == below('out', files)
