# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Valid messages of each form that is decoded: encodings, fields of clouds, models of scanners."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from kitti_ros2.model import msgtypes as types

from bags.bag_samples import random_message  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rosbags.typesys.store import Typestore

_KINDS = ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8')
SIZE = (4, 6)
"""Rows and columns, which every encoding allows."""
_ENCODINGS = {
    **dict.fromkeys(('mono8', '8UC1', 'bayer_rggb8', 'bayer_gbrg8'), 1),
    **dict.fromkeys(('mono16', '16UC1', 'bayer_bggr16', 'yuv422', 'yuyv'), 2),
    **dict.fromkeys(('rgb8', 'bgr8', '8UC3'), 3),
    **dict.fromkeys(('bgra8', 'rgba8', '32FC1'), 4),
    **dict.fromkeys(('rgb16', 'bgr16'), 6),
    **dict.fromkeys(('rgba16', 'bgra16'), 8),
}
"""Bytes of a pixel."""


class Messages:
    """Makes messages of a store's types.

    Args:
        store: Knows the types.
    """

    def __init__(self, store: Typestore) -> None:
        self._store = store
        self._rng = np.random.default_rng(7)

    def of(self, msgtype: str) -> list[bytes]:
        """Return messages of a type in CDR: valid ones, and some of random values."""
        made = [random_message(self._store, msgtype, self._rng) for _ in range(3)]
        found = [*made, *_FORMS.get(msgtype, lambda _: ())(self)]
        return [bytes(self._store.serialize_cdr(each, msgtype)) for each in found]

    def new(self, msgtype: str, **values: Any) -> Any:
        """Return a message with some values, the others random."""
        message = random_message(self._store, msgtype, self._rng)
        for name, value in values.items():
            setattr(message, name, value)
        return message

    def bytes(self, count: int) -> np.ndarray:
        """Return random bytes."""
        return self._rng.integers(0, 256, count, np.uint8)


def _images(messages: Messages) -> Iterator[Any]:
    height, width = SIZE
    for encoding, size in _ENCODINGS.items():
        for big in (0, 1):
            data = messages.bytes(height * (width * size + big))
            if encoding == '32FC1':
                data = np.linspace(-1, 9, height * width, dtype='<f4').view(np.uint8)
            yield messages.new(
                types.IMAGE, height=height, width=width, encoding=encoding, is_bigendian=big,
                step=len(data) // height, data=data,
            )  # fmt: skip


def _encoded(suffix: str, pixels: np.ndarray) -> bytes:
    return cv2.imencode(suffix, pixels)[1].tobytes()


def _compressed(messages: Messages) -> Iterator[Any]:
    height, width = SIZE
    grey = messages.bytes(height * width).reshape(SIZE)
    deep = (grey.astype(np.uint16) << 4) + 1
    colour = np.dstack([grey, grey // 2, grey // 3])
    png = _encoded('.png', deep)
    head = struct.pack('<iff', 0, 100.0, 0.5)
    pictures = [
        *(('png', _encoded('.png', each)) for each in (grey, deep, colour, np.dstack([deep] * 3))),
        *(('jpeg', _encoded('.jpg', each)) for each in (grey, colour)),
        *(('webp', _encoded('.webp', each)) for each in (grey, colour)),
        ('bayer_rggb8; png compressed ', _encoded('.png', grey)),
        ('rgb8; jpeg compressed bgr8', _encoded('.jpg', colour)),
        ('16UC1; compressedDepth png', head + png),
        ('32FC1; compressedDepth png', head + png),
        ('32FC1; compressedDepth rvl', head + bytes(range(60))),
        ('16UC1; compressedDepth png', head + _encoded('.png', colour)),
    ]
    for format_, data in pictures:
        yield messages.new(types.COMPRESSED, format=format_, data=np.frombuffer(data, np.uint8))


_CLOUDS: tuple[Sequence[tuple[str, str]], ...] = (
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('file_index', 'u4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'f4'), ('label', 'u2'),
     ('instance', 'u2')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('intensity', 'u1'), ('ring', 'u2'), ('time', 'f4')],
    [('x', 'f8'), ('y', 'f8'), ('z', 'f8'), ('reflectivity', 'u2'), ('t', 'u4'), ('range', 'u4')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('timestamp', 'f8')],
    [('x', 'f4'), ('y', 'f4'), ('z', 'f4'), ('i', 'f8')],
)  # fmt: skip


def _clouds(messages: Messages) -> Iterator[Any]:
    for columns in _CLOUDS:
        for height, width, big in ((1, 8, False), (2, 4, True)):
            yield _cloud(messages, columns, (height, width), big=big)


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
        data=np.frombuffer(points.tobytes(), np.uint8),
    )  # fmt: skip


_BLOCK = np.dtype([('flag', '<u2'), ('azimuth', '<u2'), ('values', 'u1', (32, 3))])
_PACKET = np.dtype([('blocks', _BLOCK, (12,)), ('time', '<u4'), ('mode', 'u1'), ('id', 'u1')])


def _packets(messages: Messages) -> Iterator[Any]:
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


_SHAPES = 3
"""Kinds of shapes of Autoware: a box, a cylinder, a polygon."""


def _objects(msgtype: str) -> Callable[[Messages], Iterator[Any]]:
    def made(messages: Messages) -> Iterator[Any]:
        for kind in range(_SHAPES):
            message = messages.new(msgtype)
            for each in message.objects:
                each.shape.type = kind
                if hasattr(each, 'object_id'):
                    each.object_id.uuid[:] = 0 if kind else 9
            yield message

    return made


def _infos(messages: Messages) -> Iterator[Any]:
    k = np.array([700.0, 0, 600, 0, 700, 170, 0, 0, 1])
    p = np.array([700.0, 0, 600, 45, 0, 700, 170, 0, 0, 0, 1, 0])
    whole = {'x_offset': 0, 'y_offset': 0, 'height': 0, 'width': 0}
    parts = {'x_offset': 2, 'y_offset': 4, 'height': 100, 'width': 300}
    for model, count, region, binning in (
        ('plumb_bob', 5, whole, 0), ('equidistant', 4, whole, 2),
        ('rational_polynomial', 8, parts, 1), ('', 0, parts, 1),
    ):  # fmt: skip
        roi = messages.new('sensor_msgs/msg/RegionOfInterest', **region)
        for left, right in ((k, p), (k, 0 * p), (0 * k, p)):
            yield messages.new(
                types.CAMERA_INFO, height=375, width=1242, distortion_model=model,
                d=np.linspace(0, 0.1, count), k=left, r=np.eye(3).reshape(-1), p=right,
                binning_x=binning, binning_y=binning, roi=roi,
            )  # fmt: skip


def _scans(messages: Messages) -> Iterator[Any]:
    for intensities in (np.zeros(0, np.float32), np.linspace(0, 200, 9, dtype=np.float32)):
        yield messages.new(
            types.LASER_SCAN, angle_min=-1.0, angle_max=1.0, angle_increment=0.25, range_min=0.1,
            range_max=30.0, ranges=np.array([1, 2, 3, np.inf, 0, -1, np.nan, 8, 99], np.float32),
            intensities=intensities,
        )  # fmt: skip


def _texts(messages: Messages) -> Iterator[Any]:
    for text in (json.dumps({'start_ns': 1, 'end_ns': None}), 'calib/000000.txt\nP2: 1 2 3\n'):
        yield messages.new(types.STRING, data=text)


_FORMS: dict[str, Callable[[Messages], Iterator[Any]]] = {
    types.IMAGE: _images,
    types.COMPRESSED: _compressed,
    types.CLOUD: _clouds,
    types.VELODYNE: _packets,
    types.DETECTED_OBJECTS: _objects(types.DETECTED_OBJECTS),
    types.TRACKED_OBJECTS: _objects(types.TRACKED_OBJECTS),
    types.CAMERA_INFO: _infos,
    types.LASER_SCAN: _scans,
    types.STRING: _texts,
}
