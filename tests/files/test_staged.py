# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A data set appears whole or not at all."""

from __future__ import annotations

import errno

import pytest

from kitti_ros2.files import local_staging
from kitti_ros2.files.local_staging import Staging, taking_over
from kitti_ros2.files.staging import staged
from kitti_ros2.model.errors import OutputError, OutputExistsError


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


@pytest.mark.parametrize('stays', [True, False])
def test_an_error_says_what_could_not_be_removed(tmp_path, monkeypatch, stays):
    def fail():
        with staged(tmp_path / 'out') as stage:
            write(stage, 'a/b.txt')
            if stays:
                monkeypatch.setattr(local_staging, '_remove', lambda _: None)
            raise OSError(errno.EIO, 'Input/output error')

    with pytest.raises(OutputError) as caught:
        fail()
    partial = tmp_path / '.out.partial'
    assert partial.exists() == stays
    assert (f'{partial} was left behind' in str(caught.value)) == stays
    assert ('nothing was left behind' in str(caught.value)) == (not stays)
    monkeypatch.undo()
    with staged(tmp_path / 'out') as stage:
        write(stage, 'a.txt')
    assert [path.name for path in tmp_path.iterdir()] == ['out']


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


def keep_nothing(path):  # noqa: ARG001 - one form for all
    return None


def test_a_second_writer_is_refused(tmp_path):
    first = Staging(tmp_path / 'out', keep_nothing)
    with pytest.raises(OutputError, match='another run is writing this'):
        Staging(tmp_path / 'out', keep_nothing)
    first.content.write_text('first')
    first.publish()
    assert (tmp_path / 'out').read_text() == 'first'


@pytest.mark.parametrize('late', ['before', 'after'])
@pytest.mark.parametrize('kind', ['file', 'folder'])
def test_a_writer_that_was_taken_over_publishes_nothing(tmp_path, late, kind):
    def write(staging, text):
        if kind == 'folder':
            staging.content.mkdir()
            (staging.content / 'file').write_text(text)
        else:
            staging.content.write_text(text)

    out = tmp_path / 'out'
    first = Staging(out, keep_nothing)
    write(first, 'first')
    with taking_over():
        second = Staging(out, keep_nothing)
    write(second, 'half')
    if late == 'after':
        second.publish()
    with pytest.raises(OutputError, match='No such file'):
        first.publish()
    first.discard()
    if late == 'before':
        second.publish()
    assert [path.name for path in tmp_path.iterdir()] == ['out']
    assert (out / 'file' if kind == 'folder' else out).read_text() == 'half'


def test_one_that_publishes_before_it_is_taken_over_is_replaced(tmp_path):
    first = Staging(tmp_path / 'out', keep_nothing)
    first.content.write_text('first')
    first.publish()
    with taking_over():
        second = Staging(tmp_path / 'out', keep_nothing)
    second.content.write_text('second')
    second.publish()
    assert (tmp_path / 'out').read_text() == 'second'
    assert [path.name for path in tmp_path.iterdir()] == ['out']
