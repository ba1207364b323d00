# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Valid messages of points: the fields of clouds, and the packets of each scanner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.bag_formats import FORMATS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from kitti_ros2.model.bag_formats import CloudFormat

    from .message_inputs import Messages

_KINDS = ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8')

_CLOUDS: tuple[Sequence[tuple[str, str]], ...] = (
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('file_index', 'u4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('label', 'u2'),
     ('instance', 'u2')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'u1'), ('ring', 'u2'), ('time', 'f4')],
    [('x', 'f8'), ('y', 'f8'), ('z', 'f8'), ('reflectivity', 'u2'), ('t', 'u4'), ('range', 'u4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('timestamp', 'f8')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('i', 'f8')],
    [('x', 'f4'), ('y', 'f4'), ('intensity', 'f4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4')],
)  # fmt: skip


def clouds(messages: Messages) -> Iterator[Any]:
    for columns in _CLOUDS:
        for height, width, big in ((1, 8, False), (2, 4, True), (0, 0, False)):
            yield _cloud(messages, columns, (height, width), big=big)
    for start_s in (np.nan, 1.5e9):  # no times, and those since 1970
        timed = _cloud(messages, _CLOUDS[5], (1, 8), big=False)
        timed.header.stamp.sec, timed.header.stamp.nanosec = 1_500_000_000, 0
        timed.data.view(np.dtype([('xyz', '<f4', 3), ('timestamp', '<f8')]))['timestamp'] += start_s
        yield timed
    ranged = _cloud(messages, _CLOUDS[4], (1, 8), big=False)
    ranged.fields[-1].offset = 1000
    yield ranged
    for name, value in (('datatype', 9), ('count', 3)):
        odd = _cloud(messages, _CLOUDS[0], (2, 4), big=False)
        setattr(odd.fields[0], name, value)
        yield odd
    for name, value in (('row_step', 3), ('row_step', 10**6), ('data', np.zeros(9, np.uint8))):
        odd = _cloud(messages, _CLOUDS[0], (2, 4), big=False)
        setattr(odd, name, value)
        yield odd
    for cloud_format in FORMATS.values():
        for timed in (True, False):
            yield _formatted(messages, cloud_format, timed=timed)


def _formatted(messages: Messages, cloud_format: CloudFormat, *, timed: bool) -> Any:
    """A cloud in a format of to-bag, whose points are zeros."""
    columns = cloud_format.fields_of(timed=timed)
    fields = [
        messages.new(
            'sensor_msgs/msg/PointField', name=each.name, offset=each.offset,
            datatype=_KINDS.index(each.kind[1:]) + 1, count=1,
        )
        for each in columns
    ]  # fmt: skip
    step = max(cloud_format.point_step, columns[-1].end)
    return messages.new(
        types.CLOUD, height=1, width=3, fields=fields, is_bigendian=False, point_step=step,
        row_step=3 * step, data=np.zeros(3 * step, np.uint8),
    )  # fmt: skip


def _cloud(
    messages: Messages, columns: Sequence[tuple[str, str]], size: tuple[int, int], *, big: bool
) -> Any:
    height, width = size
    order = '>' if big else '<'
    points = np.zeros(height * width, [(name, order + kind) for name, kind in columns])
    for name, kind in columns:
        if name in {'t', 'range'}:
            points[name] = np.arange(len(points)) * 12_000_000
        elif name in {'time', 'timestamp'}:
            points[name] = np.linspace(0, 0.1, len(points))
        else:
            points[name] = np.arange(len(points)) if kind[0] == 'u' else np.arange(len(points)) / 8
    fields = [
        messages.new(
            'sensor_msgs/msg/PointField', name=name, offset=points.dtype.fields[name][1],
            datatype=_KINDS.index(kind) + 1, count=1,
        )
        for name, kind in columns
    ]  # fmt: skip
    return messages.new(
        types.CLOUD, height=height, width=width, fields=fields, is_bigendian=big,
        point_step=points.itemsize, row_step=points.itemsize * width,
        data=np.frombuffer(points.tobytes(), np.uint8).copy(),
    )  # fmt: skip


_BLOCK = np.dtype([('flag', '<u2'), ('azimuth', '<u2'), ('values', 'u1', (32, 3))])
_PACKET = np.dtype([('blocks', _BLOCK, (12,)), ('time', '<u4'), ('mode', 'u1'), ('id', 'u1')])


def packets(messages: Messages) -> Iterator[Any]:
    for product in (0x21, 0x22, 0x24, 0x28, 0x00):
        for mode in (0x37, 0x39):
            yield messages.new(
                types.VELODYNE,
                packets=[_packet(messages, number, mode, product) for number in range(2)],
            )


def _packet(messages: Messages, number: int, mode: int, product: int) -> Any:
    packet = np.zeros((), _PACKET)
    packet['blocks']['flag'] = 0xEEFF
    if not product:  # a HDL-64E, whose blocks alternate
        packet['blocks']['flag'][1::2] = 0xDDFF
    step = 2 if mode == 0x39 else 1
    packet['blocks']['azimuth'] = (np.arange(12) // step * 40 + number * 480) % 36000
    packet['blocks']['values'] = messages.bytes(12 * 96).reshape(12, 32, 3)
    packet['mode'], packet['id'] = mode, product
    data = np.frombuffer(packet.tobytes(), np.uint8)
    return messages.new('velodyne_msgs/msg/VelodynePacket', data=data)
