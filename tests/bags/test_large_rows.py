# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Large messages of databases: the same as SQLite reads, however they are stored."""

from __future__ import annotations

import random
import sqlite3
import struct

import pytest
import zstandard

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.container_file import MessageStart, size_of
from kitti_ros2.bags.reader import open_messages

TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
    timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
"""
INSERT = 'INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)'
START_NS = 1_700_000_000 * 10**9
SHOWN = 1024
SIZES = (0, 1, 500, 4000, 4061, 4062, 65535, 65536, 65537, 80_000, 4092 * 40, 1_300_000, 2**22)


def blobs(count: int = 60) -> list[bytes]:
    rng = random.Random(3)
    sizes = [
        *SIZES,
        *(rng.choice((rng.randrange(2000), rng.randrange(400_000))) for _ in '1' * count),
    ]
    return [rng.randbytes(size) for size in sizes]


def database(path, *pragmas):
    connection = sqlite3.connect(path)
    for pragma in pragmas:
        connection.execute(f'PRAGMA {pragma}')
    connection.executescript(TABLES)
    row = ('/text', 'std_msgs/msg/String', 'cdr', '')
    connection.execute('INSERT INTO topics VALUES (1, ?, ?, ?, ?)', row)
    return connection


def read(path, since_ns=None):
    with open_messages(path) as messages:
        found = [(each.stamp_ns, bytes(each.data)) for each in messages.since(since_ns)]
        return found, messages.problems


def check_skimming(path, since_ns=None, *, whole=False):
    """A reader that skims finds the same messages, and the same damage if it reads all of them."""
    found, problems = read(path, since_ns)
    with OpenBag(path, whole_chunks=whole) as bag, open_messages(bag) as messages:
        messages.skim(lambda topic: topic == '/text')
        skimmed = [
            (each.stamp_ns, size_of(each.data), bytes(each.data[:SHOWN]))
            for each in messages.since(since_ns)
        ]
        assert skimmed == [(stamp_ns, len(data), data[:SHOWN]) for stamp_ns, data in found]
        assert messages.problems == problems


def write(connection, data):
    rows = [(START_NS + place, each) for place, each in enumerate(data)]
    with connection:
        connection.executemany(INSERT, rows)
    return rows


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'pragmas', [(), ('page_size=512',), ('page_size=65536',), ('auto_vacuum=FULL',)]
)
def test_large_rows_are_read_whole(pragmas, tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path, *pragmas)
    rows = write(connection, blobs())
    connection.close()
    assert read(path) == (rows, ())
    assert read(path, START_NS + 30)[0] == rows[30:]
    check_skimming(path)
    check_skimming(path, START_NS + 30)


def test_rows_in_pieces_are_read_whole(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path, 'page_size=1024')
    filler = blobs(100)
    write(connection, filler)
    with connection:  # every other row leaves a hole, which later rows fill
        connection.execute('DELETE FROM messages WHERE id % 2')
        connection.executemany(INSERT, [(1, bytes(each % 3000)) for each in range(500)])
        connection.execute('DELETE FROM messages WHERE length(data) < 3000 AND id % 3 = 1')
    write(connection, blobs(50))
    expected = connection.execute('SELECT timestamp, data FROM messages ORDER BY 1, id').fetchall()
    connection.close()
    assert read(path)[0] == expected
    check_skimming(path)


def test_rows_out_of_time_order(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path)
    rows = [(START_NS - place, each) for place, each in enumerate(blobs())]
    with connection:
        connection.executemany(INSERT, rows)
    connection.close()
    assert read(path) == (rows[::-1], ())
    check_skimming(path)


def test_rows_of_a_log_come_from_sqlite(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path, 'journal_mode=WAL', 'wal_autocheckpoint=0')
    rows = write(connection, blobs(5))
    assert read(path)[0] == rows
    check_skimming(path)
    connection.close()


def test_a_damaged_chain_is_read_as_sqlite_reads_it(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path)
    data = blobs(0)[-3:]
    rows = write(connection, [*data, *data])
    connection.close()
    sound = path.read_bytes()
    broken = {}
    for place, link in ((1, 0), (1, 1), (200, 7), (1, 2**31), (900, 0)):
        at = place * 4096 + (sound.index(data[1][2**19 : 2**19 + 64]) // 4096) * 4096
        number = struct.pack('>I', link)
        path.write_bytes(sound[:at] + number + sound[at + 4 :])
        connection = sqlite3.connect(path)
        expected, failed = [], False
        for row_id in range(1, 7):
            try:
                query = 'SELECT timestamp, data FROM messages WHERE id = ?'
                expected.append(connection.execute(query, [row_id]).fetchone())
            except sqlite3.Error:
                failed = True
        connection.close()
        found, problems = read(path)
        broken[place, link] = found != rows
        assert found == expected
        assert bool(problems) == failed
        check_skimming(path, whole=True)
    assert any(broken.values())


def test_of_large_messages_the_start_may_do(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path)
    rows = write(connection, [b'a' * 100, b'b' * 2**16, bytes(range(256)) * 5000])
    connection.close()
    with open_messages(path) as messages:
        messages.skim(lambda _: True)
        found = [each.data for each in messages]
    assert [type(each) for each in found] == [bytes, MessageStart, MessageStart]
    assert [size_of(each) for each in found] == [len(data) for _, data in rows]
    for start, (_, data) in zip(found[1:], rows[1:], strict=True):
        assert data.startswith(start)
        assert 1024 <= len(start) < 2**14
    with open_messages(path) as messages:  # another reader of the same file
        assert all(type(each.data) is not MessageStart for each in messages)


def test_what_rosbag2_compressed_is_read_whole(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path)
    data = random.Random(2).randbytes(2**17)
    write(connection, [zstandard.compress(data)])
    connection.close()
    with open_messages(path) as messages:
        messages.skim(lambda _: True)
        assert [bytes(each.data) for each in messages] == [data]


def several(path, count=20, size=150_000):
    connection = database(path)
    rows = write(connection, [random.Random(number).randbytes(size) for number in range(count)])
    connection.close()
    return rows


def test_what_is_needed_whole_at_its_turn_is_read_whole(tmp_path):
    rows = several(tmp_path / 'bag.db3')
    path = tmp_path / 'bag.db3'
    taken = 0
    with open_messages(path) as messages:
        messages.skim(lambda _: taken < 7)
        for message, (_, data) in zip(messages, rows, strict=True):
            taken += 1
            assert (bytes(message.data) == data) == (taken > 7)
