# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Compressed data cost no more memory than they declare, and declare no more than a limit."""

import bz2
import io
import struct
import tracemalloc

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from lz4 import frame as lz4_frame

from kitti_ros2.bags.decompressors import (
    decompress,
    decompress_beginning,
    decompress_file,
    decompress_message,
)
from kitti_ros2.bags.limits import LARGEST_BLOCK
from kitti_ros2.model.errors import UsageError

MB = 10**6
BOMB = bytes(300 * MB)
COMPRESS = {
    'zstd': zstandard.ZstdCompressor().compress,
    'zstd without a size': zstandard.ZstdCompressor(write_content_size=False).compress,
    'lz4': lz4_frame.compress,
    'lz4 without a size': lambda data: lz4_frame.compress(data, store_size=False),
    'bz2': bz2.compress,
}


@pytest.fixture(scope='module', params=COMPRESS)
def bomb(request):
    """The name of a compression, and 300 MB compressed."""
    return request.param.split()[0], COMPRESS[request.param](BOMB)


@pytest.fixture
def allocated():
    """Returns the most bytes that were allocated above those of the last call."""
    tracemalloc.start()
    before = 0

    def peak():
        nonlocal before
        now, most = tracemalloc.get_traced_memory()
        found, before = most - before, now
        tracemalloc.reset_peak()
        return found

    yield peak
    tracemalloc.stop()


@pytest.mark.parametrize('size', [0, 1, 1000, 10 * MB])
def test_a_block_is_decompressed_to_its_size_and_no_further(bomb, size, allocated):
    name, data = bomb
    with pytest.raises(ValueError, match='bytes'):
        decompress(name, data, size)
    assert allocated() < 3 * size + 3 * MB


def test_a_block_that_declares_too_much_is_refused(bomb, allocated):
    name, data = bomb
    with pytest.raises(ValueError, match=f'become 300.0 MB; expected at most .*{LARGEST_BLOCK}='):
        decompress(name, data, len(BOMB))
    assert allocated() < MB


def test_a_user_may_raise_the_limit(bomb, monkeypatch):
    name, data = bomb
    monkeypatch.setenv(LARGEST_BLOCK, '1GB')
    assert decompress(name, data, len(BOMB)) == BOMB
    monkeypatch.setenv(LARGEST_BLOCK, 'much')
    with pytest.raises(UsageError, match="a size such as 2GB, not 'much'"):
        decompress(name, data, len(BOMB))


@pytest.mark.parametrize(('size', 'most'), [(1000, 1000), (0, 64 * MB), (2**32, 64 * MB)])
def test_the_beginning_of_a_block_is_bounded(bomb, size, most, allocated):
    name, data = bomb
    found = decompress_beginning(name, data[: len(data) - 3], size)
    assert len(found) <= most
    assert allocated() < 1.3 * most + 3 * MB
    assert not any(found[:1000])


@pytest.mark.parametrize('kind', ['zstd', 'zstd without a size'])
def test_a_message_is_bounded(kind, allocated):
    data = COMPRESS[kind](BOMB)
    allocated()
    with pytest.raises(ValueError, match='expected at most'):
        decompress_message(data)
    assert allocated() < 64 * MB


def zstd_lie(size):
    """A frame that declares a size, and has 300 MB in blocks of one repeated byte (RFC 8878)."""
    count, most = len(BOMB) // 2**17, 2**17
    heads = [most << 3 | 1 << 1 | (number == count - 1) for number in range(count)]
    blocks = b''.join(struct.pack('<I', head)[:3] + b'\0' for head in heads)
    return b'\x28\xb5\x2f\xfd\x80\x58' + struct.pack('<I', size) + blocks


def lz4_lie(size):
    """The header of a frame of that size, and the blocks of one of 300 MB."""
    header_end = 15
    true, false = (
        lz4_frame.compress(bytes(each), block_size=lz4_frame.BLOCKSIZE_MAX4MB)
        for each in (len(BOMB), size)
    )
    return false[:header_end] + true[header_end:]


@pytest.mark.parametrize('size', [5 * MB, 20 * MB])
def test_a_block_that_lies_about_its_size_is_decompressed_to_that(size, allocated):
    lies = {'zstd': zstd_lie(size), 'lz4': lz4_lie(size)}
    allocated()
    for name, data in lies.items():
        with pytest.raises(ValueError, match=r'more than|too small'):
            decompress(name, data, size)
        assert allocated() < 3 * size + 3 * MB
    with pytest.raises(ValueError, match='too small'):
        decompress_message(lies['zstd'])
    assert allocated() < 3 * size + 3 * MB


@pytest.mark.parametrize('kind', ['zstd', 'zstd without a size'])
def test_a_file_is_bounded(kind, monkeypatch):
    monkeypatch.setattr('kitti_ros2.bags.limits._FILE_ALWAYS', 20 * MB)
    target = io.BytesIO()
    with pytest.raises(ValueError, match='expected at most'):
        target.writelines(decompress_file(io.BytesIO(COMPRESS[kind](BOMB))))
    assert target.tell() <= 20 * MB


@given(st.binary(min_size=1, max_size=300), st.integers(1, 5), st.sampled_from(sorted(COMPRESS)))
def test_what_was_compressed_comes_back(data, times, kind):
    name, packed = kind.split()[0], COMPRESS[kind](data * times)
    assert decompress(name, packed, len(data) * times) == data * times
    assert decompress_beginning(name, packed, len(data) * times) == data * times
    assert (data * times).startswith(bytes(decompress_beginning(name, packed[:-5], 0)))
    if name == 'bz2':  # of several streams, as parallel compressors write it
        assert decompress(name, packed * 2, 2 * len(data) * times) == data * times * 2
    if name == 'zstd':
        assert decompress_message(packed) == data * times
        with pytest.raises(ValueError, match=r'cut off|did not decompress full frame'):
            decompress_message(packed[:-1])
    for size in (0, len(data) * times + 1, len(data) * times - 1):
        with pytest.raises(ValueError, match='bytes'):
            decompress(name, packed, size)
