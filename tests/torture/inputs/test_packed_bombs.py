# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a small file may hold: topics, types, their texts, and messages.

Its size is that on the disk, where rosbag2 may have compressed all of it.
"""

import io
import sqlite3
import struct
import tracemalloc
from contextlib import closing, contextmanager

import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from test_memory_of_topics import CDR, START_NS, WRITERS, create_tables, write_sqlite3

from kitti_ros2.bags import sqlite_pages
from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.container_file import FileBytes
from kitti_ros2.bags.decompression import LARGEST_BLOCK
from kitti_ros2.bags.mcap_reader import McapFormat
from kitti_ros2.bags.mcap_writer import MAGIC
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.sqlite_pages import LEAF
from kitti_ros2.bags.sqlite_reader import SqliteFile
from kitti_ros2.model.errors import BadBagError

MB = 10**6
MOST = 300  # in place of the numbers that any file may have
MORE = MOST + 50


def pack(path):
    """Compress a file as rosbag2 does."""
    packed = path.with_name(f'{path.name}.zstd')
    packed.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
    path.unlink()
    return packed


def read(path):
    """Return the number of messages and the losses of a bag."""
    with open_messages(path) as reader:
        return sum(1 for _ in reader), reader.losses


@contextmanager
def results_of(owner, name):
    """A list of what each call of a function returns while the block runs."""
    results = []
    function = getattr(owner, name)

    def recorded(*args):
        results.append(function(*args))
        return results[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, name, recorded)
        yield results


@pytest.mark.parametrize('is_packed', [False, True], ids=['as it is', 'compressed as a whole'])
@pytest.mark.parametrize('suffix', WRITERS)
def test_topics_are_bounded(suffix, is_packed, tmp_path, monkeypatch):
    monkeypatch.setattr('kitti_ros2.bags.decompression._DESCRIPTIONS_ALWAYS', MOST)
    monkeypatch.setattr('kitti_ros2.bags.decompression._BYTES_PER_DESCRIPTION', 10**9)
    path = tmp_path / f'bag{suffix}'
    WRITERS[suffix](path, MORE)
    if is_packed:
        path = pack(path)
    what = f'describe more than {MOST} topics and types; {LARGEST_BLOCK}=SIZE'
    if suffix == '.db3':
        with pytest.raises(BadBagError, match=what):
            open_messages(path)
    else:
        found, losses = read(path)
        (lost,) = [count for text, count in losses.items() if what in text]
        assert found + lost == MORE
        assert lost >= MORE - MOST
    monkeypatch.setenv(LARGEST_BLOCK, '1GB')
    found, losses = read(path)
    assert found == MORE
    assert not [text for text in losses if 'topics and types' in text]


def write_plain_mcap(path, count):
    """An MCAP file of messages outside of chunks, whose recorder did not close it."""
    data = io.BytesIO()
    writer = Writer(data, use_chunking=False)
    writer.start('ros2', 'a recorder')
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channel = writer.register_channel('/a', 'cdr', schema)
    for number in range(count):
        writer.add_message(channel, START_NS + number, CDR, START_NS + number)
    path.write_bytes(data.getvalue())


def write_rows(path, count):
    write_sqlite3(path, 1)
    with closing(sqlite3.connect(path)) as database:
        rows = ((1, START_NS + number, CDR) for number in range(1, count))
        database.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows
        )
        database.commit()


def cut(path):
    """Cut the end off a database, so that its pages are searched."""
    path.write_bytes(path.read_bytes()[:-1])


@pytest.mark.parametrize('make', ['mcap', 'rows', 'pages'])
def test_messages_are_bounded_by_the_size_on_the_disk(make, tmp_path, monkeypatch):
    monkeypatch.setattr('kitti_ros2.bags.decompression._RECORDS_ALWAYS', MOST)
    if make == 'mcap':
        path = tmp_path / 'a.mcap'
        write_plain_mcap(path, 30_000)
    else:
        path = tmp_path / 'a.db3'
        write_rows(path, 30_000)
        if make == 'pages':
            cut(path)
    assert read(path)[0] > 29_000
    path = pack(path)
    assert path.stat().st_size < 300_000
    what = f'hold more than [0-9]+ records; {LARGEST_BLOCK}=SIZE'
    if make == 'mcap':
        found, losses = read(path)
        assert found < 30_000
        assert any('records' in text and 'what follows is not read' in text for text in losses)
    else:
        with pytest.raises(BadBagError, match=what):
            open_messages(path)
    monkeypatch.setenv(LARGEST_BLOCK, '100GB')
    assert read(path)[0] > 29_000


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_the_texts_of_types_are_bounded(suffix, tmp_path):
    path = tmp_path / f'a{suffix}'
    text = '# a comment\n' * (MB // 12) + 'string data'
    if suffix == '.mcap':
        with path.open('wb') as file:
            writer = Writer(file, repeat_schemas=False, repeat_channels=False)
            writer.start('ros2', 'a recorder')
            for number in range(60):
                schema = writer.register_schema(f'a/msg/A{number}', 'ros2msg', text.encode())
                channel = writer.register_channel(f'/t{number}', 'cdr', schema)
                writer.add_message(channel, START_NS, CDR, START_NS)
            writer.finish()
    else:
        write_sqlite3(path, 2)
        with closing(sqlite3.connect(path)) as database:
            database.execute(
                'CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT,'
                ' encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT)'
            )
            database.executemany(
                'INSERT INTO message_definitions VALUES (?, ?, ?, ?, ?)',
                ((number, f'a/msg/A{number}', 'ros2msg', text, '') for number in range(60)),
            )
            database.commit()
        path = pack(path)
    assert path.stat().st_size < 300_000
    tracemalloc.start()
    what = 'describe topics and types by more than 16.0 MB'
    if suffix == '.mcap':
        assert any(what in text for text in read(path)[1])
    else:
        with pytest.raises(BadBagError, match=what):
            open_messages(path)
    assert tracemalloc.get_traced_memory()[1] < 100 * MB
    tracemalloc.stop()


def test_a_log_beside_a_small_database_counts(tmp_path, monkeypatch):
    monkeypatch.setattr('kitti_ros2.bags.decompression._RECORDS_ALWAYS', MOST)
    monkeypatch.setattr('kitti_ros2.bags.decompression._DESCRIPTIONS_ALWAYS', MOST)
    path = tmp_path / 'a.db3'
    with closing(sqlite3.connect(path)) as database:
        database.execute('PRAGMA journal_mode = WAL')
        database.execute('PRAGMA wal_autocheckpoint = 0')
        database.execute('CREATE TABLE a(id INTEGER)')
        database.commit()
        database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        database.execute('DROP TABLE a')
        create_tables(database)
        database.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr', '')")
        rows = ((1, START_NS + number, CDR) for number in range(10_000))
        database.executemany(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows
        )
        database.commit()
        assert path.stat().st_size < 10_000
        assert read(path)[0] == 10_000


@pytest.mark.parametrize('kind', ['a file', 'a chunk'])
@pytest.mark.parametrize('unit', [b'\1\5\3', b'\5' * 6 + bytes(3)], ids=['nothing', 'heads'])
def test_the_search_of_damaged_bytes_is_bounded(unit, kind, tmp_path):
    damaged = unit * (60 * MB // len(unit))
    path = tmp_path / 'a.mcap'
    if kind == 'a file':
        path.write_bytes(MAGIC + damaged)
        path = pack(path)
    else:
        with path.open('wb') as file:
            writer = Writer(file, compression=CompressionType.ZSTD, repeat_channels=False)
            writer.start('ros2', 'a recorder')
            schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
            channel = writer.register_channel('/a', 'cdr', schema)
            writer.add_message(channel, START_NS, CDR, START_NS)
            writer.finish()
        packed = zstandard.ZstdCompressor().compress(damaged)
        chunk = struct.pack('<QQQII', 0, 0, len(damaged), 0, 4) + b'zstd'
        chunk += struct.pack('<Q', len(packed)) + packed
        data = path.read_bytes()
        end = data.index(b'\x0f' + struct.pack('<Q', 4))  # of the data section
        path.write_bytes(data[:end] + struct.pack('<BQ', 6, len(chunk)) + chunk)
    assert path.stat().st_size < 10_000
    with results_of(McapFormat, 'classify') as calls:
        found, losses = read(path)
    assert len(calls) < 400_000
    assert any('too many damaged bytes to search' in text for text in losses)
    assert found == (kind == 'a chunk')


def test_cells_that_lead_to_the_same_long_row_are_bounded(tmp_path):
    count, head = 15_000, 30_000
    page = bytearray(2**16)
    page[:18] = b'SQLite format 3\0\0\1'
    page[24:28] = page[92:96] = struct.pack('>I', 1)
    page[28:32] = struct.pack('>I', 1)
    page[100], page[103:105] = LEAF, struct.pack('>H', count)
    at = 108 + 2 * count
    page[108:at] = struct.pack('>H', at) * count
    long = bytes([0x80, 0x80 | head >> 7, head & 0x7F])
    page[at : at + 7] = long + b'\1' + long
    path = tmp_path / 'a.db3'
    path.write_bytes(page)
    with results_of(sqlite_pages, 'parse_varint') as parsed, pytest.raises(BadBagError):
        open_messages(path)
    assert len(parsed) <= 10 * count


def test_pages_are_searched_for_single_rows_within_the_limits(tmp_path, monkeypatch):
    monkeypatch.setattr('kitti_ros2.bags.decompression._RECORDS_ALWAYS', MOST)
    monkeypatch.setattr(SqliteFile, '_in_one_query', lambda *_: iter(()))
    path = tmp_path / 'a.db3'
    write_rows(path, MOST - 1)
    assert read(path)[0] == MOST - 1
    with closing(sqlite3.connect(path)) as database:
        database.execute('CREATE TABLE other(id INTEGER PRIMARY KEY, number INTEGER)')
        rows = ((number,) for number in range(20_000))
        database.executemany('INSERT INTO other(number) VALUES (?)', rows)
        database.commit()
    assert read(path)[0] == MOST - 1
    found, losses = read(pack(path))
    refused = [text for text in losses if 'no more rows are read' in text]
    assert len(refused) == 1
    rows_lost = [text for text in losses if 'cannot be read' in text]
    assert found + len(rows_lost) == MOST - 1


def claim_all_indexes(data):
    """Let each chunk of an MCAP file claim the indexes of all chunks behind it as its own."""
    data = bytearray(data)
    reader = make_reader(io.BytesIO(data))
    summary = reader.get_summary()
    ends = [
        each.chunk_start_offset + each.chunk_length + each.message_index_length
        for each in summary.chunk_indexes
    ]
    for each in summary.chunk_indexes:
        start = each.chunk_start_offset + each.chunk_length
        own = struct.pack('<QQ', each.chunk_start_offset, each.chunk_length)
        body = data.rindex(own) - 16
        (channels_size,) = struct.unpack_from('<I', data, body + 32)
        struct.pack_into('<Q', data, body + 36 + channels_size, max(ends) - start)
        struct.pack_into('<Q', data, body + 38, max(ends) - 31)  # of the channel: the last of them
    return bytes(data)


def test_the_indexes_of_chunks_are_read_once_each(tmp_path):
    data = io.BytesIO()
    writer = Writer(data, chunk_size=1, compression=CompressionType.NONE, enable_crcs=False)
    writer.start('ros2', 'a recorder')
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channel = writer.register_channel('/a', 'cdr', schema)
    for number in range(500):
        writer.add_message(channel, START_NS + number, CDR, START_NS + number)
    writer.finish()
    path = tmp_path / 'a.mcap'
    path.write_bytes(claim_all_indexes(data.getvalue()))
    with results_of(FileBytes, 'read') as blocks, OpenBag(path) as bag:
        assert bag.index.total == 500
    assert sum(map(len, blocks)) < 10 * path.stat().st_size
