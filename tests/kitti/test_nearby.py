# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Paths that are no recordings: what is near them, and that the search is limited."""

from __future__ import annotations

import os
import tarfile
from pathlib import Path
from zipfile import ZipFile

import pytest

from kitti_ros2.cli import main
from kitti_ros2.kitti import opening
from kitti_ros2.kitti.archives import Archive
from kitti_ros2.kitti.opening import data_sets_below, explain, open_recording
from kitti_ros2.model.errors import NotKittiError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ReadOptions

INSIDE = {
    Layout.RAW: ('velodyne_points', 'velodyne_points/data', 'image_02/data', 'oxts', 'oxts/data',
                 'image_02/data/0000000003.png', 'velodyne_points/data/0000000000.bin',
                 'oxts/data/0000000001.txt', 'tracklet_labels.xml'),
    Layout.OBJECT: ('training/image_2', 'training/velodyne', 'training/label_2', 'training/calib',
                    'ImageSets', 'training/image_2/000003.png', 'training/velodyne/000000.bin',
                    'training/label_2/000001.txt', 'ImageSets/train.txt'),
    Layout.ODOMETRY: ('sequences/00/velodyne', 'sequences/00/image_2', 'poses', 'poses/00.txt',
                      'sequences/00/velodyne/000002.bin', 'sequences/00/calib.txt'),
    Layout.TRACKING: ('training/velodyne', 'training/velodyne/0000', 'training/image_02/0000',
                      'training/label_02', 'training/oxts', 'training/label_02/0000.txt',
                      'training/image_02/0000/000004.png'),
}  # fmt: skip
"""Folders and files inside a data set, relative to what is to be given."""


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b'')


def drive(number: int) -> str:
    return f'2011_09_26/2011_09_26_drive_{number:04d}_sync/velodyne_points/data/0000000000.bin'


@pytest.mark.parametrize(
    ('layout', 'part'), [(layout, part) for layout, parts in INSIDE.items() for part in parts]
)
def test_inside_a_data_set_the_remedy_can_be_opened(recordings, layout, part):
    path = recordings[layout] / part
    with pytest.raises(NotKittiError) as raised:
        open_recording(path)
    [remedy] = raised.value.remedies
    assert str(raised.value).startswith(f'{path}: is a {"folder" if path.is_dir() else "file"} of ')
    assert f'KITTI {layout.value} data set; give {remedy.source}' in str(raised.value)
    assert open_recording(remedy.source).layout is layout
    assert recordings[layout] in (remedy.source, *remedy.source.parents)
    assert remedy.frame == (
        int(path.stem) if len(path.stem) >= 6 and path.stem.isdecimal() else None
    )


def test_the_sequence_is_known_from_the_path(tmp_path):
    for name in ('0000', '0003'):
        put(tmp_path, f'training/velodyne/{name}/000000.bin', f'training/label_02/{name}.txt')
    for part in ('velodyne/0003', 'velodyne/0003/000000.bin', 'label_02/0003.txt'):
        [remedy] = explain(tmp_path / 'training' / part).remedies
        assert remedy.options == ('--sequence', '0003')
        options = ReadOptions(sequence=remedy.options[1])
        assert open_recording(remedy.source, options).name == '0003'
    [remedy] = explain(tmp_path / 'training' / 'label_02').remedies
    assert remedy.options == ()


def test_a_relative_path_gets_a_relative_remedy(recordings, monkeypatch):
    monkeypatch.chdir(recordings[Layout.OBJECT] / 'training' / 'image_2')
    assert explain(Path()).remedies[0].source == Path('..')
    assert explain(Path('000001.png')).remedies[0].source == Path('..')
    assert explain(Path('../velodyne')).remedies[0].source == Path('..')
    monkeypatch.chdir(recordings[Layout.OBJECT])
    assert explain(Path('training/image_2')).remedies[0].source == Path('training')


def test_a_folder_that_others_add_is_inside(tmp_path):
    put(tmp_path, 'training/velodyne/000000.bin', 'training/velodyne_reduced/000000.bin')
    [remedy] = explain(tmp_path / 'training' / 'velodyne_reduced').remedies
    assert remedy.source == tmp_path / 'training'


@pytest.mark.parametrize('name', ['notes', 'notes/a.txt', 'photo.gif'])
def test_beside_a_data_set_is_not_inside(tmp_path, name):
    put(tmp_path, 'training/velodyne/000000.bin', name if '.' in name else f'{name}/x')
    assert not explain(tmp_path / name).remedies


def test_the_folder_above_lists_what_is_below(recordings, tmp_path):
    for layout, path in recordings.items():
        (tmp_path / 'data' / layout.value).parent.mkdir(exist_ok=True)
        (tmp_path / 'data' / layout.value).symlink_to(path)
    error = explain(tmp_path)
    data = tmp_path / 'data'
    assert f'holds 5 data sets, {data}/kitti360 (kitti360), {data}/object (object)' in str(error)
    assert '2 more; give one of these folders' in str(error)
    assert [each.source for each in error.remedies] == [data / 'kitti360']
    assert {each.layout for each in data_sets_below(tmp_path)[0]} == set(Layout)


def test_info_names_the_data_sets_below_another(recordings, tmp_path, capsys):
    drive = recordings[Layout.RAW]
    (tmp_path / drive.parent.name).symlink_to(drive.parent)
    (tmp_path / 'sets' / 'object').parent.mkdir()
    (tmp_path / 'sets' / 'object').symlink_to(recordings[Layout.OBJECT])
    main(['info', str(tmp_path)])
    text = f'holds 1 other data set, {tmp_path}/sets/object (object); give one to show it'
    assert text in capsys.readouterr().out
    main(['info', str(tmp_path), '--layout', 'raw'])
    assert 'other data set' not in capsys.readouterr().out


def test_the_recordings_below_are_counted(tmp_path):
    put(tmp_path, *(f'a/raw/{drive(number)}' for number in range(3)))
    assert 'a/raw (raw, 3 drives); give' in str(explain(tmp_path))


def test_links_in_a_circle_and_unreadable_folders_end_the_search(tmp_path):
    put(tmp_path, f'a/{drive(1)}')
    (tmp_path / 'b').mkdir()
    (tmp_path / 'b' / 'back').symlink_to(tmp_path)
    locked = tmp_path / 'locked'
    locked.mkdir(mode=0)
    found, complete = data_sets_below(tmp_path)
    assert [each.folder for each in found] == [tmp_path / 'a']
    assert complete
    locked.chmod(0o700)


def test_the_search_is_limited(tmp_path, monkeypatch):
    put(tmp_path, *(f'{letter}/x/x/x/x/x' for letter in 'abcdefgh'), f'z/{drive(1)}')
    read = []
    scandir = os.scandir

    def counted(path):
        read.append(path)
        return scandir(path)

    monkeypatch.setattr(opening, '_MOST_FOLDERS', 5)
    monkeypatch.setattr(opening.os, 'scandir', counted)
    found, complete = data_sets_below(tmp_path)
    assert not found
    assert not complete
    assert len(set(read)) <= 5
    assert 'holds a, b, c, d and 5 more (5 folders below it were searched)' in str(
        explain(tmp_path)
    )
    monkeypatch.setattr(opening, '_MOST_FOLDERS', 300)
    assert data_sets_below(tmp_path)[1]
    assert not any(Path(each).match('x/x/x/x/x') for each in read)
    monkeypatch.setattr(opening, '_MOST_ENTRIES', 2)
    assert not data_sets_below(tmp_path)[0]
    assert ', ...; expected a KITTI folder' in str(explain(tmp_path))


def test_a_misspelt_path(tmp_path):
    put(tmp_path, f'kitti/raw/{drive(1)}')
    for wrong in ('kiti', 'kiti/raw', 'kitti/rwa', 'kitti/raw/2011_09_62'):
        error = explain(tmp_path / wrong)
        assert 'no such file or folder; did you mean' in str(error)
        assert error.remedies[0].source.is_dir()
    assert str(explain(tmp_path / 'kitti' / 'nothing')).endswith('give a KITTI folder or a bag')
    # The rest of the path must be there, too.
    assert not explain(tmp_path / 'kiti' / 'object').remedies


# Archives.


def archive(folder: Path, name: str, *entries: str) -> Path:
    source = folder / 'source'
    put(source, *entries)
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    if name.endswith('.zip'):
        with ZipFile(path, 'w') as made:
            for entry in entries:
                made.write(source / entry, entry)
    else:
        mode = 'w:gz' if name.endswith('gz') else 'w:xz' if name.endswith('xz') else 'w'
        with tarfile.open(path, mode) as made:
            for entry in entries:
                made.add(source / entry, entry)
    return path


RAW, TRAIN, TEST = drive(5), 'training/velodyne/000000.bin', 'testing/velodyne/000000.bin'


@pytest.mark.parametrize(
    ('name', 'entries', 'command', 'folder'),
    [
        ('d/a.zip', [RAW], 'd/a.zip d', 'd/2011_09_26'),
        ('a.zip', [RAW], 'a.zip .', '2011_09_26'),
        ('a.zip', [f'my/top/{RAW}'], 'a.zip .', '2011_09_26'),
        ('d/a.tar', [RAW], 'd/a.tar d', 'd/2011_09_26'),
        ('a.tar.gz', [RAW], 'a.tar.gz .', '2011_09_26'),
        ('a.tgz', [RAW], 'a.tgz .', '2011_09_26'),
        ('a.tar.xz', [RAW], 'a.tar.xz .', '2011_09_26'),
        ('d/a.zip', [TRAIN], 'd/a.zip d', 'd/training'),
        ('d/a.zip', [TRAIN, 'README'], 'd/a.zip d', 'd/training'),
        ('d/a.zip', [TRAIN, TEST], 'd/a.zip d', 'd'),
        ('d/a.zip', ['sequences/00/calib.txt'], 'd/a.zip d', 'd/dataset'),
        ('d/a b.zip', ['x/label_2/1.txt'], "'d/a b.zip' 'd/a b'", 'd/a b'),
    ],
)
def test_archives_are_extracted_beside_themselves(
    tmp_path, monkeypatch, name, entries, command, folder
):
    archive(tmp_path, name, *entries)
    monkeypatch.chdir(tmp_path)
    error = explain(Path(name))
    [remedy] = error.remedies
    assert (remedy.before, remedy.source) == (f'kitti-ros2 extract {command}', Path(folder))
    assert f'{name}: is an archive; extract it, then give the folder {folder}' in str(error)


@pytest.mark.parametrize('entries', [['x.bin'], ['x/1.bin', 'y/1.bin'], []])
def test_an_archive_of_something_else(tmp_path, entries):
    error = explain(archive(tmp_path, 'a.zip', *entries))
    assert "is an archive without KITTI's folders; expected a KITTI folder" in str(error)
    assert not error.remedies


@pytest.mark.parametrize('name', ['a.zip', 'a.tar.gz', 'a.tgz', 'a.tar', 'a.tar.xz'])
@pytest.mark.parametrize('content', [b'', b'PK\x03\x04 cut', b'\x1f\x8b cut'])
def test_a_damaged_archive(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    error = explain(tmp_path / name)
    assert 'damaged or incomplete; download it again' in str(error)
    assert not error.remedies


def test_names_in_an_archive_do_not_lead_out_of_it(tmp_path):
    path = tmp_path / 'a.zip'
    with ZipFile(path, 'w') as made:
        made.writestr('../../etc/x', '')
        made.writestr('../training/x', '')
    assert Archive.open(path) == (tmp_path, None)


def test_a_folder_of_archives(tmp_path):
    for name in ('a.zip', 'b.zip', 'c.zip', 'd.zip'):
        archive(tmp_path, name, RAW)
    (tmp_path / 'source').rename(tmp_path / '.source')
    error = explain(tmp_path)
    assert 'holds 4 archives, a.zip, b.zip, c.zip and 1 more; extract them' in str(error)
    [remedy] = error.remedies
    listed = ' '.join(f'{tmp_path}/{name}.zip' for name in 'abcd')
    assert remedy.before == f'kitti-ros2 extract {listed} {tmp_path}'
    assert remedy.source == tmp_path / '2011_09_26'


def test_a_pipe_named_like_an_archive_is_not_read(tmp_path):
    os.mkfifo(tmp_path / 'a.zip')
    assert 'is a file' in str(explain(tmp_path / 'a.zip'))
