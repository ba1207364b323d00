# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Of a bag of as many topics as MCAP can number, memory stays within 100 MB and 20 times its size.

Two smaller bags tell what each topic costs.
"""

from __future__ import annotations

import sqlite3
import tracemalloc
from contextlib import closing

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Ros1Writer

from kitti_ros2.bags.recover import recover
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.report.gather import gather

FEW, MANY, MOST = 500, 2500, 2**16
START_NS = 10**18
CDR, ROS1 = b'\0\1\0\0\2\0\0\0a\0', b'\1\0\0\0a'


def write_mcap(path, count):
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'a recorder')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        for number in range(count):
            channel = writer.register_channel(f'/t{number}', 'cdr', schema)
            stamp_ns = START_NS + number
            writer.add_message(channel, stamp_ns, CDR, stamp_ns)
        writer.finish()


def create_tables(database):
    database.execute(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,'
        ' serialization_format TEXT, offered_qos_profiles TEXT)'
    )
    database.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,'
        ' data BLOB)'
    )


def write_sqlite3(path, count):
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as database:
        create_tables(database)
        numbers = range(1, count + 1)
        topics = ((number, f'/t{number}') for number in numbers)
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, 'std_msgs/msg/String', 'cdr', '')", topics
        )
        rows = ((number, START_NS + number, CDR) for number in numbers)
        database.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows
        )
        database.commit()


def write_ros1(path, count):
    path.unlink(missing_ok=True)
    with Ros1Writer(path) as writer:
        for number in range(count):
            connection = writer.add_connection(
                f'/t{number}',
                'std_msgs/msg/String',
                msgdef='string data\n',
                md5sum='992ce8a1687cec8c8bd883ec73ca41d1',
            )
            writer.write(connection, START_NS + number, ROS1)


WRITERS = {'.mcap': write_mcap, '.db3': write_sqlite3, '.bag': write_ros1}
COMMANDS = {
    'recover': lambda path, folder: recover(path, folder / 'out.mcap', overwrite=True),
    'report': lambda path, _: gather(path, ReadOptions()),
}


@pytest.mark.parametrize('command', COMMANDS)
@pytest.mark.parametrize('suffix', WRITERS)
def test_memory_for_each_topic(suffix, command, tmp_path):
    path = tmp_path / f'bag{suffix}'
    sizes, peaks = [], []
    for count in (FEW, FEW, MANY):  # the first fills what is kept for all bags
        WRITERS[suffix](path, count)
        sizes.append(path.stat().st_size)
        tracemalloc.start()
        COMMANDS[command](path, tmp_path)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    a_topic = (peaks[-1] - peaks[-2]) / (MANY - FEW)
    its_bytes = (sizes[-1] - sizes[-2]) / (MANY - FEW)
    assert a_topic * MOST < 100e6 + 20 * its_bytes * MOST
