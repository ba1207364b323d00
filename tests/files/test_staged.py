# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A data set appears whole or not at all."""

from __future__ import annotations

import pytest

from kitti_ros2.files.staging import staged
from kitti_ros2.model.errors import OutputExistsError


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
    with pytest.raises(OutputExistsError), staged(tmp_path / 'out'):
        pass
    assert (tmp_path / 'out').read_text() == 'kept'
