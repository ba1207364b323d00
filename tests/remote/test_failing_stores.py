# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stores that fail: tried again, and else one line that says what and where."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('fsspec', reason='URLs need fsspec')

from builders import convert_recording
from counted_store import PROTOCOL, CountedStore, Fails, Stalls, put

from kitti_ros2.cli import main
from kitti_ros2.files import remote_requests
from kitti_ros2.files.remote import RemotePath, as_path
from kitti_ros2.files.remote_reads import MOST_BYTES, FilesAhead, listing_of
from kitti_ros2.kitti.store import STORE
from kitti_ros2.model.errors import RemoteError
from kitti_ros2.model.streams import Layout

from waiting import PATIENCE_S  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

SLOW_DOWN = OSError(errno.EBUSY, 'Please reduce your request rate')


@pytest.fixture(autouse=True)
def waits(monkeypatch) -> list[float]:
    """The pauses between tries, which are not made."""
    found: list[float] = []
    monkeypatch.setattr(remote_requests, 'wait', found.append)
    return found


@pytest.fixture
def drive_url(recordings: Mapping[Layout, Path]) -> RemotePath:
    path = recordings[Layout.RAW]
    return put(path.parent) / path.name


def one_line(capsys) -> str:
    error = capsys.readouterr().err
    assert error.count('\n') == 1, error
    return error


def files_of(tmp_path: Path, count: int, size: int) -> RemotePath:
    folder = tmp_path / 'data'
    folder.mkdir()
    for number in range(count):
        (folder / f'{number:010d}.bin').write_bytes(bytes([number % 256]) * size)
    return put(folder)


@pytest.mark.parametrize(
    'error',
    [SLOW_DOWN, TimeoutError(), ConnectionResetError(), OSError(errno.EIO, 'Internal error')],
    ids=['503', 'time-out', 'reset', '500'],
)
def test_what_fails_for_a_moment_is_tried_again(
    error, drive_url: RemotePath, tmp_path: Path, waits
):
    # One file, so that both failures are of one request: files are read side by side.
    fault = CountedStore.faults['image_02/data/0000000002.png'] = Fails(error, 2)
    report = convert_recording(drive_url, tmp_path / 'a.mcap')
    assert not report.losses
    assert fault.met == 2
    first, second = waits
    assert 0.1 <= first < 0.3  # 0.2 s, spread by a half
    assert 0.2 <= second < 0.6


def test_cut_answers_are_read_again(drive_url: RemotePath, tmp_path: Path):
    CountedStore.short['0000000003.bin'] = 2
    assert not convert_recording(drive_url, tmp_path / 'a.mcap').losses


@pytest.mark.parametrize('part', ['0000000003.bin', 'oxts'])
def test_a_store_that_keeps_failing_ends_the_run(
    part: str, drive_url: RemotePath, tmp_path: Path, capsys
):
    CountedStore.faults[part] = Fails(SLOW_DOWN, 1000)
    out = tmp_path / 'a.mcap'
    assert main(['to-bag', '-q', str(drive_url), str(out)]) == 2
    error = one_line(capsys)
    assert part in error
    assert f'{PROTOCOL}://' in error
    assert 'reduce your request rate, 5 times' in error
    assert not list(tmp_path.iterdir())


def test_answers_that_stay_cut_end_the_run(drive_url: RemotePath, tmp_path: Path, capsys):
    CountedStore.short['0000000003.bin'] = 1000
    assert main(['to-bag', '-q', str(drive_url), str(tmp_path / 'a.mcap')]) == 2
    assert 'bytes came, 5 times' in one_line(capsys)


def test_a_missing_and_a_forbidden_file_are_counted(drive_url: RemotePath, tmp_path: Path):
    CountedStore.faults['velodyne_points/data/0000000001.bin'] = Fails(FileNotFoundError(), 9)
    CountedStore.faults['image_02/data/0000000001.png'] = Fails(PermissionError('Forbidden'), 9)
    report = convert_recording(drive_url, tmp_path / 'a.mcap')
    texts = ' '.join(map(str, report.losses))
    assert 'access denied (Forbidden)' in texts
    assert 'no such file' in texts


def test_listings_that_fail(drive_url: RemotePath, capsys):
    CountedStore.faults[drive_url.name] = Fails(PermissionError('AccessDenied'), 99, ('ls', 'info'))
    assert main(['info', str(drive_url)]) == 2
    error = one_line(capsys)
    assert str(drive_url) in error
    assert 'access denied' in error


@pytest.mark.parametrize(
    ('url', 'said'),
    [
        (f'{PROTOCOL}://nothing/here', 'no such file or folder'),
        ('nosuch://bucket/key', 'unknown scheme nosuch://'),
        ('s3://me:secret@bucket/key', 'passwords in URLs are not accepted'),
        ('zip://a.bin::s3://bucket/key', 'chained URLs are not supported'),
        ('file://elsewhere/a', 'names no file of this machine'),
    ],
)
def test_mistakes_are_one_line(url: str, said: str, capsys):
    assert main(['info', url]) == 2
    error = one_line(capsys)
    assert said in error
    assert 'secret' not in error


def test_a_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(__import__('sys').modules, 'fsspec.core', None)
    assert main(['info', 's3://another-bucket/key']) == 2
    assert "pip install 'kitti_ros2[remote]'" in one_line(capsys)


def test_local_folders_named_like_schemes(tmp_path: Path, monkeypatch, recordings):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 's3:').mkdir()
    (tmp_path / 's3:' / 'drive').symlink_to(recordings[Layout.OBJECT])
    assert main(['info', './s3:/drive']) == 0
    assert main(['info', f'file://{recordings[Layout.OBJECT]}']) == 0
    assert as_path('s3:/drive').is_dir()


def test_files_are_read_ahead_within_bounds(tmp_path: Path):
    url = files_of(tmp_path, 40, MOST_BYTES // 16)
    listing_of(url)
    ahead = FilesAhead()
    stall = CountedStore.faults['0000000030'] = Stalls()
    paths = [url / name for name in listing_of(url)]
    for number, path in enumerate(paths[:30]):
        assert ahead.read(path)[:1] == bytes([number])
        assert ahead._size <= MOST_BYTES
    assert stall.begun.wait(PATIENCE_S)  # nobody asked for it yet
    stall.go_on.set()
    assert [ahead.read(path)[0] for path in paths[30:]] == [*range(30, 40)]
    assert CountedStore.requests['cat'] == 40
    assert ahead._size == 0


def test_leaps_are_not_read_ahead(tmp_path: Path):
    url = files_of(tmp_path, 100, 10)
    paths = [url / name for name in listing_of(url)]
    ahead = FilesAhead()
    for place in (0, 50, 7, 90, 20):
        ahead.read(paths[place])
    assert CountedStore.requests['cat'] == 5
    for place in range(0, 100, 10):
        ahead.read(paths[place])
    assert {int(key[-14:-4]) % 10 for key, _ in CountedStore.read[6:]} == {0}


def test_an_error_of_a_file_read_ahead_is_its_own(tmp_path: Path):
    url = files_of(tmp_path, 20, 10)
    CountedStore.faults['0000000009'] = Fails(SLOW_DOWN, 1000)
    paths = [url / name for name in listing_of(url)]
    for path in paths[:9]:
        STORE.read(path)
    with pytest.raises(RemoteError, match=r'0000000009\.bin: .* 5 times'):
        STORE.read(paths[9])
    assert STORE.read(paths[10])[0] == 10
