# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command and the function: by name from a mirror to data sets that can be opened."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import stat
import sys
from itertools import count

import pytest
from archives_of import pack, pack_folder, tree_of
from builders import one_line
from http_mirror import Mirror, serving

from kitti_ros2 import datasets
from kitti_ros2.cli import main
from kitti_ros2.datasets import downloading, extracting, transfer
from kitti_ros2.datasets.catalogue import (
    CATEGORIES,
    ENTRIES,
    KITTI_URL,
    RawKinds,
    raw_drives,
    select,
)
from kitti_ros2.datasets.download_sources import make_source
from kitti_ros2.datasets.extracting import locked_folder
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import OutputError, UsageError
from kitti_ros2.model.streams import Layout

DRIVE = '2011_09_26_drive_0048'
SYNC = f'/raw_data/{DRIVE}/{DRIVE}_sync.zip'
TRACKLETS = f'/raw_data/{DRIVE}/{DRIVE}_tracklets.zip'
CALIB = '/raw_data/2011_09_26_calib.zip'


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """A home without accepted terms, no proxies, and waits of nothing."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    for name in ('HTTP_PROXY', 'HTTPS_PROXY', 'ALL_PROXY'):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)
    monkeypatch.setattr(transfer, '_FIRST_WAIT_S', 0.0)


@pytest.fixture(scope='session')
def archives(recordings, tmp_path_factory):
    """KITTI's archives by path, of the synthetic recording."""
    folder = tmp_path_factory.mktemp('archives')
    source = recordings[Layout.RAW]
    files = {str(each.relative_to(source)): each.read_bytes()
             for each in source.rglob('*') if each.is_file()}  # fmt: skip
    labels = files.pop('tracklet_labels.xml')
    top = f'2011_09_26/{DRIVE}_sync'
    calib = {f'2011_09_26/{each.name}': each.read_bytes() for each in source.parent.glob('*.txt')}
    scans = {f'{top}/{name}': content for name, content in files.items()}
    made = {
        SYNC: pack(folder / 'a.zip', scans),
        TRACKLETS: pack(folder / 'b.zip', {f'{top}/tracklet_labels.xml': labels}),
        CALIB: pack(folder / 'c.zip', calib),
        '/data_object_label_2.zip': pack_folder(folder / 'd.zip', recordings[Layout.OBJECT]),
    }  # fmt: skip
    return {path: archive.read_bytes() for path, archive in made.items()}


@pytest.fixture
def mirror(archives):
    pytest.importorskip('httpx')
    with serving(Mirror(dict(archives))) as served:
        yield served


def run(*words, code=0):
    assert main(['download', *map(str, words)]) == code


def test_a_drive_becomes_a_recording(recordings, mirror, tmp_path, capsys):
    out = tmp_path / 'kitti'
    run('raw', DRIVE, out, '--base-url', mirror.url, '--accept-license')
    said = capsys.readouterr().out
    assert '3 archives downloaded; ' in said
    assert f'next: kitti-ros2 info {out}/raw/2011_09_26' in said
    drive = out / 'raw' / '2011_09_26' / f'{DRIVE}_sync'
    assert tree_of(drive) == tree_of(recordings[Layout.RAW])
    assert open_recording(drive).calibration(0).missing == {}
    assert [each.name for each in (out / 'archives').iterdir()] == ['extracted.json']
    mirror.requests.clear()
    run('raw', DRIVE, out, '--base-url', mirror.url)  # the terms are remembered
    assert '0 archives downloaded, 3 there before' in capsys.readouterr().out
    assert mirror.requests == []
    (drive / 'oxts' / 'dataformat.txt').unlink()
    shutil.rmtree(drive)
    run('raw', f'{DRIVE}_sync', out, '--base-url', mirror.url)
    assert {path for path, *_ in mirror.requests} == {SYNC}


def test_archives_alone_are_kept_and_used_later(mirror, tmp_path):
    out = tmp_path / 'kitti'
    words = ['raw', DRIVE, out, '--base-url', mirror.url, '--accept-license', '-q']
    run(*words, '--archives-only')
    names = {path.rpartition('/')[2] for path in (SYNC, TRACKLETS, CALIB)}
    assert {each.name for each in (out / 'archives').iterdir()} == names
    mirror.requests.clear()
    run(*words, '--keep-archives')
    assert mirror.requests == []
    assert {each.name for each in (out / 'archives').iterdir()} == names | {'extracted.json'}
    assert (out / 'raw' / '2011_09_26' / f'{DRIVE}_sync' / 'tracklet_labels.xml').is_file()


def test_a_mirror_of_one_folder(archives, tmp_path):
    folder = tmp_path / 'a mirror'
    folder.mkdir()
    for path, content in archives.items():
        (folder / path.rpartition('/')[2]).write_bytes(content)
    report = datasets.download(
        f'raw {DRIVE} object label_2', tmp_path / 'out',
        base_url=folder.as_uri(), accept_license=True,
    )  # fmt: skip
    assert len(report.downloaded) == 4
    assert report.folders == (tmp_path / 'out' / 'raw', tmp_path / 'out' / 'object')
    assert report.losses == ()


def test_an_archive_that_is_missing_costs_itself_only(mirror, tmp_path, capsys):
    del mirror.files[TRACKLETS]
    out = tmp_path / 'kitti'
    run('raw', DRIVE, out, '--base-url', mirror.url, '--accept-license', '--json', code=1)
    said = capsys.readouterr()
    assert f'{DRIVE}_tracklets.zip: the server replies 404' in said.err
    assert 'exit code 1' in said.err
    report = json.loads(said.out)
    assert len(report['downloaded']) == 2
    assert len(report['losses']) == 1
    assert (out / 'raw' / '2011_09_26' / f'{DRIVE}_sync' / 'oxts').is_dir()


def test_the_only_archive_that_is_missing(mirror, tmp_path, capsys):
    del mirror.files[CALIB]
    run('raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '--accept-license',
        code=2)  # fmt: skip
    assert 'the server replies 404' in one_line(capsys.readouterr().err)
    assert not (tmp_path / 'o').exists()


def test_breaks_in_all_transfers(recordings, mirror, tmp_path):
    mirror.break_after = 100_000
    datasets.download(['raw', DRIVE], tmp_path, base_url=mirror.url, accept_license=True, jobs=3)
    drive = tmp_path / 'raw' / '2011_09_26' / f'{DRIVE}_sync'
    assert tree_of(drive) == tree_of(recordings[Layout.RAW])


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'<html>log in', 'is a web page'),
        (b'PK\x03\x04 half', 'is a truncated or damaged zip archive'),
    ],
)
def test_what_is_no_archive_is_removed(mirror, tmp_path, capsys, content, reason):
    mirror.files[CALIB] = content
    run('raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '--accept-license',
        code=2)  # fmt: skip
    line = one_line(capsys.readouterr().err)
    assert reason in line
    assert 'as the server has it; it was removed' in line
    assert not (tmp_path / 'o').exists()


def test_a_server_that_declares_too_little(mirror, tmp_path, capsys):
    content = mirror.files[CALIB]
    mirror.fault = lambda made: made.reply(200, {'Content-Length': '100'}, content) or True
    run('raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '--accept-license',
        code=2)  # fmt: skip
    assert 'is a truncated or damaged zip archive' in one_line(capsys.readouterr().err)


def test_hostile_archives_of_a_mirror_are_refused(mirror, tmp_path, capsys):
    hostile = pack(tmp_path / 'x.zip', {'../../2011_09_26/calib_cam_to_cam.txt': b''})
    mirror.files[CALIB] = hostile.read_bytes()
    run('raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '--accept-license',
        code=2)  # fmt: skip
    assert 'leads out of the folder' in one_line(capsys.readouterr().err)
    assert not list(tmp_path.rglob('calib_cam_to_cam.txt'))


def test_checksums_of_a_file(mirror, tmp_path, capsys):
    sums, out = tmp_path / 'SHA256SUMS', tmp_path / 'o'
    right = hashlib.sha256(mirror.files[CALIB]).hexdigest()
    words = ['raw', '2011_09_26_calib', out, '--base-url', mirror.url, '--accept-license',
             '--checksums', sums]  # fmt: skip
    sums.write_text(f'# made by hand\n\n{"0" * 64} *raw_data/2011_09_26_calib.zip\n')
    run(*words, code=2)
    assert 'has another SHA-256' in one_line(capsys.readouterr().err)
    run(*words, '--no-verify', '-q')
    shutil.rmtree(out)
    sums.write_text(f'{right.upper()}  2011_09_26_calib.zip\n')
    run(*words, '-q')
    sums.write_text('no sum\n')
    run(*words, code=2)
    assert f'{sums}:1: no checksum; expected 64 hexadecimal' in one_line(capsys.readouterr().err)
    sums.unlink()
    run(*words, code=2)
    assert 'no such file or folder' in one_line(capsys.readouterr().err)


def test_the_terms_are_asked_for_once(mirror, tmp_path, capsys):
    words = ['raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '-q']
    run(*words, code=2)
    line = one_line(capsys.readouterr().err)
    assert 'CC BY-NC-SA 3.0' in line
    assert 'pass --accept-license' in line
    assert mirror.requests == []
    run(*words, '--accept-license')
    run(*words)
    assert 'CC BY-NC-SA 3.0' in next((tmp_path / 'config').rglob('*.txt')).read_text()


def test_a_full_disk_is_one_line_and_can_be_continued(mirror, tmp_path, monkeypatch, capsys):
    def full(_self, _size):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    words = ['raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url,
             '--accept-license', '-q']  # fmt: skip
    with monkeypatch.context() as patched:
        patched.setattr(transfer.WritingOut, 'advance', full)
        run(*words, code=2)
    line = one_line(capsys.readouterr().err)
    assert 'the disk is full; what is complete is kept, run it again to go on' in line
    run(*words)
    assert (tmp_path / 'o' / 'raw' / '2011_09_26' / 'calib_cam_to_cam.txt').is_file()


def test_what_a_killed_run_left_of_a_complete_archive_is_removed(mirror, tmp_path):
    archives = tmp_path / 'o' / 'archives'
    words = ['raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url,
             '--accept-license', '-q']  # fmt: skip
    run(*words, '--archives-only')
    (archives / '2011_09_26_calib.zip.part.json').write_text('{}')
    run(*words, '--archives-only')
    assert [each.name for each in archives.iterdir()] == ['2011_09_26_calib.zip']


@pytest.mark.parametrize('fsync', [True, False])
def test_no_file_is_synced_where_nobody_minds(mirror, tmp_path, monkeypatch, fsync):
    synced = []

    def sync(file):
        synced.append(stat.S_ISREG(os.fstat(file).st_mode))

    monkeypatch.setattr(os, 'fsync', sync)
    run('raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url, '--accept-license',
        '-q', '--fsync' if fsync else '--no-fsync')  # fmt: skip
    assert any(synced) == fsync
    assert (tmp_path / 'o' / 'archives' / 'extracted.json').exists()


def test_errors_after_a_download_say_what_is_kept(mirror, tmp_path, monkeypatch, capsys):
    words = ['raw', '2011_09_26_calib', tmp_path / 'o', '--base-url', mirror.url,
             '--accept-license', '-q']  # fmt: skip

    def refuse(*_, **__):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr(downloading, 'replace_file', refuse)
        run(*words, code=2)
    line = one_line(capsys.readouterr().err)
    assert 'extracted.json: cannot be written (Input/output error); what is complete is' in line
    (tmp_path / 'o' / 'archives' / 'extracted.json').unlink(missing_ok=True)
    with monkeypatch.context() as patched:
        patched.setattr(extracting, 'lock_exclusively', _refuse_after_the_first())
        run(*words, code=2)
    line = one_line(capsys.readouterr().err)
    assert 'what was downloaded is kept' in line
    assert 'nothing was left' not in line


def _refuse_after_the_first():
    """Lock the folder of archives, and not that of what is extracted."""
    calls = count()

    def lock(_folder, path):
        if next(calls):
            raise OutputError(path, 'cannot be locked', 'write elsewhere')

    return lock


def test_too_little_space_is_known_before(tmp_path, monkeypatch):
    usage = type('Usage', (), {'free': 5_000})
    monkeypatch.setattr(shutil, 'disk_usage', lambda _: usage)
    for name in (f'{DRIVE}_sync.zip', f'{DRIVE}_tracklets.zip', '2011_09_26_calib.zip'):
        (tmp_path / name).write_bytes(bytes(1000))
    options = {'base_url': tmp_path.as_uri(), 'accept_license': True}
    for jobs, needed in ((3, 7.2), (1, 5.2)):  # an archive is removed before the next is fetched
        with pytest.raises(OutputError, match=f'needs about {needed} kB, and 5.0 kB are free'):
            datasets.download(f'raw {DRIVE}', tmp_path / 'o', jobs=jobs, **options)
    assert not (tmp_path / 'o').exists()


def test_sizes_are_asked_for(mirror):
    source = make_source(mirror.url, 5.0)
    assert source.size(mirror.url + SYNC) == len(mirror.files[SYNC])
    assert source.size(mirror.url + '/none.zip') is None
    source.close()


def test_an_interrupt_leaves_parts_that_are_continued(mirror, tmp_path, monkeypatch):
    def interrupt(*_args, **_options):
        raise KeyboardInterrupt

    options = {'base_url': mirror.url, 'accept_license': True}
    with monkeypatch.context() as patched:
        patched.setattr(downloading, 'extract_all', interrupt)
        with pytest.raises(KeyboardInterrupt):
            datasets.download(f'raw {DRIVE}', tmp_path / 'o', **options)
    assert not (tmp_path / 'o' / 'raw').exists()
    assert datasets.download(f'raw {DRIVE}', tmp_path / 'o', **options).losses == ()


def test_another_run_is_downloading(tmp_path):
    busy = pytest.raises(OutputError, match='another run is writing this')
    with locked_folder(tmp_path / 'archives'), busy:
        datasets.download('object calib', tmp_path, base_url='file:///', accept_license=True)


@pytest.mark.parametrize(
    ('words', 'line'),
    [
        ('', 'WHAT is missing (such as raw 2011_09_26_drive_0005, or object calib)'),
        ('raw 2011_09_26_drive_0005', 'ROOT is missing (the folder to download into)'),
        ('object calib', 'ROOT is missing'),
        ('object calib,label_2 {tmp}/o', 'there is no object calib,label_2'),
        ('objekt {tmp}/o', 'there is no objekt; did you mean object?'),
        ('object {tmp}/o', 'object: give parts of it: image_2, image_3, velodyne, calib, label_2'),
        ('raw {tmp}/o', 'raw: give parts of it: 2011_09_26_drive_0005, 2011_09_26, '),
        ('object label_02 {tmp}/o', 'there is no object label_02; did you mean label_2?'),
        ('raw 2011_09_26_drive_0003 {tmp}/o', 'there is no raw 2011_09_26_drive_0003'),
        ('raw 2011_09_26_drive_0003..0004 {tmp}/o', 'there is no drive between these'),
        ('raw all {tmp}/o --category town', 'category takes city, residential, road, campus'),
        ('raw 2011_10_03 {tmp}/o --category campus', 'none of these drives is of category campus'),
        ('{tmp}/o', 'nothing is selected; give raw, object, tracking or odometry with parts'),
        ('object calib {tmp}/o --base-url ftp://x --accept-license', 'an unsupported scheme'),
        ('object calib {tmp}/file --accept-license', 'is a file; give the folder'),
        ('object calib {tmp}/o --jobs 0', 'jobs 0 is not within 1 to 16'),
        ('object calib {tmp}/o --timeout 0s', 'timeout 0 is not within 0.1 to 3600'),
        ('--list calib', '--list takes raw object tracking odometry, not calib'),
    ],
)
def test_mistakes(tmp_path, capsys, monkeypatch, words, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_bytes(b'')
    run(*words.format(tmp=tmp_path).split(), code=2)
    assert line in one_line(capsys.readouterr().err)
    assert not (tmp_path / 'o').exists()


def test_httpx_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'httpx', None)
    with pytest.raises(UsageError, match='downloading needs httpx: pip install httpx'):
        datasets.download('object calib', tmp_path, accept_license=True)


# Names and the catalogue.


def names_of(words, *, kinds=(), categories=()):
    return [each.name for each in select(words.split(), RawKinds(kinds, categories))]


def test_selections():
    sync, tracklets = f'{DRIVE}_sync.zip', f'{DRIVE}_tracklets.zip'
    calib = '2011_09_26_calib.zip'
    assert names_of(f'raw {DRIVE}') == [calib, sync, tracklets]
    assert names_of(DRIVE) == [calib, sync, tracklets]
    assert names_of(f'raw {DRIVE}', kinds=('extract',)) == [calib, f'{DRIVE}_extract.zip']
    assert names_of(f'raw {DRIVE}_extract') == [calib, f'{DRIVE}_extract.zip']
    assert names_of(f'{sync} {sync}') == [sync]
    assert names_of('raw 2011_09_28_drive_0016') == [
        '2011_09_28_calib.zip', '2011_09_28_drive_0016_sync.zip'
    ]  # fmt: skip
    found = names_of('raw 2011_09_26_drive_0001..0009', kinds=('sync',))
    assert [name[17:21] for name in found[1:]] == ['0001', '0002', '0005', '0009']
    same = names_of('raw 2011_09_26_drive_0001..2011_09_26_drive_0009', kinds=('sync',))
    assert same == found
    assert len(names_of('raw', categories=('campus',))) == 11
    assert len(names_of('raw all', categories=('city', 'road'), kinds=('sync',))) == 45
    assert len(names_of('raw 2011_10_03')) == 6
    assert names_of('object calib tracking label_2 odometry labels poses') == [
        'data_object_calib.zip', 'data_tracking_label_2.zip', 'data_odometry_labels.zip',
        'data_odometry_poses.zip',
    ]  # fmt: skip
    assert names_of('data_object_calib.zip 2011_09_26_calib') == ['data_object_calib.zip', calib]
    assert len(names_of('tracking all')) == 7


def test_urls():
    [labels] = select(['odometry', 'labels'], RawKinds())
    assert labels.urls(KITTI_URL) == (
        'http://www.semantic-kitti.org/assets/data_odometry_labels.zip',
    )
    assert labels.urls('http://m') == ('http://m/data_odometry_labels.zip',)
    _, sync, _ = select(['raw', DRIVE], RawKinds())
    assert sync.urls(KITTI_URL) == (f'{KITTI_URL}{SYNC}',)
    assert sync.urls('http://m') == (f'http://m{SYNC}', f'http://m/{DRIVE}_sync.zip')


def test_the_catalogue_is_consistent(real_kitti):
    drives = raw_drives()
    assert len(drives) == 156
    assert list(drives) == sorted(drives)
    assert {each.category for each in drives.values()} == set(CATEGORIES)
    assert len({each.name for each in ENTRIES}) == len(ENTRIES)
    frames = [each for each in drives.values() if each.frames]
    assert all(3.6e6 < each.sync_bytes / each.frames < 4.6e6 for each in frames)
    mapping = real_kitti / 'devkit' / 'object' / 'mapping' / 'train_mapping.txt'
    for line in mapping.read_text().splitlines():
        date, drive, number = line.split()
        known = drives.get(drive.rpartition('_')[0])
        if known is not None and known.frames:
            assert known.date == date
            assert int(number) < known.frames


def test_the_list(capsys):
    run('--list')
    said = capsys.readouterr().out
    assert 'object     calib     16 MB   data_object_calib.zip' in said
    assert '2011_09_26_drive_0048  city         22      83.7 MB   yes' in said
    assert '2011_09_28_drive_0053  person       -       295.3 MB  -' in said
    assert max(map(len, said.splitlines())) <= 80
    run('--list', 'raw', '--category', 'road', '--json')
    found = json.loads(capsys.readouterr().out)
    assert len(found['drives']) == 12
    assert [each['part'] for each in found['archives']] == ['devkit']
