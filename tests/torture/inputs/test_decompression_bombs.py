# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Compressed data cost no more memory than they declare, and declare no more than a limit."""

import bz2
import io
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from lz4 import frame as lz4_frame
from mcap.writer import CompressionType, Writer

from kitti_ros2.bags.decompression import (
    LARGEST_BLOCK,
    FileLimits,
    decompress,
    decompress_beginning,
    decompress_file,
    decompress_message,
)
from kitti_ros2.bags.reader import open_messages
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


def test_no_memory_is_asked_for_that_a_beginning_does_not_need(monkeypatch):
    monkeypatch.setenv(LARGEST_BLOCK, '1000TB')
    packed = COMPRESS['zstd without a size'](BOMB[:MB])
    for size in (0, 2**49):
        found = decompress_beginning('zstd', packed[:-3], size)
        assert 0 < len(found) <= MB


GROWS = """
import re, sys
from pathlib import Path
from kitti_ros2.bags.decompression import decompress_beginning

def kilobytes(name):
    return int(re.search(name + r':\\s+(\\d+) kB', Path('/proc/self/status').read_text())[1])

packed = sys.stdin.buffer.read()
freed = bytearray(31 << 20)
del freed  # from now on malloc has such blocks on the heap, where growing copies them
before = kilobytes('VmRSS')
found = decompress_beginning('zstd', packed, 0)
print(len(found), (kilobytes('VmHWM') - before) << 10)
"""


@pytest.mark.skipif(not Path('/proc/self/status').exists(), reason='needs /proc')
def test_the_beginning_of_a_block_is_not_copied_while_it_grows():
    packed = COMPRESS['zstd without a size'](BOMB)
    done = subprocess.run(
        [sys.executable, '-c', GROWS], input=packed[:-3], capture_output=True, check=True
    )
    size, grown = map(int, done.stdout.split())
    assert size == 64 * MB
    assert grown < 1.2 * size


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
    monkeypatch.setattr('kitti_ros2.bags.decompression._FILE_ALWAYS', 20 * MB)
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


def ros1_record(fields, data=b''):
    """A record of a ROS 1 bag."""
    parts = [name + b'=' + value for name, value in fields.items()]
    head = b''.join(struct.pack('<I', len(part)) + part for part in parts)
    return struct.pack('<I', len(head)) + head + struct.pack('<I', len(data)) + data


def ros1_chunk(records, counted=None):
    """A chunk of bz2."""
    size = struct.pack('<I', counted or len(records))
    fields = {b'op': b'\5', b'compression': b'bz2', b'size': size}
    return ros1_record(fields, bz2.compress(records))


def ros1_connection(number, topic):
    """The description of a topic of std_msgs/Empty."""
    described = {
        b'topic': topic,
        b'type': b'std_msgs/Empty',
        b'md5sum': b'd41d8cd98f00b204e9800998ecf8427e',
        b'message_definition': b'',
    }
    parts = [name + b'=' + value for name, value in described.items()]
    data = b''.join(struct.pack('<I', len(part)) + part for part in parts)
    fields = {b'op': b'\7', b'conn': struct.pack('<I', number), b'topic': topic}
    return ros1_record(fields, data)


EMPTY_MESSAGE = ros1_record({b'op': b'\2', b'conn': bytes(4), b'time': struct.pack('<II', 1, 0)})


def ros1_bag(path, chunks, counts=()):
    """A bag; with an index where counts of the messages in each chunk are given, true or not."""

    def head(index_pos):
        return ros1_record(
            {
                b'op': b'\3',
                b'index_pos': struct.pack('<Q', index_pos),
                b'conn_count': struct.pack('<I', 1),
                b'chunk_count': struct.pack('<I', len(counts)),
            },
            bytes(4096),
        )

    magic = b'#ROSBAG V2.0\n'
    places = [len(magic) + len(head(0))]
    for chunk in chunks:
        places.append(places[-1] + len(chunk))
    index = [
        ros1_record(
            {
                b'op': b'\6',
                b'ver': struct.pack('<I', 1),
                b'chunk_pos': struct.pack('<Q', place),
                b'start_time': struct.pack('<II', 1, 0),
                b'end_time': struct.pack('<II', 1, 0),
                b'count': struct.pack('<I', 1),
            },
            struct.pack('<II', 0, count),
        )
        for place, count in zip(places, counts, strict=False)
    ]
    start = head(places[-1] if counts else 0)
    connections = [ros1_connection(0, b'/imu')] if counts else []
    path.write_bytes(b''.join([magic, start, *chunks, *connections, *index]))
    return path


MESSAGES = ros1_chunk(ros1_connection(0, b'/imu') + EMPTY_MESSAGE * 150_000)


@pytest.mark.parametrize('counts', [(), [1] * 6], ids=['no index', 'an index that lies'])
def test_the_messages_of_all_blocks_are_bounded(counts, tmp_path):
    bag = ros1_bag(tmp_path / 'a.bag', [MESSAGES] * 6, counts)
    with open_messages(bag) as reader:
        found = sum(1 for _ in reader)
        lost = [text for text in reader.losses if 'hold more than 200000 records' in text]
    assert 150_000 <= found <= 200_000
    assert len(lost) >= 4 or any('what follows is not read' in text for text in lost)
    assert all(LARGEST_BLOCK in text for text in lost)


def test_a_user_may_raise_the_number_of_messages(tmp_path, monkeypatch):
    monkeypatch.setenv(LARGEST_BLOCK, '1GB')
    with open_messages(ros1_bag(tmp_path / 'a.bag', [MESSAGES] * 2)) as reader:
        assert sum(1 for _ in reader) == 300_000


def test_the_size_of_all_blocks_is_bounded(tmp_path):
    blank = ros1_record({b'op': b'\2', b'conn': bytes(4), b'time': bytes(8)}, bytes(60 * MB))
    chunk = ros1_chunk(ros1_connection(0, b'/imu') + blank)
    with open_messages(ros1_bag(tmp_path / 'a.bag', [chunk] * 40)) as reader:
        lost = [text for text in reader.losses if 'expected at most 1.0 GB' in text]
    assert len(lost) == 24


def test_the_connections_of_a_block_are_bounded(tmp_path):
    records = b''.join(ros1_connection(number, b'/t%d' % number) for number in range(70_000))
    bag = ros1_bag(tmp_path / 'a.bag', [ros1_chunk(records)])
    with open_messages(bag) as reader:
        assert any('more than 20000 topics and types' in text for text in reader.losses)


def test_the_same_block_counts_once():
    limits = FileLimits(1000)
    for _ in range(50):
        limits.add_block(0, 900 * MB)
        limits.add_records(0, 150_000)
    with pytest.raises(ValueError, match='expected at most'):
        limits.add_block(1, 200 * MB)
    limits.add_block(1, 100 * MB)
    with pytest.raises(ValueError, match='hold more than 200000 records'):
        limits.add_records(1, 60_000)
    with pytest.raises(ValueError, match='hold more than 200000 records'):
        limits.add_block(2, 1)


def test_an_index_of_one_chunk_many_times_is_not_believed(tmp_path):
    bag = tmp_path / 'a.mcap'
    writer = Writer(str(bag), compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema('std_msgs/msg/Empty', 'ros2msg', b'')
    channel = writer.register_channel('/a', 'cdr', schema)
    for stamp_ns in range(10):
        writer.add_message(channel, stamp_ns, bytes(5), stamp_ns)
    writer._Writer__finalize_chunk()
    writer._Writer__chunk_indices *= 1000
    writer._Writer__statistics.message_count *= 1000
    writer.finish()
    with open_messages(bag) as reader:
        assert sum(1 for _ in reader) == reader.expected == 10
