# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages read one by one at the offsets in a file's index: the same as those of whole chunks."""

from __future__ import annotations

import os
import random
import struct

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.container_file import FileBytes, MessageStart, size_of
from kitti_ros2.bags.reader import bag_stamps, open_messages
from kitti_ros2.bags.ros1_bag import INDEX, opcode_of, split_record
from kitti_ros2.messages.cdr import peek_header
from kitti_ros2.model.bag_formats import HEADER

START_NS = 10**18
TEXT, BYTES = 'std_msgs/msg/String', 'std_msgs/msg/UInt8MultiArray'
TYPES = {'/large': BYTES, '/small': TEXT, '/rare': TEXT}
CHUNK_BYTES = 500_000
KINDS = {
    'mcap': 'bag.mcap',
    'mcap-zstd': 'bag.mcap',
    'mcap-unindexed': 'bag.mcap',
    'ros1': 'bag.bag',
    'ros1-lz4': 'bag.bag',
}
INDEXED = ('mcap', 'ros1')
START_OF_RECORDS = 49  # of an MCAP chunk that is not compressed


def payloads(store):
    """Topic, stamp and message; stamps step back within chunks and across them."""
    rng = random.Random(4)
    layout = store.types['std_msgs/msg/MultiArrayLayout']([], 0)
    array, text = store.types[BYTES], store.types[TEXT]
    for frame in range(24):
        numbers = np.frombuffer(rng.randbytes(100_000 + 7 * frame), np.uint8)
        yield '/large', START_NS + (frame ^ 3) * 100, array(layout, numbers)
        for index in range(3):
            yield '/small', START_NS + frame * 100 + index % 2, text(f'{frame} {index}')
        if frame % 5 == 0:
            yield '/rare', START_NS + frame * 100 - 150, text('r' * 20_000)


def write(path, kind):
    container, _, compression = kind.partition('-')
    if container == 'ros1':
        store = get_typestore(Stores.ROS1_NOETIC)
        writer = Ros1Writer(path)
        writer.chunk_threshold = CHUNK_BYTES
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        with writer:
            channels = {
                topic: writer.add_connection(topic, kind, typestore=store)
                for topic, kind in TYPES.items()
            }
            for topic, stamp_ns, message in payloads(store):
                data = store.serialize_ros1(message, TYPES[topic])
                writer.write(channels[topic], stamp_ns, data)
        return path
    store = get_typestore(Stores.ROS2_JAZZY)
    with path.open('wb') as file:
        zstd = CompressionType.ZSTD if compression == 'zstd' else CompressionType.NONE
        index = IndexType.CHUNK if compression == 'unindexed' else IndexType.ALL
        mcap = McapWriter(file, chunk_size=CHUNK_BYTES, compression=zstd, index_types=index)
        mcap.start('ros2', 'test')
        ids = {}
        for topic, msgtype in TYPES.items():
            text = store.generate_msgdef(msgtype, ros_version=2)[0].encode()
            schema = mcap.register_schema(msgtype, 'ros2msg', text)
            ids[topic] = mcap.register_channel(topic, 'cdr', schema)
        for topic, stamp_ns, message in payloads(store):
            data = bytes(store.serialize_cdr(message, TYPES[topic]))
            mcap.add_message(ids[topic], stamp_ns, data, stamp_ns)
        mcap.finish()
    return path


@pytest.fixture(params=KINDS)
def bag(request, tmp_path):
    return write(tmp_path / KINDS[request.param], request.param)


@pytest.fixture(params=INDEXED)
def plain(request, tmp_path):
    return write(tmp_path / KINDS[request.param], request.param)


def read(path, topics=None, since_ns=None, *, whole=False):
    with OpenBag(path, whole_chunks=whole) as opened, open_messages(opened, topics) as messages:
        found = [(each.topic, each.stamp_ns, bytes(each.data)) for each in messages.since(since_ns)]
        return found, messages.losses


def bytes_read(monkeypatch, path, topics):
    """The bytes of the file that reading topics takes."""
    taken = [0]
    inner = FileBytes.read

    def counted(self, position, length):
        data = inner(self, position, length)
        taken[0] += len(data)
        return data

    with monkeypatch.context() as patch:
        patch.setattr(FileBytes, 'read', counted)
        read(path, topics)
    return taken[0]


TOPICS = [None, {'/large'}, {'/small'}, {'/rare'}, {'/small', '/rare'}]


def topic_id(topics):
    return 'all' if topics is None else ' '.join(sorted(topics))  # the same in all processes


@pytest.mark.parametrize('since_ns', [None, START_NS + 300, START_NS + 451, START_NS + 10**6])
@pytest.mark.parametrize('topics', TOPICS, ids=topic_id)
def test_the_same_messages_in_the_same_order(bag, topics, since_ns):
    expected = read(bag, topics, since_ns, whole=True)
    assert read(bag, topics, since_ns) == expected
    assert bool(expected[0]) == (since_ns != START_NS + 10**6)


@pytest.mark.parametrize('topics', TOPICS[2:], ids=topic_id)
def test_small_messages_take_few_bytes(plain, topics, monkeypatch):
    assert bytes_read(monkeypatch, plain, topics) < plain.stat().st_size / 5
    assert bytes_read(monkeypatch, plain, None) > plain.stat().st_size


def test_of_large_messages_the_start_may_do(tmp_path):
    path = write(tmp_path / 'bag.mcap', 'mcap')
    expected, _ = read(path, whole=True)
    asked = []
    with open_messages(path) as messages:
        # Not of the first, nor of the 18th: asked when those before are known.
        messages.skim(lambda topic: topic == '/large' and len(asked) not in (0, 17))
        found = []
        for message in messages:
            found.append(message)
            if message.topic == '/large':
                asked.append(type(message.data))
    assert [(each.topic, each.stamp_ns, size_of(each.data)) for each in found] == [
        (topic, stamp_ns, len(data)) for topic, stamp_ns, data in expected
    ]
    assert all(
        bytes(each.data[:1024]) == data[:1024]
        for each, (_, _, data) in zip(found, expected, strict=True)
    )
    assert [place for place in range(24) if asked[place] is not MessageStart] == [0, 17]


def test_the_start_of_a_large_message_of_ros1_is_its_header(tmp_path):
    path, msgtype = tmp_path / 'bag.bag', 'sensor_msgs/msg/CompressedImage'
    store = get_typestore(Stores.ROS1_NOETIC)
    image, header, time = (
        store.types[name] for name in (msgtype, HEADER, 'builtin_interfaces/msg/Time')
    )
    with Ros1Writer(path) as writer:
        channel = writer.add_connection('/image', msgtype, typestore=store)
        for number in range(20):
            head = header(number, time(7, number), 'camera' * number)
            message = image(head, 'png', np.zeros(100_000 + number, np.uint8))
            writer.write(channel, START_NS + number, store.serialize_ros1(message, msgtype))
    expected, _ = read(path)
    with open_messages(path) as messages:
        messages.skim(lambda _: True)
        starts = [message.data for message in messages]
    assert all(isinstance(start, MessageStart) for start in starts)
    assert [*map(peek_header, starts)] == [peek_header(data) for _, _, data in expected]
    assert [start.size // 1000 for start in starts] == [100] * 20


# An index that lies. What is patched: an offset in the file and new bytes, by container.


def patch(path, position, data):
    with path.open('r+b') as file:
        file.seek(position)
        file.write(data)


def mcap_entry(path, topic='/small', index=0):
    """Position of an entry (stamp, offset) of the first chunk with a topic, and its chunk."""
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
        channel_id = next(key for key, each in summary.channels.items() if each.topic == topic)
        chunk = next(c for c in summary.chunk_indexes if channel_id in c.message_index_offsets)
        position = chunk.message_index_offsets[channel_id] + 15 + 16 * index
        file.seek(position)
        _, offset = struct.unpack('<QQ', file.read(16))
    return position, chunk.chunk_start_offset + START_OF_RECORDS + offset


def ros1_entry(path, conn=1, index=0):
    """The same of a connection in a ROS 1 bag: an entry (seconds, nanoseconds, offset)."""
    data = path.read_bytes()
    at = records_at = 13
    while True:
        fields, start, end = split_record(data, at)
        if 'compression' in str(fields):
            records_at = start
        if opcode_of(fields) == INDEX and fields[b'conn'][0] == conn:
            position = start + 12 * index
            return position, records_at + int.from_bytes(
                data[position + 8 : position + 12], 'little'
            )
        at = end


def entry(path, **kwargs):
    return (mcap_entry if path.suffix == '.mcap' else ros1_entry)(path, **kwargs)


def offset_at(path, position):
    return position + 8, 8 if path.suffix == '.mcap' else 4


@pytest.mark.parametrize('offset', ['another', 'inside', 'the chunk behind', 'far beyond'])
def test_an_offset_that_is_wrong_is_noticed(plain, offset):
    expected = read(plain, {'/small'}, whole=True)
    position, _ = entry(plain)
    at, size = offset_at(plain, position)
    own = int.from_bytes(plain.read_bytes()[at : at + size], 'little')
    wrong = {'another': 0, 'inside': own + 9, 'the chunk behind': 10**6, 'far beyond': 2**32 - 1}
    patch(plain, at, wrong[offset].to_bytes(size, 'little'))
    assert read(plain, {'/small'}) == read(plain, {'/small'}, whole=True) == expected
    assert expected[1] == {}


def test_an_entry_given_twice_is_noticed(plain):
    expected = read(plain, {'/small'}, whole=True)
    size = 16 if plain.suffix == '.mcap' else 12
    first, second = entry(plain)[0], entry(plain, index=1)[0]
    patch(plain, second, plain.read_bytes()[first : first + size])
    assert read(plain, {'/small'}) == read(plain, {'/small'}, whole=True) == expected


def test_an_index_without_an_entry_is_noticed(tmp_path):
    path = write(tmp_path / 'bag.mcap', 'mcap')
    expected = read(path, {'/small'}, whole=True)
    with path.open('rb') as file:
        chunk = make_reader(file).get_summary().chunk_indexes[1]
    end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length
    last = max(chunk.message_index_offsets.values())
    patch(path, last, struct.pack('<BQ', 0x80, end - last - 20))
    patch(path, end - 11, struct.pack('<BQH', Opcode.MESSAGE_INDEX, 2, 1))
    assert read(path, {'/small'}) == expected
    assert bag_stamps(path)


def test_another_stamp_is_noticed(plain):
    expected = read(plain, {'/small'}, whole=True)
    position, _ = entry(plain, index=2)
    stamp = position if plain.suffix == '.mcap' else position + 4
    patch(plain, stamp, bytes([plain.read_bytes()[stamp] ^ 1]))
    assert read(plain, {'/small'}) == read(plain, {'/small'}, whole=True) == expected


@pytest.mark.parametrize('part', ['opcode', 'channel', 'stamp', 'length'])
def test_a_damaged_head_is_the_loss_that_a_whole_chunk_reports(plain, part):
    _, record = entry(plain, index=1)
    if plain.suffix == '.mcap':
        at = record + {'opcode': 0, 'length': 5, 'channel': 9, 'stamp': 15}[part]
    else:
        data = plain.read_bytes()
        names = {'opcode': b'op=', 'channel': b'conn=', 'stamp': b'time='}
        size = int.from_bytes(data[record : record + 4], 'little')
        at = record + 4 + size + 3
        if part in names:
            at = data.index(names[part], record) + len(names[part])
    patch(plain, at, bytes([plain.read_bytes()[at] ^ 64]))
    found, losses = read(plain, {'/small'})
    assert (found, losses) == read(plain, {'/small'}, whole=True)
    assert losses or len(found) == 72


def test_damage_is_found_where_it_is_read(tmp_path):
    """What info and others give up: the checksum covers all of the chunk, which is not read."""
    path = write(tmp_path / 'bag.mcap', 'mcap')
    _, record = entry(path, topic='/large')
    patch(path, record + 5000, b'damage')
    assert read(path, {'/small'})[1] == {}
    assert read(path, {'/small'}, whole=True)[1]
    assert read(path)[1]  # all of the chunk is wanted, so it is read whole


def test_a_file_that_is_cut_while_it_is_read_is_a_loss(plain):
    with open_messages(plain, {'/small', '/rare'}) as messages:
        before = [each.stamp_ns for each in messages.since(START_NS)]
        os.truncate(plain, plain.stat().st_size // 2)
        after = [each.stamp_ns for each in messages.since(START_NS)]
        assert 0 < len(after) < len(before)
        assert messages.losses
