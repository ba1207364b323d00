# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pieces that threads read ahead of their turn change nothing of what is read."""

from __future__ import annotations

import errno
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags import chunked_file
from kitti_ros2.bags.chunked_file import ChunkedFile
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.files import threads as workers_module

COUNT = 14
SIZE = 700_000
TYPE = 'std_msgs/msg/UInt8MultiArray'
TOPICS = ('/a', '/b')
KINDS = ('mcap', 'mcap-zstd', 'mcap-lz4', 'ros1', 'ros1-bz2', 'ros1-lz4')


def payloads(*, sorted_stamps=False):
    """Topic, stamp and message; numbers have a hole, and stamps of one topic step backwards."""
    store = get_typestore(Stores.ROS2_JAZZY)
    layout = store.types['std_msgs/msg/MultiArrayLayout']([], 0)
    rng = np.random.default_rng(5)
    for number in (*range(5), *range(8, COUNT)):
        data = rng.integers(0, 256, SIZE, np.uint8)
        data[SIZE // 2 :] = 7
        for place, topic in enumerate(TOPICS):
            stamp_ns = 10**18 + (number if sorted_stamps else number ^ place) * 10**8
            yield topic, stamp_ns, store.types[TYPE](layout, data)


def write_mcap(path, compression, **options):
    store = get_typestore(Stores.ROS2_JAZZY)
    text = store.generate_msgdef(TYPE, ros_version=2)[0].encode()
    with path.open('wb') as file:
        writer = McapWriter(file, compression=CompressionType[compression.upper()])
        writer.start('ros2', 'test')
        schema = writer.register_schema(TYPE, 'ros2msg', text)
        channels = {topic: writer.register_channel(topic, 'cdr', schema) for topic in TOPICS}
        for topic, stamp_ns, message in payloads(**options):
            data = bytes(store.serialize_cdr(message, TYPE))
            writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
        writer.finish()


def write_ros1(path, compression):
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Ros1Writer(path)
    if compression != 'none':
        writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
    with writer:
        channels = {topic: writer.add_connection(topic, TYPE, typestore=store) for topic in TOPICS}
        for topic, stamp_ns, message in payloads():
            writer.write(channels[topic], stamp_ns, store.serialize_ros1(message, TYPE))


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    container, _, compression = request.param.partition('-')
    path = tmp_path / f'bag.{"mcap" if container == "mcap" else "bag"}'
    (write_mcap if container == 'mcap' else write_ros1)(path, compression or 'none')
    return path


def read(bag, monkeypatch, workers, since_ns=None):
    monkeypatch.setattr(workers_module, 'worker_count', lambda: workers)
    with open_messages([bag]) as messages:
        found = [
            (each.topic, each.stamp_ns, hash(bytes(each.data))) for each in messages.since(since_ns)
        ]
        return found, messages.problems, messages.losses


@pytest.fixture
def fetches(monkeypatch):
    """The threads that fetched, and whether each chunk was unpacked there."""
    seen = []
    fetch = ChunkedFile.fetch

    def spy(self, chunk):
        found = fetch(self, chunk)
        seen.append((threading.current_thread().name, found.unpacked is not None))
        return found

    monkeypatch.setattr(ChunkedFile, 'fetch', spy)
    return seen


@pytest.mark.one_in(3)
@pytest.mark.parametrize('since', [None, 10**18 + 4 * 10**8])
def test_threads_change_nothing(bag, monkeypatch, fetches, since):
    expected = read(bag, monkeypatch, 1, since)
    assert not fetches
    assert read(bag, monkeypatch, 3, since) == expected
    assert len(fetches) > 3
    assert all(unpacked for _, unpacked in fetches)
    assert threading.main_thread().name not in dict(fetches)
    if since is None:
        assert len(expected[0]) == len(list(payloads()))
        assert not expected[2]


@pytest.mark.one_in(3)
def test_damage_is_found_in_its_turn(bag, monkeypatch, fetches):
    data = bytearray(bag.read_bytes())
    data[len(data) // 2] ^= 0xFF
    bag.write_bytes(data)
    expected = read(bag, monkeypatch, 1)
    assert read(bag, monkeypatch, 3) == expected
    # Chunks of ROS 1 have no checksum.
    assert expected[2] or bag.suffix == '.bag'
    assert fetches


def failing_reads(monkeypatch, *, in_threads_only):
    pread = os.pread
    failures = []

    def fail(file, length, position):
        is_main = threading.current_thread() is threading.main_thread()
        if length > SIZE // 4 and position > 2 * SIZE // 10 and not (is_main and in_threads_only):
            failures.append(position)
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return pread(file, length, position)

    monkeypatch.setattr(os, 'pread', fail)
    return failures


def test_what_a_thread_cannot_read_is_read_again(tmp_path, monkeypatch):
    bag = tmp_path / 'bag.mcap'
    write_mcap(bag, 'none')
    expected = read(bag, monkeypatch, 1)
    failures = failing_reads(monkeypatch, in_threads_only=True)
    assert read(bag, monkeypatch, 3) == expected
    assert failures


def test_what_cannot_be_read_at_all_is_an_error_that_names_the_file(tmp_path, monkeypatch):
    bag = tmp_path / 'bag.mcap'
    write_mcap(bag, 'none')
    failing_reads(monkeypatch, in_threads_only=False)
    with pytest.raises(OSError, match=r'bag\.mcap') as raised:
        read(bag, monkeypatch, 3)
    assert raised.value.errno == errno.EIO


def test_a_system_without_threads_reads_all(tmp_path, monkeypatch):
    bag = tmp_path / 'bag.mcap'
    write_mcap(bag, 'none')
    expected = read(bag, monkeypatch, 1)

    def refuse(*_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(ThreadPoolExecutor, 'submit', refuse)
    assert read(bag, monkeypatch, 3) == expected


def test_who_stops_early_waits_for_one_piece_and_leaves_no_thread(tmp_path, monkeypatch, fetches):
    bag = tmp_path / 'bag.mcap'
    write_mcap(bag, 'none', sorted_stamps=True)
    monkeypatch.setattr(workers_module, 'worker_count', lambda: 3)
    before = threading.active_count()
    with open_messages([bag]) as messages:
        found = messages.since(None)
        next(found)
        found.close()
        assert len(fetches) <= 1
        assert threading.active_count() == before


def test_large_chunks_wait_for_their_turn(tmp_path, monkeypatch, fetches):
    bag = tmp_path / 'bag.mcap'
    write_mcap(bag, 'zstd')
    monkeypatch.setattr(chunked_file, '_MOST_UNPACKED', SIZE)
    expected = read(bag, monkeypatch, 1)
    assert read(bag, monkeypatch, 3) == expected
    assert fetches
    assert not any(unpacked for _, unpacked in fetches)
