# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files of MCAP that contradict themselves: nothing of them is passed over in silence."""

from __future__ import annotations

import pytest
from mcap.writer import CompressionType, Writer

from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.recover import recover
from kitti_ros2.cli import main

STRING, INTEGER = 'std_msgs/msg/String', 'std_msgs/msg/Int32'
TEXTS = {STRING: b'string data\n', INTEGER: b'int32 data\n'}
MESSAGE = bytes([0, 1, 0, 0, 2, 0, 0, 0, 65, 0])
HEAD = 8  # bytes of the magic, which begins and ends a file


def write(path, *, topics=('/a', '/a'), kinds=(STRING, STRING), indexed=False):
    """Two chunks of two messages, in each of which channel 1 and its schema have number 1."""
    writer = Writer(
        str(path),
        compression=CompressionType.NONE,
        use_summary_offsets=indexed,
        use_statistics=indexed,
        repeat_channels=indexed,
        repeat_schemas=indexed,
    )
    writer.start()
    for number, (topic, kind) in enumerate(zip(topics, kinds, strict=True)):
        writer._Writer__schemas.clear()
        writer._Writer__channels.clear()
        schema = writer.register_schema(kind, 'ros2msg', TEXTS[kind])
        channel = writer.register_channel(topic, 'cdr', schema)
        for place in range(2):
            stamp_ns = 10 * number + place
            writer.add_message(channel, stamp_ns, MESSAGE, stamp_ns)
        writer._Writer__finalize_chunk()
    writer.finish()
    return path


def losses(path):
    """Those of a reader of all messages, and their number."""
    with open_messages(path) as reader:
        return sum(1 for _ in reader), list(reader.losses)


@pytest.mark.parametrize('indexed', [False, True])
@pytest.mark.parametrize(
    ('changed', 'said'),
    [
        ({'topics': ('/a', '/b')}, 'channel 1 is described in two ways, /'),
        ({'kinds': (STRING, INTEGER)}, 'schema 1 is described in two ways, std_msgs/msg/'),
        ({}, ''),
    ],
)
def test_what_a_file_describes_in_two_ways_is_told(changed, said, indexed, tmp_path):
    path = write(tmp_path / 'a.mcap', indexed=indexed, **changed)
    count, lost = losses(path)
    assert count == 4
    assert [text.partition(': ')[2][: len(said)] for text in lost] == [said] * bool(said)
    report = recover(path, tmp_path / 'out.mcap')
    assert (list(report.losses), report.lost) == (lost, 0)


@pytest.mark.parametrize('indexed', [False, True])
def test_what_follows_the_end_of_a_file_is_told(indexed, tmp_path):
    first, path = write(tmp_path / 'first.mcap', indexed=indexed), tmp_path / 'joined.mcap'
    end = len(first.read_bytes())
    path.write_bytes(first.read_bytes() * 2)
    _, lost = losses(path)
    assert f'{path}: it ends at byte {end}, and what follows is not read' in lost[-1]
    assert not summarize_bag(path).complete
    assert main(['recover', str(path), str(tmp_path / 'out.mcap')]) == 1


def test_a_chunk_inside_a_chunk_is_told(tmp_path):
    path = write(tmp_path / 'a.mcap')
    data = path.read_bytes()
    start = data.index(b'\x06', HEAD + 9)  # the first chunk, behind the header
    end = start + 9 + int.from_bytes(data[start + 1 : start + 9], 'little')
    chunk = data[start:end]
    body = bytes(16) + len(chunk).to_bytes(8, 'little') + bytes(8)
    body += len(chunk).to_bytes(8, 'little') + chunk
    outer = b'\x06' + len(body).to_bytes(8, 'little') + body
    path.write_bytes(data[:start] + outer + data[end:])
    count, lost = losses(path)
    assert count == 2
    assert f'{path}: a chunk inside a chunk, where MCAP has none, is not read' in lost
