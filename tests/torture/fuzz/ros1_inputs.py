# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, record by record: such as other recorders write, and with parts that disagree."""

from __future__ import annotations

import bz2
import struct

from lz4 import frame as lz4_frame

_START = b'#ROSBAG V2.0\n'
_OPS = {'header': 3, 'chunk': 5, 'connection': 7, 'message': 2, 'index': 4, 'info': 6}
_TIME = struct.pack('<II', 5, 7)


def _text(value: bytes) -> bytes:
    return struct.pack('<I', len(value)) + value


def ros1_record(fields: dict[bytes, bytes], data: bytes) -> bytes:
    """A record of the format: fields of its head, and data."""
    head = b''.join(_text(name + b'=' + value) for name, value in fields.items())
    return _text(head) + _text(data)


def _record(kind: str, data: bytes, **fields: bytes | int) -> bytes:
    values = {
        name.encode(): struct.pack('<I', value) if isinstance(value, int) else value
        for name, value in fields.items()
    }
    return ros1_record({b'op': bytes([_OPS[kind]]), **values}, data)


def _connection(number: int = 0, **others: bytes) -> bytes:
    described = {
        'topic': b'/t', 'type': b'std_msgs/String', 'md5sum': b'992ce8a1687cec8c8bd883ec73ca41d1',
        'message_definition': b'string data\n', **others,
    }  # fmt: skip
    parts = (_text(name.encode() + b'=' + value) for name, value in described.items() if value)
    return _record('connection', b''.join(parts), conn=number, topic=b'/t')


def _chunk(records: bytes, compression: bytes = b'none', size: int | None = None) -> bytes:
    packed = {b'bz2': bz2.compress, b'lz4': lz4_frame.compress}.get(compression, bytes)(records)
    stated = len(records) if size is None else size
    return _record('chunk', packed, compression=compression, size=stated)


def _bag(*records: bytes, index: bytes = b'', chunks: int = 1, closed: bool = True) -> bytes:
    """A bag of records, closed with an index."""
    body = b''.join(records)
    place = len(_START) + 4096 + len(body)
    head = {'index_pos': struct.pack('<Q', place if closed else 0), 'conn_count': 1,
            'chunk_count': chunks}  # fmt: skip
    bare = len(_record('header', b'', **head))
    header = _record('header', b' ' * (4096 - bare), **head)
    return _START + header + body + index


def _index(counts: bytes = struct.pack('<II', 0, 2)) -> bytes:
    info = _record('info', counts, ver=1, chunk_pos=struct.pack('<Q', len(_START) + 4096),
                   start_time=_TIME, end_time=_TIME, count=len(counts) // 8)  # fmt: skip
    return _connection() + info


def ros1_bags() -> list[bytes]:
    """Bags of a few records."""
    data = _text(b'hello')
    message = _record('message', data, conn=0, time=_TIME)
    other = _record('message', data, time=_TIME, conn=0)  # in another order than rosbag's
    records = _connection() + message + other
    chunks = [_chunk(records, each) for each in (b'none', b'bz2', b'lz4', b'zip')]
    entry = _record('index', _TIME + bytes(4) + _TIME + bytes(4), ver=1, conn=0, count=2)
    bad = _record('message', data, conn=0, time=_TIME)[:-3]
    made = [_bag(each, entry, index=_index()) for each in chunks]
    made += [_bag(each, closed=False) for each in chunks]
    made += [
        _bag(_chunk(records, each, 0), closed=False) for each in (b'none', b'lz4', b'bz2')
    ]  # fmt: skip
    return [
        *made,
        *(_bag(chunks[0], index=_index(), chunks=2), _bag(chunks[0], index=_index()[5:])),
        *(_bag(chunks[0], index=_index(struct.pack('<II', 9, 1))), _bag(records, closed=False)),
        _bag(_chunk(_connection(md5sum=b'') + message), index=_index()),
        _bag(_chunk(_connection(type=b'std_msgs/Bool') + message), index=_index()),
        _bag(_chunk(records + bad), index=_index()),
        _bag(_chunk(_connection() + other + b'\xff' * 9), index=_index()),
        _bag(_chunk(records + b'\5\0\0\0\xff\xff\xff\xff\1'), closed=False),
        *(_bag(_connection(md5sum=b''), closed=False), _bag(message, index=_index())),
    ]
