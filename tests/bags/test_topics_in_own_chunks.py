# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Twice as many topics take twice as much work, also where each has a chunk of its own."""

import pytest
from counted_calls import calls_of
from mcap.writer import Writer

from kitti_ros2.bags.reader import BagMessages

FEW = 200
START_NS = 10**18
CDR = b'\0\1\0\0\2\0\0\0a\0'
STRING = ('std_msgs/msg/String', b'string data', 'cdr')
UNDEFINED = ('some_msgs/msg/Some', b'', 'cdr')
DAMAGED = ('some_msgs/msg/Some', b'no definition', 'cdr')
UNREADABLE = ('std_msgs/msg/String', b'string data', 'cbor')


def write_bag(path, count, kinds):
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=1)
        writer.start('ros2', 'a recorder')
        schemas = [writer.register_schema(name, 'ros2msg', text) for name, text, _ in kinds]
        for number in range(count):
            place = number % len(kinds)
            topic, encoding = f'/t{number}', kinds[place][2]
            channel = writer.register_channel(topic, encoding, schemas[place])
            writer.add_message(channel, START_NS + number, CDR, START_NS + number)
        writer.finish()
    return path


@pytest.mark.parametrize('other', [UNDEFINED, DAMAGED, UNREADABLE])
def test_twice_the_topics_take_twice_the_work(tmp_path, other):
    def read(path, count):
        with BagMessages([path]) as messages:
            assert messages.expected == count // 2
            assert len([*messages]) == count // 2
            lost = [each for each in messages.problems if 'cannot be read' in each]
            assert len(lost) == count // 2 or len(messages.left_out) == count // 2

    calls = []
    for count in (FEW, 2 * FEW):
        path = write_bag(tmp_path / f'{count}.mcap', count, (STRING, other))
        read(path, count)  # what is cached is made
        calls.append(calls_of(lambda path=path, count=count: read(path, count)))
    assert calls[1] < 2.3 * calls[0]
