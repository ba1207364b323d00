# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Random messages of every type that a bag of this package can hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from vision_types import DETECTIONS_3D

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.model.bag_formats import Channel

if TYPE_CHECKING:
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from kitti_ros2.options.outputs import BagOptions

CHANNELS = (
    Channel('/kitti/velo/points', 'sensor_msgs/msg/PointCloud2'),
    Channel('/kitti/camera_color_left/image_rect', 'sensor_msgs/msg/Image'),
    Channel('/kitti/camera_color_left/image_rect/compressed', 'sensor_msgs/msg/CompressedImage'),
    Channel('/kitti/camera_color_left/camera_info', 'sensor_msgs/msg/CameraInfo'),
    Channel('/kitti/oxts/imu', 'sensor_msgs/msg/Imu'),
    Channel('/kitti/oxts/fix', 'sensor_msgs/msg/NavSatFix'),
    Channel('/kitti/oxts/vel', 'geometry_msgs/msg/TwistStamped', depth=5),
    Channel('/kitti/ground_truth/odometry', 'nav_msgs/msg/Odometry'),
    Channel('/kitti/ground_truth/path', 'nav_msgs/msg/Path', latched=True),
    Channel('/tf', 'tf2_msgs/msg/TFMessage'),
    Channel('/tf_static', 'tf2_msgs/msg/TFMessage', latched=True),
    Channel('/kitti/labels/markers', 'visualization_msgs/msg/MarkerArray'),
    Channel('/kitti/labels/detections', 'vision_msgs/msg/Detection3DArray'),
    Channel('/kitti/source/calibration', 'std_msgs/msg/String', latched=True),
)
START_NS = 1_317_042_145_951_199_337


@dataclass(frozen=True)
class Sample:
    """A message to write: its channel, stamp (ns) and the buffers of its CDR."""

    channel: Channel
    stamp_ns: int
    parts: list[bytes | memoryview]

    @property
    def data(self) -> bytes:
        return b''.join(self.parts)


@cache
def jazzy() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in DETECTIONS_3D.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


def random_message(store: Typestore, msgtype: str, rng: np.random.Generator) -> object:
    """A message with something in every field."""
    values = {name: _random_value(store, kind, rng) for name, kind in store.fielddefs[msgtype][1]}
    return store.types[msgtype](**values)


def _random_value(store, kind, rng):
    node, detail = kind
    if node == Nodetype.NAME:
        return random_message(store, detail, rng)
    if node == Nodetype.BASE:
        return _random_scalars(detail[0], rng, 1)[0]
    element, size = detail
    count = size if node == Nodetype.ARRAY else int(rng.integers(0, 4))
    if element[0] == Nodetype.BASE:
        return _random_scalars(element[1][0], rng, count)
    return [_random_value(store, element, rng) for _ in range(count)]


def _random_scalars(name, rng, count):
    if name == 'string':
        return [
            ''.join(rng.choice(list('aé\n 车x'), int(rng.integers(0, 9)))) for _ in range(count)
        ]
    if name == 'bool':
        return rng.integers(0, 2, count).astype(np.bool_)
    dtype = np.dtype({'byte': 'uint8', 'octet': 'uint8', 'char': 'uint8'}.get(name, name))
    if dtype.kind == 'f':
        return rng.normal(size=count).astype(dtype)
    # Within the range that every field can hold, a time's seconds and nanoseconds included.
    return rng.integers(0, min(np.iinfo(dtype).max, 10**9 - 1), count).astype(dtype)


def make_samples(rounds: int = 4, *, seed: int = 0, cloud_bytes: int = 0) -> list[Sample]:
    """One message of every channel a round, 10 ms apart, rounds 100 ms apart.

    Args:
        rounds: How many.
        seed: Of the random contents.
        cloud_bytes: If not 0, the clouds' payload is a buffer of its own of about that size.
    """
    rng = np.random.default_rng(seed)
    samples = []
    for number in range(rounds):
        for order, channel in enumerate(CHANNELS):
            stamp_ns = START_NS + number * 100_000_000 + order * 1_000_000
            message = random_message(jazzy(), channel.msgtype, rng)
            if cloud_bytes and channel.msgtype == 'sensor_msgs/msg/PointCloud2':
                message.data = rng.integers(0, 255, cloud_bytes).astype(np.uint8)
            data = bytes(jazzy().serialize_cdr(message, channel.msgtype))
            cut = min(len(data), 200)
            samples.append(Sample(channel, stamp_ns, [data[:cut], memoryview(data)[cut:]]))
    return samples


def write_bag(path: Path, options: BagOptions, samples: list[Sample], **kwargs) -> Path:
    """Write samples to a bag, and return where it is."""
    with open_bag(path, options, jazzy(), **kwargs) as bag:
        ids = {}
        for sample in samples:
            if sample.channel not in ids:
                ids[sample.channel] = bag.add_channel(sample.channel)
        for sample in samples:
            bag.write(ids[sample.channel], sample.stamp_ns, sample.parts)
    return bag.path
