# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A data set appears whole or not at all, and an object set can be continued."""

from __future__ import annotations

import pytest

from kitti_ros2.errors import OutputExistsError, UsageError
from kitti_ros2.importer.output import next_number, staged


def write(stage, *names):
    for name in names:
        path = stage / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{name}\n')


def tree(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob('*.*'))


def test_nothing_is_seen_before_it_is_whole(tmp_path):
    out = tmp_path / 'out'
    with staged(out) as stage:
        write(stage, 'a/b.txt')
        assert not out.exists()
    assert tree(tmp_path) == ['out/a/b.txt']


def test_what_fails_leaves_nothing(tmp_path):
    def fail():
        with staged(tmp_path / 'deep/out') as stage:
            write(stage, 'a/b.txt')
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_something_is_refused_and_an_empty_one_taken(tmp_path):
    out = tmp_path / 'out'
    out.mkdir()
    with staged(out) as stage:
        write(stage, 'a.txt')
    with pytest.raises(OutputExistsError), staged(out):
        pass
    assert tree(tmp_path) == ['out/a.txt']


def test_a_file_is_refused(tmp_path):
    (tmp_path / 'out').write_text('kept')
    for append in (False, True):
        with pytest.raises(OutputExistsError), staged(tmp_path / 'out', append=append):
            pass
    assert (tmp_path / 'out').read_text() == 'kept'


def test_frames_are_appended_and_the_lists_continued(tmp_path):
    out = tmp_path / 'out'
    write(out, 'training/velodyne/000000.bin', 'training/velodyne/000001.bin')
    (out / 'ImageSets').mkdir()
    (out / 'ImageSets/train.txt').write_text('000000\n000001')
    assert next_number(out, 'training') == 2
    with staged(out, append=True) as stage:
        write(stage, 'training/velodyne/000002.bin')
        (stage / 'ImageSets').mkdir()
        (stage / 'ImageSets/train.txt').write_text('000002\n')
        (stage / 'ImageSets/val.txt').write_text('')
    assert (out / 'ImageSets/train.txt').read_text() == '000000\n000001\n000002\n'
    assert next_number(out, 'training') == 3
    assert [path.name for path in tmp_path.iterdir()] == ['out']


def test_a_frame_is_never_replaced(tmp_path):
    out = tmp_path / 'out'
    write(out, 'training/velodyne/000000.bin')

    def clash():
        with staged(out, append=True) as stage:
            (stage / 'training/velodyne').mkdir(parents=True)
            (stage / 'training/velodyne/000000.bin').write_text('new')

    with pytest.raises(OutputExistsError):
        clash()
    assert (out / 'training/velodyne/000000.bin').read_text() == 'training/velodyne/000000.bin\n'


def test_appending_to_nothing_begins_at_0(tmp_path):
    assert next_number(tmp_path / 'none', 'training') == 0
    with staged(tmp_path / 'out', append=True) as stage:
        write(stage, 'a.txt')
    assert tree(tmp_path) == ['out/a.txt']


def test_what_is_no_object_set_is_not_appended_to(tmp_path):
    write(tmp_path / 'out', 'holiday/beach.txt')
    with pytest.raises(UsageError, match='no object set'):
        next_number(tmp_path / 'out', 'training')
