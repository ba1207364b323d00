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

from kitti_ros2.bags.vectored_file import VectoredFile
from kitti_ros2.kitti.store import STORE
from kitti_ros2.uncached import without_end, without_start, write_uncached

SIZES = [0, 1, 4095, 4096, 65535, 65536, 65537, 3 * 2**20 + 5]


@pytest.fixture(params=['as it is', errno.EOPNOTSUPP, errno.EINVAL], autouse=True)
def kernel(request, monkeypatch) -> None:
    """The kernel that runs, and those that do not know the flag."""
    if request.param == 'as it is':
        return
    pwritev = os.pwritev

    def older(file, buffers, position, flags=0):
        if flags:
            raise OSError(request.param, os.strerror(request.param))
        return pwritev(file, buffers, position)

    monkeypatch.setattr(os, 'pwritev', older)


def some_bytes(count: int) -> bytes:
    return (bytes(range(251)) * (count // 251 + 1))[:count]


@pytest.mark.parametrize('size', SIZES)
def test_a_stored_file_is_whole(tmp_path, size):
    data = some_bytes(size)
    STORE.write(tmp_path / 'new' / 'file', data)
    STORE.write(tmp_path / 'new' / 'file', memoryview(data))
    assert (tmp_path / 'new' / 'file').read_bytes() == data


def test_a_file_of_many_buffers_is_whole(tmp_path):
    file = VectoredFile(tmp_path / 'file')
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
