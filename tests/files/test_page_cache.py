# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writing past the page cache, where the kernel can and where it cannot."""

from __future__ import annotations

import errno
import mmap
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.files import local_files
from kitti_ros2.files.local_files import UnbufferedFile, without_end, without_start, write_uncached
from kitti_ros2.kitti.store import STORE

SIZES = [0, 1, 4095, 4096, 65535, 65536, 65537, 3 * 2**20 + 5]


REFUSALS = [OSError(errno.EOPNOTSUPP, ''), OSError(errno.EINVAL, ''), NotImplementedError()]


@pytest.fixture(params=[None, *REFUSALS], ids=repr, autouse=True)
def kernel(request, monkeypatch) -> None:
    """The kernel that runs, and those that do not know the flag, nor does their Python."""
    if request.param is None:
        return
    pwritev = os.pwritev

    def older(file, buffers, position, flags=0):
        if flags:
            raise request.param
        return pwritev(file, buffers, position)

    monkeypatch.setattr(os, 'pwritev', older)
    monkeypatch.setattr(local_files, '_KERNEL_DROPS_PAGES', True)


def some_bytes(count: int) -> bytes:
    return (bytes(range(251)) * (count // 251 + 1))[:count]


@pytest.mark.parametrize('size', SIZES)
def test_a_stored_file_is_whole(tmp_path, size):
    data = some_bytes(size)
    STORE.write(tmp_path / 'new' / 'file', data)
    STORE.write(tmp_path / 'new' / 'file', memoryview(data))
    assert (tmp_path / 'new' / 'file').read_bytes() == data


def test_a_file_of_many_buffers_is_whole(tmp_path):
    file = UnbufferedFile(tmp_path / 'file')
    head = bytes(100)
    file.write([head])
    batches = [[some_bytes(size), some_bytes(7)] for size in SIZES] + [[some_bytes(3)] * 5000]
    for batch in batches:
        file.write(batch)
    file.write_at(10, b'changed')
    file.close()
    assert file.position == (tmp_path / 'file').stat().st_size
    expected = head[:10] + b'changed' + head[17:] + b''.join(map(b''.join, batches))
    assert (tmp_path / 'file').read_bytes() == expected


@pytest.mark.parametrize('start', [0, 1, 4096, 5000])
@pytest.mark.parametrize('size', SIZES)
def test_what_is_left_for_the_next_call_is_less_than_a_page(tmp_path, start, size):
    with (tmp_path / 'file').open('wb') as file:
        written = write_uncached(file.fileno(), [some_bytes(size)], start)
    assert size - mmap.PAGESIZE < written <= size
    assert written == size or (start + written) % mmap.PAGESIZE == 0


@pytest.mark.parametrize('sound', [True, False])
def test_whole_pages_of_large_buffers_are_not_cached(tmp_path, monkeypatch, sound):
    asked = []

    def pwritev(_file, buffers, position, flags=0):
        asked.append((flags, position, sum(map(len, buffers))))
        return asked[-1][2]

    monkeypatch.setattr(os, 'pwritev', pwritev)
    monkeypatch.setattr(local_files, '_KERNEL_DROPS_PAGES', sound)
    STORE.write(tmp_path / 'small', bytes(65535))
    STORE.write(tmp_path / 'large', bytes(3 * 65536 + 5))
    large = [(0x80, 0, 3 * 65536), (0, 3 * 65536, 5)] if sound else [(0, 0, 3 * 65536 + 5)]
    assert asked == [(0, 0, 65535), *large]


@pytest.mark.parametrize(
    ('platform', 'release', 'sound'),
    [
        ('linux', '6.16.0', True),
        ('linux', '6.18.44-fc', True),
        ('linux', '7.0-rc1', True),
        ('linux', '6.15.9', False),
        ('linux', '6.8.0-45-generic', False),
        ('linux', 'unknown', False),
        ('darwin', '23.1.0', False),
    ],
)
def test_kernels_that_are_trusted(platform, release, sound):
    assert local_files.kernel_drops_pages(platform, release) is sound


def test_what_the_disk_refuses_is_told(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, 'pwritev', full)
    for size in (10, 2**20):
        with pytest.raises(OSError, match='No space left') as caught:
            STORE.write(tmp_path / 'file', bytes(size))
        assert caught.value.errno == errno.ENOSPC


@given(st.lists(st.binary(max_size=9)), st.integers(0, 40))
def test_buffers_are_cut_anywhere(buffers, count):
    whole = b''.join(buffers)
    assert b''.join(without_start(buffers, count)) == whole[count:]
    assert b''.join(without_end(buffers, count)) == whole[: max(len(whole) - count, 0)]
