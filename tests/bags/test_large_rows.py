# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Large messages of databases, read past SQLite: the same as it reads, however they are stored."""

from __future__ import annotations

import errno
import random
import sqlite3
import struct
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import zstandard

from kitti_ros2.bags import sqlite_pages, sqlite_reader
from kitti_ros2.bags.container_file import FileBytes, MessageStart, NamedFile, size_of
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.sqlite_pages import Pages, TableTree
from kitti_ros2.files import threads as workers_module

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


@pytest.fixture(autouse=True, params=[1, 3], ids='workers={}'.format)
def workers(request, monkeypatch):
    """Read in turn, and by threads in small batches."""
    monkeypatch.setattr(workers_module, 'worker_count', lambda: request.param)
    monkeypatch.setattr(sqlite_reader, '_LEAST_AHEAD', 2**16)
    monkeypatch.setattr(sqlite_reader, '_BATCH_BYTES', 2**18)
    return request.param


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
        return found, messages.findings


def check_skimming(path, since_ns=None):
    """A reader that skims finds the same messages and the same damage."""
    found, findings = read(path, since_ns)
    with open_messages(path) as messages:
        messages.skim(lambda topic: topic == '/text')
        skimmed = [
            (each.stamp_ns, size_of(each.data), bytes(each.data[:SHOWN]))
            for each in messages.since(since_ns)
        ]
        assert skimmed == [(stamp_ns, len(data), data[:SHOWN]) for stamp_ns, data in found]
        assert messages.findings == findings


@pytest.fixture
def outcomes(monkeypatch):
    """How each large row was read: its size, or None where SQLite had to."""
    found = []
    blob = TableTree.blob

    def spy(tree, row_id, size):
        found.append(None)
        data = blob(tree, row_id, size)
        found[-1] = len(data)
        return data

    monkeypatch.setattr(TableTree, 'blob', spy)
    return found


def write(connection, data):
    rows = [(START_NS + place, each) for place, each in enumerate(data)]
    with connection:
        connection.executemany(INSERT, rows)
    return rows


@pytest.mark.parametrize(
    'pragmas', [(), ('page_size=512',), ('page_size=65536',), ('auto_vacuum=FULL',)]
)
def test_large_rows_are_read_whole(pragmas, tmp_path, outcomes):
    path = tmp_path / 'bag.db3'
    connection = database(path, *pragmas)
    rows = write(connection, blobs())
    connection.close()
    assert read(path) == (rows, ())
    assert outcomes == [len(data) for _, data in rows if len(data) >= 2**16]
    assert read(path, START_NS + 30)[0] == rows[30:]
    check_skimming(path)
    check_skimming(path, START_NS + 30)


def test_rows_in_pieces_are_read_whole(tmp_path, outcomes):
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
    assert outcomes == [len(data) for _, data in expected if len(data) >= 2**16]
    check_skimming(path)


def test_small_blocks_change_nothing(tmp_path, outcomes, monkeypatch):
    monkeypatch.setattr(sqlite_pages, '_BLOCK', 3 * 4096)
    monkeypatch.setattr(sqlite_pages, '_SKIMMED_BLOCK', 3 * 4096)
    monkeypatch.setattr(sqlite_pages, '_KEPT', 1)
    test_rows_in_pieces_are_read_whole(tmp_path, outcomes)


def test_rows_out_of_time_order(tmp_path, outcomes):
    path = tmp_path / 'bag.db3'
    connection = database(path)
    rows = [(START_NS - place, each) for place, each in enumerate(blobs())]
    with connection:
        connection.executemany(INSERT, rows)
    connection.close()
    assert read(path) == (rows[::-1], ())
    assert None not in outcomes
    check_skimming(path)


def test_rows_of_a_log_come_from_sqlite(tmp_path, outcomes):
    path = tmp_path / 'bag.db3'
    connection = database(path, 'journal_mode=WAL', 'wal_autocheckpoint=0')
    rows = write(connection, blobs(5))
    assert read(path)[0] == rows
    assert not outcomes
    check_skimming(path)
    connection.close()


def test_a_damaged_chain_is_read_as_sqlite_reads_it(tmp_path, outcomes):
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
        found, findings = read(path)
        broken[place, link] = found != rows
        assert found == expected
        assert bool(findings) == failed
        check_skimming(path)
    assert any(broken.values())
    assert None in outcomes


def test_noise_in_the_tree_raises_value_errors_only(tmp_path):
    path = tmp_path / 'bag.db3'
    connection = database(path, 'page_size=512')
    rows = write(connection, blobs())
    (root,) = connection.execute(
        "SELECT rootpage FROM sqlite_master WHERE name='messages'"
    ).fetchone()
    connection.close()
    sound = path.read_bytes()
    rng = random.Random(4)
    ids = [place + 1 for place, (_, data) in enumerate(rows) if len(data) >= 2**16]
    failed = 0
    for turn in range(60):
        noisy = bytearray(sound)
        for _ in range(40):
            page = root - 1 if turn % 2 else rng.randrange(root, len(noisy) // 512)
            noisy[page * 512 + rng.randrange(512)] = rng.randrange(256)
        path.write_bytes(noisy[: rng.choice((len(noisy), len(noisy) // 2))])
        file = FileBytes(NamedFile(path, path))
        tree = TableTree(file, Pages(file), root)
        for row_id in ids:
            try:
                data = tree.blob(row_id, len(rows[row_id - 1][1]))
            except ValueError:
                failed += 1
            else:
                assert len(data) == len(rows[row_id - 1][1])
        file.close()
    assert failed


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


def skimmed(path, is_enough=lambda _: True):
    with open_messages(path) as messages:
        messages.skim(is_enough)
        found = [(each.stamp_ns, size_of(each.data), bytes(each.data[:SHOWN])) for each in messages]
        return found, messages.findings


@pytest.fixture
def readers(monkeypatch):
    """The thread that read each start."""
    seen = []
    start = TableTree.start

    def spy(tree, row_id, size):
        seen.append(threading.current_thread())
        return start(tree, row_id, size)

    monkeypatch.setattr(TableTree, 'start', spy)
    return seen


def test_threads_read_starts_and_the_first_in_turn(tmp_path, readers, workers):
    rows = several(tmp_path / 'bag.db3')
    found, _ = skimmed(tmp_path / 'bag.db3')
    assert found == [(stamp_ns, len(data), data[:SHOWN]) for stamp_ns, data in rows]
    assert len(readers) == len(rows)
    in_turn = readers.count(threading.main_thread())
    assert in_turn == (len(rows) if workers == 1 else 1)


def test_what_is_needed_whole_at_its_turn_is_read_whole(tmp_path):
    rows = several(tmp_path / 'bag.db3')
    path = tmp_path / 'bag.db3'
    taken = 0
    with open_messages(path) as messages:
        messages.skim(lambda _: taken < 7)
        for message, (_, data) in zip(messages, rows, strict=True):
            taken += 1
            assert (bytes(message.data) == data) == (taken > 7)


@pytest.mark.parametrize('in_threads_only', [True, False])
def test_a_disk_that_refuses(in_threads_only, tmp_path, monkeypatch, workers):
    path = tmp_path / 'bag.db3'
    rows = several(path)
    expected = skimmed(path)
    read_into = FileBytes.read_into
    failures = []

    def fail(file, position, target):
        is_main = threading.current_thread() is threading.main_thread()
        if position > 500_000 and not (is_main and in_threads_only):
            failures.append(position)
            raise OSError(errno.EIO, 'the disk refuses', str(file.name))
        return read_into(file, position, target)

    monkeypatch.setattr(FileBytes, 'read_into', fail)
    if in_threads_only:
        assert skimmed(path) == expected
        assert bool(failures) == (workers > 1)
        assert len(expected[0]) == len(rows)
        return
    with pytest.raises(OSError, match=r'the disk refuses.*bag\.db3'):
        skimmed(path)


def test_a_system_without_threads_reads_all(tmp_path, monkeypatch):
    several(tmp_path / 'bag.db3')
    expected = skimmed(tmp_path / 'bag.db3')

    def refuse(*_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(ThreadPoolExecutor, 'submit', refuse)
    assert skimmed(tmp_path / 'bag.db3') == expected


def test_who_stops_early_leaves_no_thread(tmp_path, readers):
    several(tmp_path / 'bag.db3')
    before = threading.active_count()
    with open_messages(tmp_path / 'bag.db3') as messages:
        messages.skim(lambda _: True)
        found = messages.since(None)
        next(found)
        assert len(readers) == 1
        for _ in range(8):
            next(found)
        found.close()
        assert threading.active_count() == before
    assert len(readers) < 20
