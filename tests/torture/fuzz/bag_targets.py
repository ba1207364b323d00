# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: bags of every container, whole and damaged, and what is in them beside messages."""

from __future__ import annotations

import struct
from functools import cache
from typing import TYPE_CHECKING

import yaml
import zstandard
from mcap.writer import CompressionType

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.container_file import START_BYTES, size_of
from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.recover import recover

from .database_inputs import damaged, large_rows, logged, without_log
from .inputs import bag_bytes, found, own_bag, samples
from .ros1_inputs import ros1_bags
from .target import YAML_WORDS, Target, place, stored

from stored_messages import make_mcap  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

_MCAP = ('bags/mcap_reader.py', 'bags/chunked_file.py')  # fmt: skip
_SQLITE = ('bags/sqlite_reader.py', 'bags/sqlite_pages.py')  # fmt: skip
_ROS1 = ('bags/ros1_bag.py', 'bags/stored_messages.py', 'bags/chunked_file.py')  # fmt: skip
COMMON = ('bags/reader.py', 'bags/container_file.py', 'bags/bag_files.py',
          'bags/stored_messages.py', 'bags/decompression.py')  # fmt: skip


def read_bag(path: Path) -> None:
    """Read a bag as info, report and conversions do; what all share is opened once."""
    with OpenBag(path) as bag:
        _ = summarize_bag(bag).message_count
        bag.index.by_topic()
        with open_messages(bag) as messages:
            for message in messages:
                bytes(message.data[:4])
            _ = messages.losses, messages.problems, messages.expected, messages.complete


def reader(name: str):
    def run(data: bytes) -> None:
        read_bag(stored(name, data))

    return run


def _database(data: bytes) -> None:
    """Read a database; a reader that skims finds the same messages and the same damage.

    Of a large row it may read the start alone, and does not see the damage behind it.
    """
    path = stored('a.db3', data)
    read_bag(path)
    found = []
    for skims in (False, True):
        with open_messages(path) as messages:
            if skims:
                messages.skim(lambda _: True)
            stamps = [(each.topic, each.stamp_ns, size_of(each.data)) for each in messages]
            found.append((stamps, messages.problems))
    (whole, damage), (skimmed, seen) = found
    behind = [each for each in skimmed if each not in whole and each[2] > START_BYTES]
    assert [each for each in skimmed if each not in behind] == whole
    assert behind or seen == damage


def _logged(data: bytes) -> None:
    """Read a database that its recorder did not close."""
    database, log = without_log(data)
    path = stored('logged/a.db3', database)
    for ending in ('-shm', '-wal'):
        path.with_name(f'a.db3{ending}').unlink(missing_ok=True)
    stored('logged/a.db3-wal', log)
    read_bag(path)


def _metadata(data: bytes) -> None:
    folder = place('with_metadata/metadata.yaml').parent
    if not (folder / 'a_0.mcap').exists():
        (folder / 'a_0.mcap').write_bytes(small()[0])
    (folder / 'metadata.yaml').write_bytes(data)
    read_bag(folder)


def _packed(data: bytes) -> None:
    """Read a file that rosbag2 compressed: alone, and in a folder with and without metadata."""
    plain = place('packed/metadata.yaml')
    (plain.parent / 'a_0.mcap.zstd').write_bytes(data)
    read_bag(plain.parent / 'a_0.mcap.zstd')
    plain.unlink(missing_ok=True)
    read_bag(plain.parent)
    plain.write_bytes(_packed_metadata('file'))
    read_bag(plain.parent)


def _packed_messages(data: bytes) -> None:
    """Read a file whose messages rosbag2 compressed."""
    folder = place('packed_messages/metadata.yaml').parent
    (folder / 'a_0.mcap').write_bytes(data)
    (folder / 'metadata.yaml').write_bytes(_packed_metadata('message'))
    read_bag(folder)


@cache
def _packed_metadata(mode: str) -> bytes:
    values = yaml.safe_load(metadata_texts()[0])
    information = values['rosbag2_bagfile_information']
    information['compression_format'], information['compression_mode'] = 'zstd', mode
    name = 'a_0.mcap.zstd' if mode == 'file' else 'a_0.mcap'
    information['relative_file_paths'] = [name]
    information['files'][0]['path'] = name
    return yaml.safe_dump(values).encode()


def _packed_files() -> list[bytes]:
    packer = zstandard.ZstdCompressor()
    streamed = zstandard.ZstdCompressor(write_content_size=False)
    return [each.compress(data) for data in small() for each in (packer, streamed)]


def _with_packed_messages() -> list[bytes]:
    made = []
    for options in ({}, {'write_content_size': False}):
        packer = zstandard.ZstdCompressor(**options)
        packed = [(topic, kind, ns, packer.compress(data)) for topic, kind, ns, data in
                  (HELLO, IMAGE, HELLO)]  # fmt: skip
        made.append(make_mcap(packed))
    return made


def _recover(data: bytes) -> None:
    recover(stored('damaged', data), place('recovered.mcap'), overwrite=True)


HELLO = ('/t', 'std_msgs/msg/String', 10**18, b'\0\1\0\0\6\0\0\0hello\0')
IMAGE = ('/i', 'sensor_msgs/msg/CompressedImage', 2 * 10**18, b'\0\1\0\0' + bytes(40))


@cache
def small() -> list[bytes]:
    kinds = (
        {'compression': CompressionType.NONE},
        {'compression': CompressionType.ZSTD},
        {'compression': CompressionType.LZ4},
        {'compression': CompressionType.NONE, 'use_chunking': False},
        {'compression': CompressionType.NONE, 'chunk_size': 60},
    )
    return [make_mcap([HELLO, IMAGE, HELLO], **kind) for kind in kinds]


def _indexed() -> list[bytes]:
    return [*small(), *bag_bytes('a.mcap')]


def _unindexed() -> list[bytes]:
    """The same without an index, as a recorder leaves them that was killed."""
    return [data[:-30] for data in _indexed()] + [data[: len(data) * 2 // 3] for data in small()]


def _ros1_bags() -> list[bytes]:
    real = samples('kitti/bags/*.bag', lines=10**6)
    packed = [bag_bytes('a.bag', compression=each)[0] for each in ('bz2', 'lz4')]
    return [
        *bag_bytes('a.bag'),
        *packed,
        *ros1_bags(),
        *(each for each in real if len(each) < 39_000),
    ]


def _databases() -> list[bytes]:
    small = [each for each in found('sql/*.db3') if len(each) < 20_000]
    return [*bag_bytes('a'), *small, large_rows(), large_rows(4096), *damaged()]


def metadata_texts() -> list[bytes]:
    folder = own_bag('a')
    plain = (folder / 'metadata.yaml').read_bytes()
    values = yaml.safe_load(plain)
    information = values['rosbag2_bagfile_information']
    del information['topics_with_message_count'][2:]  # short texts are read fast
    information['relative_file_paths'] = ['a_0.mcap']
    information['storage_identifier'] = 'mcap'
    information['files'][0]['path'] = 'a_0.mcap'
    own = yaml.safe_dump(values).encode()
    for each in information['topics_with_message_count']:
        each['topic_metadata']['offered_qos_profiles'] = '- history: 1\n  depth: 9\n'
    plain_qos = yaml.safe_dump(values).encode()
    edits = ({'compression_mode': 'file', 'compression_format': 'lz4'},
             {'storage_identifier': 'x'}, {'relative_file_paths': ['b.mcap']},
             {'relative_file_paths': ['a_0.mcap', 'a' * 300, 'b']})  # fmt: skip
    edited = [
        yaml.safe_dump({'rosbag2_bagfile_information': information | each}).encode()
        for each in edits
    ]
    return [plain_qos, own, plain, *edited]


RECORD_WORDS = (
    *(b'\x89MCAP0\r\n', b'zstd', b'lz4', b'cdr', b'ros2msg', b'ros2idl', b'protobuf', b'json'),
    *(struct.pack('<BQ', kind, size) for kind in range(1, 16) for size in (0, 8, 2**40)),
)
_ROS1_WORDS = (
    *(b'op=', b'\x02', b'\x03', b'\x04', b'\x05', b'\x06', b'\x07', b'conn=', b'chunk_pos='),
    *(b'compression=', b'none', b'bz2', b'lz4', b'size=', b'topic=', b'#ROSBAG V2.0\n', b'time='),
)
_SQL_WORDS = (b'topics', b'messages', b'schema', b'metadata', b'CREATE VIEW', b'zeroblob(', b'\x0d',
              b'\x05', b'\x02', b'\x0a', b'INTEGER', b'BLOB')  # fmt: skip

TARGETS = (
    Target('mcap', reader('a.mcap'), _indexed, (*_MCAP, *COMMON), RECORD_WORDS, short=150),
    Target('mcap_without_index', reader('a.mcap'), _unindexed, (*_MCAP, *COMMON), RECORD_WORDS,
           short=150),
    Target('sqlite3', _database, _databases, (*_SQLITE, *COMMON), _SQL_WORDS, short=100),
    Target('sqlite3_log', _logged, logged, (*_SQLITE, *COMMON), _SQL_WORDS, short=20),
    Target('ros1', reader('a.bag'), _ros1_bags, (*_ROS1, *COMMON), _ROS1_WORDS, short=100),
    Target('packed', _packed, _packed_files, (*_MCAP, *COMMON, 'bags/locate.py'), (b'zstd',),
           short=40),
    Target('packed_messages', _packed_messages, _with_packed_messages,
           (*_MCAP, *COMMON, 'bags/locate.py'), RECORD_WORDS, short=40),
    Target('metadata', _metadata, metadata_texts, ('bags/locate.py',), YAML_WORDS, is_text=True,
           short=100, long=100_000),
    Target('recover', _recover,
           lambda: [*_indexed(), *_unindexed(), *_ros1_bags(), *_databases()],
           ('bags/recover.py',), short=30),
)  # fmt: skip
"""All of them."""
