# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files placed by hard links or copies, and folders that are walked."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import pytest

from kitti_ros2.files.local_files import FileLinker, walk_files
from kitti_ros2.model.errors import BadFileError, UnreadableFileError


@pytest.fixture
def source(tmp_path):
    path = tmp_path / 'source'
    path.write_bytes(bytes(range(256)) * 9)
    return path


def test_a_file_is_linked_or_copied(source, tmp_path):
    assert FileLinker(copy=False).link(source, tmp_path / 'a/b/linked')
    assert (tmp_path / 'a/b/linked').samefile(source)
    assert not FileLinker(copy=True).link(source, tmp_path / 'a/b/copied')
    assert not (tmp_path / 'a/b/copied').samefile(source)
    assert (tmp_path / 'a/b/copied').read_bytes() == source.read_bytes()


def test_a_symbolic_link_becomes_a_file(source, tmp_path):
    (tmp_path / 'link').symlink_to('source')
    for copy in (False, True):
        target = tmp_path / f'target_{copy}'
        FileLinker(copy=copy).link(tmp_path / 'link', target)
        assert not target.is_symlink()
        assert target.read_bytes() == source.read_bytes()


@pytest.mark.parametrize('code', [errno.EXDEV, errno.EPERM, errno.EMLINK, errno.EOPNOTSUPP])
def test_after_one_link_that_fails_all_are_copied(source, tmp_path, monkeypatch, code):
    tried = []

    def fail(*_):
        tried.append(1)
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, 'link', fail)
    linker = FileLinker(copy=False)
    assert not linker.why
    assert [linker.link(source, tmp_path / name) for name in 'ab'] == [False, False]
    assert (len(tried), linker.copy) == (1, True)
    assert linker.why
    assert (tmp_path / 'b').read_bytes() == source.read_bytes()


def test_other_errors_of_links_are_raised(source, tmp_path):
    (tmp_path / 'there').write_text('kept')
    for copy in (False, True):
        with pytest.raises(FileExistsError):
            FileLinker(copy=copy).link(source, tmp_path / 'there')
    assert (tmp_path / 'there').read_text() == 'kept'


@pytest.mark.parametrize('copy', [False, True])
def test_what_is_no_file_is_named(tmp_path, copy):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'broken').symlink_to('nowhere')
    (tmp_path / 'loop').symlink_to('loop')
    linker = FileLinker(copy=copy)
    with pytest.raises(BadFileError, match=r'pipe: is no regular file'):
        linker.link(tmp_path / 'pipe', tmp_path / 'out')
    for name in ('broken', 'absent'):
        with pytest.raises(UnreadableFileError, match=f'{name}: No such file'):
            linker.link(tmp_path / name, tmp_path / 'out')
    with pytest.raises(UnreadableFileError, match='loop: Too many levels of symbolic links'):
        linker.link(tmp_path / 'loop', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_a_read_error_is_that_of_the_source(source, tmp_path, monkeypatch):
    class Damaged(io.FileIO):
        def read(self, size=-1):
            if self.tell():
                raise OSError(errno.EIO, 'Input/output error')
            return super().read(size // 2)

    opened = type(source).open

    def open_damaged(path, *mode, **options):
        return Damaged(path) if path == source else opened(path, *mode, **options)

    monkeypatch.setattr(type(source), 'open', open_damaged)
    with pytest.raises(UnreadableFileError, match='source: Input/output error'):
        FileLinker(copy=True).link(source, tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_a_file_of_the_system_is_not_copied_without_end(tmp_path):
    assert not FileLinker(copy=True).link(Path('/proc/self/mem'), tmp_path / 'out')
    assert (tmp_path / 'out').read_bytes() == b''


def test_folders_are_walked_once(tmp_path):
    for name in ('b/2', 'b/1', 'a/1', 'skipped/1', '.hidden/1'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / 'a/loop').symlink_to(tmp_path)
    (tmp_path / 'a/.hidden').touch()
    failed = []
    found = walk_files(tmp_path, lambda path: path.name == 'skipped', failed.append)
    names = [path.relative_to(tmp_path).as_posix() for path in found]
    assert sorted(names) == ['a/1', 'b/1', 'b/2']
    assert names.index('b/1') < names.index('b/2')
    assert not failed
    assert list(walk_files(tmp_path / 'b/1', lambda _: False, failed.append)) == [tmp_path / 'b/1']


def test_a_folder_that_cannot_be_listed_is_told(tmp_path, monkeypatch):
    (tmp_path / 'a').mkdir()
    (tmp_path / 'b').touch()
    listed = type(tmp_path).iterdir

    def iterdir(path):
        if path.name == 'a':
            raise PermissionError(errno.EACCES, 'Permission denied', str(path))
        return listed(path)

    monkeypatch.setattr(type(tmp_path), 'iterdir', iterdir)
    failed = []
    assert list(walk_files(tmp_path, lambda _: False, failed.append)) == [tmp_path / 'b']
    assert [error.filename for error in failed] == [str(tmp_path / 'a')]
