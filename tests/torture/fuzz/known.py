# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs that broke a target once, made here: no file of KITTI is needed."""

from __future__ import annotations

import bz2
import json
import sqlite3
import struct
import zlib
from contextlib import closing
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING

import zstandard
from lz4 import frame as lz4_frame
from mcap.writer import CompressionType, Writer

from kitti_ros2.bags.reader import BagMessages
from kitti_ros2.model.streams import Layout

from .database_inputs import endless
from .inputs import files, own_bag
from .ros1_inputs import ros1_record
from .target import place

if TYPE_CHECKING:
    from collections.abc import Callable

_BOMB_BYTES = 150_000_000
_MAGIC = b'\x89MCAP0\r\n'
_DATA_END, _FOOTER = 15, 2


def _text(value: bytes) -> bytes:
    return struct.pack('<I', len(value)) + value


def _record(kind: int, body: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(body)) + body


def _mcap_chunk(name: bytes, data: bytes, declared: int) -> bytes:
    """An MCAP file with a chunk that states a size."""
    head = struct.pack('<QQQI', 1, 1, declared, 0) + _text(name) + struct.pack('<Q', len(data))
    records = _record(1, _text(b'ros2') + _text(b'')) + _record(6, head + data)
    ending = _record(_DATA_END, bytes(4)) + _record(_FOOTER, bytes(20))
    return _MAGIC + records + ending + _MAGIC


@cache
def _chunk_bombs() -> list[bytes]:
    zeros = bytes(_BOMB_BYTES)
    packed = {
        b'zstd': [
            zstandard.ZstdCompressor().compress(zeros),
            zstandard.ZstdCompressor(write_content_size=False).compress(zeros),
        ],
        b'lz4': [lz4_frame.compress(zeros)],
    }
    return [
        _mcap_chunk(name, data, declared)
        for name, each in packed.items()
        for data in each
        for declared in (0, 1000, _BOMB_BYTES)
    ]


@cache
def _cut_bombs() -> list[bytes]:
    """Chunks without an end, and what they may become."""
    packed = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(_BOMB_BYTES))
    whole = [_mcap_chunk(b'zstd', packed, declared) for declared in (0, _BOMB_BYTES)]
    return [each[: each.index(packed) + len(packed) - 100] for each in whole]


def _short_messages() -> list[bytes]:
    """A chunk with messages that are shorter than their head."""
    schema = struct.pack('<H', 1) + _text(b'std_msgs/msg/String') + _text(b'ros2msg')
    channel = struct.pack('<HH', 1, 1) + _text(b'/t') + _text(b'cdr') + _text(b'')
    described = _record(3, schema + _text(b'string data')) + _record(4, channel)
    whole = _record(5, struct.pack('<HIQQ', 1, 0, 7, 7) + b'\0\1\0\0\1\0\0\0\0')
    return [
        _mcap_chunk(b'', data, len(data))
        for size in (0, 2, 21)
        for data in (described + whole + _record(5, bytes(size)) + whole,)
    ]


def _endless_chunks() -> list[bytes]:
    """A file that ends in a chunk of terabytes, or of more bytes than a number of C counts."""
    start = _MAGIC + _record(1, _text(b'ros2') + _text(b''))
    return [
        start + struct.pack('<BQ', 6, length) + b'\x90' * 2
        for length in (2**40, 2**47, 2**63 - 1, 2**63, 2**64 - 1)
    ]


def _message_bomb() -> list[bytes]:
    """A message that is compressed on its own."""
    target = BytesIO()
    writer = Writer(target, compression=CompressionType.NONE)
    writer.start(profile='ros2')
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channel = writer.register_channel('/t', 'cdr', schema)
    writer.add_message(channel, 1, zstandard.ZstdCompressor().compress(bytes(_BOMB_BYTES)), 1)
    writer.finish()
    return [target.getvalue()]


def _ros1_bomb() -> list[bytes]:
    data = bz2.compress(bytes(_BOMB_BYTES))
    made = []
    for declared in (1000, 2**32 - 1):
        chunk = {b'op': b'\5', b'compression': b'bz2', b'size': struct.pack('<I', declared)}
        head = {b'op': b'\3', b'index_pos': bytes(8), b'conn_count': bytes(4)}
        head[b'chunk_count'] = struct.pack('<I', 1)
        start = b'#ROSBAG V2.0\n' + ros1_record(head, b' ' * 100)
        made.append(start + ros1_record(chunk, data))
    return made


def _ros1_lengths() -> list[bytes]:
    """A bag of ROS 1 with a message that states billions of markers."""
    path = own_bag('a.bag')
    with BagMessages([path], as_stored=True) as messages:
        stored = next(bytes(each.data) for each in messages if each.topic.endswith('/markers'))
    data = path.read_bytes()
    at = data.index(stored)
    return [
        data[:at] + struct.pack('<I', length) + data[at + 4 :]
        for length in (2**24, 2**31 - 1, 2**32 - 1)
    ]


def _ros1_chunk_info() -> list[bytes]:
    """Bags of ROS 1 whose index counts the messages of a chunk in too few bytes."""
    data = own_bag('a.bag').read_bytes()
    at = data.index(b'\4\0\0\0op=\6')
    size_at = at + struct.unpack_from('<I', data, at - 4)[0]
    (size,) = struct.unpack_from('<I', data, size_at)
    return [
        data[:size_at] + struct.pack('<I', size - fewer) + data[size_at + 4 :] for fewer in (3, 8)
    ]


def _chunk(kind: bytes, body: bytes, length: int | None = None) -> bytes:
    size = len(body) if length is None else length
    return struct.pack('>I', size) + kind + body + struct.pack('>I', zlib.crc32(kind + body))


def _pngs() -> list[bytes]:
    """A chunk longer than its file, and pixels that inflate to more than the image has."""
    png = files('image_2/*.png', Layout.OBJECT, most=1)[0]
    at = png.index(b'IDAT') - 4
    head, ending = png[:at], _chunk(b'IEND', b'')
    bomb = zlib.compress(bytes(_BOMB_BYTES // 2))
    wide = png[:16] + struct.pack('>II', 2**31 - 1, 2**31 - 1) + png[24:29]
    return [
        head + _chunk(b'IDAT', b'x' * 50, length)[:-4] + ending for length in (2**31, 2**32 - 9)
    ] + [
        head + _chunk(b'IDAT', bomb) + ending,
        wide + struct.pack('>I', zlib.crc32(wide[12:])) + png[33:],
    ]


@cache
def _many_types() -> list[bytes]:
    """A type of its own for each of thousands of topics."""
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start('ros2', 'fuzz')
    for number in range(4000):
        schema = writer.register_schema(f'a_msgs/msg/T{number}', 'ros2msg', b'string text')
        channel = writer.register_channel(f'/{number}', 'cdr', schema)
        writer.add_message(channel, number, b'\0\1\0\0\1\0\0\0\0', number)
    writer.finish()
    return [file.getvalue()]


def _databases() -> list[bytes]:
    """Views, computed columns and large values in place of what a bag stores."""
    topics = (
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format'
        ' TEXT, offered_qos_profiles TEXT)'
    )
    endless = 'WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r)'
    a_topic = "INSERT INTO topics VALUES (1, '/t', 'std_msgs/msg/String', 'cdr', '')"
    columns = 'id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER'
    stored = f'CREATE TABLE messages({columns}, data BLOB)'
    numbers = f'{endless} SELECT n id, 1 topic_id, n timestamp, zeroblob(9) data FROM r'
    names = f"{endless} SELECT n id, '/t' name, 'a/B' type, 'cdr' serialization_format FROM r"
    computed = stored.replace('BLOB', 'BLOB AS (zeroblob(999999999))')
    a_message = 'INSERT INTO messages(id, topic_id, timestamp) VALUES (1, 1, 1)'
    scripts = (
        f'{topics}; {a_topic}; CREATE VIEW messages AS {numbers}',
        f'{stored}; CREATE VIEW topics AS {names}',
        f'{topics}; {a_topic}; {computed}; {a_message}',
    )
    made = []
    for script in scripts:
        path = place('made.db3')
        path.unlink(missing_ok=True)
        with closing(sqlite3.connect(path, isolation_level=None)) as database:
            database.executescript(script)
        made.append(path.read_bytes())
    return [*made, made[0][:100]]  # a head alone, too


def _circles() -> list[bytes]:
    """Rows of any size whose pages follow each other in a circle."""
    return [endless(size) for size in (70_000, 900_000_000, 2**40)]


def _file_numbers() -> list[bytes]:
    """A description of a billion files, in a String."""
    spans = [[first, first + 999_999] for first in range(0, 10**9, 10**6)]
    folder = {'folder': 'a', 'digits': 12, 'suffix': '.bin', 'numbers': spans}
    values = {'layout': 'object', 'name': 'a', 'epoch_ns': 0, 'files': {'scan': folder}}
    return [b'\0\1\0\0' + _text(json.dumps(values).encode() + b'\0')]


def _yaml_tags() -> list[bytes]:
    return [b"a: !!float ''\n", b'!!bool x\n', b'- !!timestamp x\n', b"!!int ''\n"]


def _yaml_numbers() -> list[bytes]:
    """Numbers to other bases, which Python cannot write as text, or makes no float of."""
    numbers = (b'0x' + b'f' * 4000, b'1' + b':59' * 2600, b'1' + b':59' * 300 + b'.5')
    return [name + number for name in (b'layout: ', b'start: ') for number in numbers]


def _large_numbers() -> list[bytes]:
    beyond_float = b'view range\n-1e308,1e308,3,4'
    return [b'split ratio\n1e999999999', b'crop range\n1' + b'0' * 400 + b':', beyond_float]


def _idl(fields: str, constants: str = '') -> bytes:
    text = f'a/msg/B\nmodule a {{ module msg {{ {constants} struct B {{ {fields} }}; }}; }};'
    return text.encode()


def _definitions() -> list[bytes]:
    """Nesting on which the parser takes exponential time, and names and numbers no class has."""
    return [
        _idl('long d;', f'const long C = {"(" * 3}3{")" * 3};'),
        _idl('sequence<' * 24 + 'long' + '>' * 24 + ' d;'),
        _idl('long d;' * 3000),
        _idl('long d[3];' * 2500),
        _idl('long d; @x("' + '\\"' * 20_000),
        _idl('long d;', 'const long C = 1 << 99999;'),
        _idl('long d;', 'const long C = 010 << 999999999;'),
        b'a/msg/B\nfloat64 x\nfloat64 x\n',
        b'a/msg/B\nfloat64 class\nfloat64 class_\n',
        b'a/msg/B\nfloat64 X=1e999\nfloat64 x\n',
        b'a/msg/B\n' + b'\n' * 60_000 + b'float64 x\n',
    ]


def _beyond_float32() -> list[bytes]:
    color = '{"r": 1, "g": 1, "b": 1, "a": 1e100}'
    return [
        f'SceneUpdate\n{{"entities": [{{"cubes": [{{"color": {color}}}]}}]}}'.encode(),
        b'LaserScan\n{"start_angle": 1e200, "ranges": [1, 2]}',
    ]


_KNOWN: dict[str, tuple[Callable[[], list[bytes]], ...]] = {
    'cdr_String': (_file_numbers,),
    'definition': (_definitions,),
    'typestore': (_definitions,),
    'foxglove': (_beyond_float32,),
    'mcap': (_chunk_bombs, _cut_bombs, _message_bomb, _short_messages, _endless_chunks),
    'mcap_without_index': (_chunk_bombs, _cut_bombs, _short_messages, _endless_chunks),
    'recover': (_many_types,),
    'ros1': (_ros1_bomb, _ros1_lengths, _ros1_chunk_info),
    'sqlite3': (_databases, _circles),
    'option_text': (_large_numbers,),
    'png': (_pngs,),
    'yaml': (_yaml_tags, _yaml_numbers),
    'config': (_yaml_tags, _yaml_numbers),
    'plan': (_yaml_tags, _yaml_numbers),
    'lasers': (_yaml_tags, _yaml_numbers),
}
NAMES = tuple(sorted(_KNOWN))


@cache
def known(target: str) -> list[bytes]:
    """The inputs of a target that broke it once."""
    return [data for make in _KNOWN.get(target, ()) for data in make()]
