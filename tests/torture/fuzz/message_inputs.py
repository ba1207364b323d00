# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Valid messages of each form that is decoded, such as encodings; clouds are in cloud_inputs."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from kitti_ros2.model import bag_formats as types

from .cloud_inputs import clouds, packets

from bags.bag_samples import random_message  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosbags.typesys.store import Typestore

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
    for encoding in ('bayer_grbg8', 'yuyv', 'rgb8'):  # too small, or of an odd width
        yield messages.new(
            types.IMAGE, height=1, width=3, encoding=encoding, is_bigendian=0, step=9,
            data=messages.bytes(9),
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


_OWN_TRACK = bytes.fromhex('6b6974746900 8000 80000000 00000007')
_SHAPES = 3
"""Kinds of shapes of Autoware: a box, a cylinder, a polygon."""


def _objects(msgtype: str) -> Callable[[Messages], Iterator[Any]]:
    def made(messages: Messages) -> Iterator[Any]:
        for kind in range(_SHAPES):
            message = messages.new(msgtype)
            for each in message.objects:
                each.shape.type = kind
                if hasattr(each, 'object_id'):
                    identity = (_OWN_TRACK, bytes(16), bytes([9] * 16))[kind]
                    each.object_id.uuid[:] = np.frombuffer(identity, np.uint8)
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
    for width, r in ((0, np.eye(3)), (1242, np.zeros((3, 3)))):
        yield messages.new(
            types.CAMERA_INFO, height=375, width=width, distortion_model='', d=np.zeros(0),
            k=k, r=r.reshape(-1), p=p, binning_x=0, binning_y=0,
            roi=messages.new('sensor_msgs/msg/RegionOfInterest', **whole),
        )  # fmt: skip


def _scans(messages: Messages) -> Iterator[Any]:
    for intensities in (np.zeros(0, np.float32), np.linspace(0, 200, 9, dtype=np.float32)):
        yield messages.new(
            types.LASER_SCAN, angle_min=-1.0, angle_max=1.0, angle_increment=0.25, range_min=0.1,
            range_max=30.0, ranges=np.array([1, 2, 3, np.inf, 0, -1, np.nan, 8, 99], np.float32),
            intensities=intensities,
        )  # fmt: skip
    for start, step, count in ((np.nan, 0.1, 3), (0.0, 0.0, 3)):
        yield messages.new(
            types.LASER_SCAN, angle_min=start, angle_increment=step, range_min=0.0,
            range_max=9.0, ranges=np.ones(count, np.float32), intensities=np.zeros(0, np.float32),
        )  # fmt: skip


def _markers(messages: Messages) -> Iterator[Any]:
    """Cubes with captions beside them, some deleted again, and boxes drawn as lines."""
    cube, lines, text, frame = 1, 5, 9, 'lidar'
    shown = [
        (cube, 0, 'car', 1, ''), (text, 0, 'car', 1, 'Car 0.87'), (cube, 0, 'van', 2, ''),
        (text, 0, 'van', 2, 'van: 87%'), (lines, 0, 'box', 3, ''), (cube, 0, 'a/car', 4, '12 m'),
        (cube, 0, 'ego', 1, ''), (cube, 2, 'van', 2, ''),
    ]  # fmt: skip
    for ending in ([], [(cube, 3, '', 0, '')]):
        made = [
            messages.new(
                'visualization_msgs/msg/Marker', type=kind, action=action, ns=ns, id=number,
                text=caption,
            )
            for kind, action, ns, number, caption in [*shown, *ending]
        ]  # fmt: skip
        for each in made:
            each.header.frame_id = frame
        made[5].text = 'Car 0.87'
        made[0].header.frame_id = 'other'
        yield messages.new(types.MARKERS, markers=made)


def _texts(messages: Messages) -> Iterator[Any]:
    sweeps = [json.dumps({'start_ns': start, 'end_ns': 10**8}) for start in (1, None)]
    starts = json.dumps({'scan_stamp': 'start', 'period_ns': 10**8})
    for text in (*sweeps, starts, 'calib/000000.txt\nP2: 1 2 3\n'):
        yield messages.new(types.STRING, data=text)


_FORMS: dict[str, Callable[[Messages], Iterator[Any]]] = {
    types.IMAGE: _images,
    types.COMPRESSED: _compressed,
    types.CLOUD: clouds,
    types.VELODYNE: packets,
    types.DETECTED_OBJECTS: _objects(types.DETECTED_OBJECTS),
    types.TRACKED_OBJECTS: _objects(types.TRACKED_OBJECTS),
    types.CAMERA_INFO: _infos,
    types.LASER_SCAN: _scans,
    types.MARKERS: _markers,
    types.STRING: _texts,
}
