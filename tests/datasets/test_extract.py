# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives are extracted into trees that the readers open; what is there is respected."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import warnings
import zipfile
from itertools import accumulate

import pytest
from archives_of import SCAN, SUFFIXES, pack, pack_folder, tree_of
from builders import one_line
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kitti_ros2 import datasets
from kitti_ros2.cli import main
from kitti_ros2.datasets import extracting
from kitti_ros2.datasets.archive_formats import BadArchiveError, StoppedError
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import KittiRos2Error, OutputError, UsageError
from kitti_ros2.model.streams import Layout


def set_of(layout, recordings):
    """The folder whose content the archives of a layout have."""
    path = recordings[layout]
    return path.parents[1] if layout is Layout.RAW else path


@pytest.mark.parametrize(
    ('layout', 'suffix'),
    [
        *((layout, '.zip') for layout in Layout),
        *((Layout.OBJECT, suffix) for suffix in SUFFIXES[1:]),
    ],
)
def test_every_layout_and_kind_of_archive(recordings, tmp_path, layout, suffix):
    folder = set_of(layout, recordings)
    archive = pack_folder(tmp_path / f'a{suffix}', folder, 'some/top/')
    report = datasets.extract(archive, tmp_path / 'out')
    out = tmp_path / 'out'
    made = out / 'dataset' if layout is Layout.ODOMETRY else out
    assert tree_of(made) == tree_of(folder)
    assert report.losses == ()
    assert report.archives[0].written == len(tree_of(folder))
    [recording] = [open_recording(made / '2011_09_26' if layout is Layout.RAW else made)]
    assert recording.layout is layout
    again = datasets.extract([archive], tmp_path / 'out')
    assert (again.archives[0].written, again.archives[0].kept) == (0, len(tree_of(folder)))


NAMES = st.text('abcxyzABC019 ._-é', min_size=1, max_size=12).filter(lambda name: name.strip('.'))
TREES = st.dictionaries(
    st.lists(NAMES, min_size=1, max_size=3).map('/'.join), st.binary(max_size=400), min_size=1
)


@settings(max_examples=40, deadline=None)
@given(files=TREES, suffix=st.sampled_from(SUFFIXES))
def test_what_was_packed_comes_out(tmp_path_factory, files, suffix):
    folders = [part for name in files for part in accumulate(name.split('/'), '{}/{}'.format)]
    assume(len({part.casefold() for part in folders}) == len(set(folders)))
    assume(not any(other.startswith(f'{name}/') for name in files for other in files))
    assume(not any(part.startswith('._') for name in files for part in name.split('/')))
    folder = tmp_path_factory.mktemp('packed')
    wanted = {f'training/{name}': content for name, content in files.items()}
    archive = pack(folder / f'a{suffix}', {f'top/{name}': each for name, each in wanted.items()})
    assert datasets.extract(archive, folder / 'out').losses == ()
    assert tree_of(folder / 'out') == wanted


def test_several_archives_make_one_data_set(recordings, tmp_path):
    source = recordings[Layout.OBJECT]
    archives = []
    for part in ('velodyne', 'image_2', 'calib', 'label_2'):
        files = {
            str(each.relative_to(source)): each.read_bytes()
            for each in source.glob(f'training/{part}/*')
        }
        archives.append(pack(tmp_path / f'data_object_{part}.zip', files))
    report = datasets.extract(archives, tmp_path / 'out', remove_archives=True)
    assert [each.removed for each in report.archives] == [True] * 4
    assert not any(each.exists() for each in archives)
    assert open_recording(tmp_path / 'out').layout is Layout.OBJECT


@pytest.mark.parametrize('suffix', ['.zip', '.tar.gz'])
def test_files_that_differ(tmp_path, suffix):
    archive = pack(tmp_path / f'a{suffix}', {SCAN: b'new', 'training/velodyne/000007.bin': b'7'})
    target = tmp_path / 'out' / SCAN
    target.parent.mkdir(parents=True)
    for old in (b'old', b'older'):
        target.write_bytes(old)
        report = datasets.extract(archive, tmp_path / 'out', remove_archives=True)
        [loss] = report.losses
        assert loss.text() == f'{SCAN}: exists with other content; pass --overwrite to replace it'
        assert target.read_bytes() == old
        assert archive.exists()
        assert (target.parent / '000007.bin').read_bytes() == b'7'
    report = datasets.extract(archive, tmp_path / 'out', overwrite=True)
    assert (report.losses, target.read_bytes()) == ((), b'new')


def test_places_that_are_taken(tmp_path):
    out, away = tmp_path / 'out', tmp_path / 'away'
    away.mkdir()
    files = ['training/calib/1.txt', 'training/velodyne/1.bin', 'training/label_2/1.txt',
             'testing/calib/1.txt', 'testing/velodyne/1.bin', 'training/image_2/1.png']  # fmt: skip
    archive = pack(tmp_path / 'a.zip', dict.fromkeys(files, b'new'))
    (out / 'training').mkdir(parents=True)
    (out / 'testing').mkdir()
    (out / 'training' / 'calib').symlink_to(away)
    (out / 'training' / 'velodyne').write_bytes(b'a file')
    (out / 'training' / 'label_2' / '1.txt').mkdir(parents=True)
    (out / 'real').mkdir()
    (out / 'testing' / 'calib').symlink_to(out / 'real')
    (out / 'testing' / 'velodyne').mkdir()
    (out / 'testing' / 'velodyne' / '1.bin').symlink_to(away / '1.bin')
    report = datasets.extract(archive, out, overwrite=True)
    texts = [loss.text() for loss in report.losses]
    assert len(texts) == 4
    assert f'{out}/training/calib is a symbolic link that leads out of {out}' in texts[0]
    assert f'{out}/training/velodyne is a file, and a folder is needed there' in texts[1]
    assert 'its place is taken by a folder' in texts[2]
    assert 'its place is taken by a symbolic link' in texts[3]
    assert (out / 'real' / '1.txt').read_bytes() == b'new'  # a link within the root
    assert (out / 'training' / 'image_2' / '1.png').exists()
    assert list(away.iterdir()) == []


@pytest.mark.parametrize('scanner_first', [True, False])
def test_the_calibration_with_the_scanner_wins(tmp_path, scanner_first):
    place = 'dataset/sequences/03/calib.txt'
    with_it = pack(tmp_path / 'data_odometry_calib.zip', {place: b'P0: 1\nTr: 2\n'})
    without = pack(tmp_path / 'data_odometry_gray.zip', {place: b'P0: 1\n'})
    notes = []
    for each in (with_it, without) if scanner_first else (without, with_it):
        report = datasets.extract(each, tmp_path / 'out')
        assert report.losses == ()
        notes += report.notes
    assert len(notes) == scanner_first
    assert not notes or '1 existing file named calib.txt kept' in notes[0]
    assert b'Tr' in (tmp_path / 'out' / place).read_bytes()


def test_files_of_desktop_programs_are_left_out_and_counted(tmp_path):
    files = {SCAN: b'1', '__MACOSX/training/._a': b'', 'training/.DS_Store': b''}
    report = datasets.extract(pack(tmp_path / 'a.zip', files), tmp_path / 'out')
    assert tree_of(tmp_path / 'out') == {SCAN: b'1'}
    assert '2 files of desktop programs left out' in report.notes[0]


class FailingAt:
    """What is called when a file has its content; it fails at the n-th."""

    def __init__(self, number, error):
        self.left, self.error = number, error

    def __call__(self, _file):
        self.left -= 1
        if not self.left:
            raise self.error


def test_an_interrupted_run_goes_on(tmp_path, monkeypatch):
    files = {f'training/velodyne/{number:06d}.bin': bytes([number]) * 999 for number in (1, 4, 9)}
    archive = pack(tmp_path / 'a.zip', files)
    with monkeypatch.context() as patched:
        patched.setattr(extracting, 'start_writing_out', FailingAt(2, KeyboardInterrupt()))
        with pytest.raises(KeyboardInterrupt):
            datasets.extract(archive, tmp_path / 'out')
    assert list(tree_of(tmp_path / 'out')) == ['training/velodyne/000001.bin']
    report = datasets.extract(archive, tmp_path / 'out')
    assert (report.archives[0].written, report.archives[0].kept) == (2, 1)
    assert tree_of(tmp_path / 'out') == files


def test_what_a_killed_run_left_is_replaced(tmp_path):
    archive = pack(tmp_path / 'a.zip', {SCAN: b'whole'})
    left = (tmp_path / 'out' / SCAN).with_name('.000003.bin.part')
    left.parent.mkdir(parents=True)
    left.write_bytes(b'longer than the whole file')
    datasets.extract(archive, tmp_path / 'out')
    assert tree_of(tmp_path / 'out') == {SCAN: b'whole'}


def test_a_full_disk_is_one_line_and_keeps_what_is_complete(tmp_path, monkeypatch, capsys):
    archive = pack(tmp_path / 'a.zip', {SCAN: b'1', 'training/velodyne/000005.bin': b'2'})
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr(extracting, 'start_writing_out', FailingAt(2, full))
    assert main(['extract', str(archive), str(tmp_path / 'out')]) == 2
    line = one_line(capsys.readouterr().err)
    assert 'the disk is full; what is complete is kept, run it again to go on' in line
    assert tree_of(tmp_path / 'out') == {SCAN: b'1'}


def test_too_little_space_is_known_before(tmp_path, monkeypatch):
    archive = pack(tmp_path / 'a.zip', {SCAN: b'1' * 2000})
    usage = type('Usage', (), {'free': 1000})
    monkeypatch.setattr(shutil, 'disk_usage', lambda _: usage)
    with pytest.raises(OutputError, match=r'needs about 2\.0 kB, and 1\.0 kB are free'):
        datasets.extract(archive, tmp_path / 'out')
    assert tree_of(tmp_path / 'out') == {}


def test_an_unwritable_folder(tmp_path, monkeypatch):
    archive = pack(tmp_path / 'a.zip', {SCAN: b'1'})
    refused = PermissionError(errno.EACCES, 'no')
    monkeypatch.setattr(extracting, 'start_writing_out', FailingAt(1, refused))
    with pytest.raises(StoppedError, match='cannot be written'):
        datasets.extract(archive, tmp_path / 'out')


def test_another_run_is_writing(tmp_path):
    archive = pack(tmp_path / 'a.zip', {SCAN: b'1'})
    (tmp_path / 'out').mkdir()
    held = os.open(tmp_path / 'out', os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    with pytest.raises(OutputError, match='another run is writing this'):
        datasets.extract(archive, tmp_path / 'out')
    os.close(held)


def test_one_bad_archive_of_several_costs_itself_only(tmp_path, capsys):
    good = pack(tmp_path / 'good.zip', {SCAN: b'1'})
    (tmp_path / 'bad.zip').write_bytes(good.read_bytes()[:-30])
    words = [str(tmp_path / name) for name in ('bad.zip', 'good.zip', 'none.zip')]
    assert main(['extract', *words, str(tmp_path / 'out'), '--json']) == 1
    said = capsys.readouterr()
    assert 'bad.zip: is a truncated or damaged zip archive' in said.err
    assert 'none.zip: no such file or folder' in said.err
    assert len(json.loads(said.out)['losses']) == 2
    assert tree_of(tmp_path / 'out') == {SCAN: b'1'}


@pytest.mark.parametrize(
    ('words', 'line'),
    [
        ('{a}', 'ROOT is missing (the folder to extract into); usage: kitti-ros2 extract'),
        ('{a} {a}', 'ROOT is missing'),
        ('{tmp}', 'no archive; expected at least one'),
        ('{tmp} {tmp}/out', 'is a folder; give zip or tar archives, then the folder'),
        ('{tmp}/none.zip {tmp}/out', 'none.zip: no such file or folder'),
        ('{a} {tmp}/file', 'file: is a file, not a folder'),
        ('{a} {tmp}/training', 'is a part of a data set, and {a} contains whole data sets'),
        ('{a} {tmp}/2011_09_28', 'is a part of a data set, and {a} contains whole data sets'),
        ('{a} {tmp}/out --max-ratio 0', 'max_ratio 0 is not within 1 to 2000'),
        ('{a} {tmp}/out --max-size much', "--max-size takes a size such as 2GB, not 'much'"),
    ],
)
def test_mistakes(tmp_path, capsys, words, line):
    a = pack(tmp_path / 'a.zip', {SCAN: b'1'})
    (tmp_path / 'file').write_bytes(b'')
    before = sorted(tmp_path.rglob('*'))
    assert main(['extract', *words.format(a=a, tmp=tmp_path).split()]) == 2
    assert line.format(a=a) in one_line(capsys.readouterr().err)
    assert sorted(tmp_path.rglob('*')) == before


def test_the_next_command_is_printed_and_quiet_prints_nothing(recordings, tmp_path, capsys):
    archive = pack_folder(tmp_path / 'a.zip', recordings[Layout.OBJECT])
    out = tmp_path / 'my set'
    assert main(['extract', str(archive), str(out)]) == 0
    assert capsys.readouterr().out.endswith(f"next: kitti-ros2 info '{out}/training'\n")
    assert main(['extract', str(archive), str(out), '-q']) == 0
    assert capsys.readouterr() == ('', '')


def test_parts_of_one_data_set_are_one_next_command(recordings, tmp_path, capsys):
    archive = pack_folder(tmp_path / 'a.zip', recordings[Layout.KITTI_360])
    out = tmp_path / 'KITTI-360'
    assert main(['extract', str(archive), str(out)]) == 0
    said = capsys.readouterr().out
    assert [line for line in said.splitlines() if line.startswith('next')] == [
        f'next: kitti-ros2 info {out}'
    ]


def test_a_copy_of_a_member_is_kept_once(tmp_path):
    with warnings.catch_warnings(), zipfile.ZipFile(tmp_path / 'a.zip', 'w') as made:
        warnings.simplefilter('ignore')
        made.writestr(SCAN, b'1')
        made.writestr(SCAN, b'1')
    report = datasets.extract(tmp_path / 'a.zip', tmp_path / 'out')
    assert (report.archives[0].written, report.archives[0].kept) == (1, 1)


def test_errors_of_the_library(tmp_path):
    with pytest.raises(UsageError, match='unknown option'):
        datasets.extract(pack(tmp_path / 'a.zip', {SCAN: b''}), tmp_path / 'o', overwright=True)
    with pytest.raises(UsageError, match='no archive'):
        datasets.extract([], tmp_path / 'o')
    assert issubclass(BadArchiveError, KittiRos2Error)
