# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of a robot of any size, as the libraries mcap and rosbags write them.

Scans of 65,536 points and images of 1242x375 at 10 Hz, a camera's calibration, and transforms.
"""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import Writer as RosbagWriter
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

GB = 10**9
SIZE = (1242, 375)
RINGS, COLUMNS = 64, 1024
PERIOD_NS = 100_000_000
START_NS = 1_700_000_000 * 10**9
VARIANTS = 8
"""Different scans and images in a bag, in turn: making each anew would take hours."""

STORE = get_typestore(Stores.ROS2_HUMBLE)
SCAN, IMAGE, INFO, TF = '/lidar/points', '/camera/image', '/camera/camera_info', '/tf_static'


def image_topic(kind: str) -> str:
    """Return the name of the image topic of a kind of images."""
    return IMAGE if kind == 'raw' else f'{IMAGE}/compressed'


def make_type(name: str, *values: Any) -> Any:  # noqa: ANN401 - of the type store
    """Return a message."""
    return STORE.types[name](*values)


def header(stamp_ns: int, frame: str) -> Any:  # noqa: ANN401 - of the type store
    """Return a std_msgs/Header."""
    time_type = make_type('builtin_interfaces/msg/Time', stamp_ns // GB, stamp_ns % GB)
    return make_type('std_msgs/msg/Header', time_type, frame)


def serialised(message: Any) -> bytearray:  # noqa: ANN401 - of the type store
    """Return a message as CDR."""
    return bytearray(STORE.serialize_cdr(message, message.__msgtype__))


def make_scan(rng: np.random.Generator) -> bytearray:
    """Return a PointCloud2 of x, y, z and intensity: a street of noise."""
    azimuth = np.linspace(np.pi, -np.pi, COLUMNS, endpoint=False)
    elevation = np.radians(np.linspace(2, -24.9, RINGS))[:, None]
    distance = rng.uniform(4, 60, (RINGS, COLUMNS))
    points = np.empty((RINGS, COLUMNS, 4), np.float32)
    points[..., 0] = distance * np.cos(elevation) * np.cos(azimuth)
    points[..., 1] = distance * np.cos(elevation) * np.sin(azimuth)
    points[..., 2] = distance * np.sin(elevation)
    points[..., 3] = rng.integers(0, 256, (RINGS, COLUMNS))
    fields = [
        make_type('sensor_msgs/msg/PointField', name, 4 * place, 7, 1)
        for place, name in enumerate(('x', 'y', 'z', 'intensity'))
    ]
    data = points.view(np.uint8).ravel()
    shape = (RINGS, COLUMNS, fields, False, 16, 16 * COLUMNS, data, True)
    return serialised(make_type('sensor_msgs/msg/PointCloud2', header(0, 'lidar'), *shape))


def make_picture(rng: np.random.Generator) -> np.ndarray:
    """Return an image with the detail of a street: its PNG has 0.7 of the bytes of its pixels."""
    rough = rng.integers(0, 256, (24, 80, 3), np.uint8)
    smooth = cv2.resize(rough, SIZE, interpolation=cv2.INTER_CUBIC).astype(np.int16)
    noise = np.asarray(rng.normal(0, 6, smooth.shape), np.int16)
    return np.asarray(np.clip(smooth + noise, 0, 255), np.uint8)


def make_image(pixels: np.ndarray, kind: str) -> bytearray:
    """Return an Image or CompressedImage."""
    head = header(0, 'camera')
    if kind == 'raw':
        height, width = pixels.shape[:2]
        values = (head, height, width, 'bgr8', 0, 3 * width, pixels.ravel())
        return serialised(make_type('sensor_msgs/msg/Image', *values))
    data = cv2.imencode(f'.{kind}', pixels)[1].ravel()
    text = f'bgr8; {kind} compressed bgr8'
    return serialised(make_type('sensor_msgs/msg/CompressedImage', head, text, data))


def make_info() -> bytearray:
    """Return the CameraInfo of a rectified camera."""
    k = np.array([[720.0, 0, 610], [0, 720, 180], [0, 0, 1]])
    p = np.column_stack([k, np.zeros(3)]).ravel()
    do_rectify = False
    roi = make_type('sensor_msgs/msg/RegionOfInterest', 0, 0, 0, 0, do_rectify)
    size = (SIZE[1], SIZE[0], 'plumb_bob', np.zeros(5), k.ravel(), np.eye(3).ravel(), p)
    values = (header(0, 'camera'), *size, 0, 0, roi)
    return serialised(make_type('sensor_msgs/msg/CameraInfo', *values))


def make_tf() -> bytearray:
    """Return a TFMessage: the lidar on the base, the camera below it, looking ahead."""
    links = []
    for child, place, turn in (
        ('lidar', (0.0, 0.0, 1.8), (0.0, 0.0, 0.0, 1.0)),
        ('camera', (0.3, 0.0, 1.6), (-0.5, 0.5, -0.5, 0.5)),
    ):
        vector = make_type('geometry_msgs/msg/Vector3', *place)
        quaternion = make_type('geometry_msgs/msg/Quaternion', *turn)
        transform = make_type('geometry_msgs/msg/Transform', vector, quaternion)
        head = header(START_NS, 'base_link')
        links.append(make_type('geometry_msgs/msg/TransformStamped', head, child, transform))
    return serialised(make_type('tf2_msgs/msg/TFMessage', links))


TYPES = {
    SCAN: 'sensor_msgs/msg/PointCloud2',
    IMAGE: 'sensor_msgs/msg/Image',
    f'{IMAGE}/compressed': 'sensor_msgs/msg/CompressedImage',
    INFO: 'sensor_msgs/msg/CameraInfo',
    TF: 'tf2_msgs/msg/TFMessage',
}


def messages(kind: str, size_bytes: int) -> Iterator[tuple[str, int, bytes]]:
    """Yield (topic, stamp in nanoseconds, CDR) until their size is reached."""
    rng = np.random.default_rng(1)
    scans = [make_scan(rng) for _ in range(VARIANTS)]
    images = [make_image(make_picture(rng), kind) for _ in range(VARIANTS)]
    yield TF, START_NS, bytes(make_tf())
    topic, info = image_topic(kind), make_info()
    done, stamp_ns = 0, START_NS
    for scan, image in cycle(zip(scans, images, strict=True)):
        if done >= size_bytes:
            return
        for name, data in ((SCAN, scan), (topic, image), (INFO, info)):
            data[4:8] = (stamp_ns // GB).to_bytes(4, 'little')
            data[8:12] = (stamp_ns % GB).to_bytes(4, 'little')
            done += len(data)
            yield name, stamp_ns, bytes(data)
        stamp_ns += PERIOD_NS


def write_bag(path: Path, storage: str, kind: str, size_bytes: int) -> Path:
    """Write a bag; return the file of its messages."""
    topics = (SCAN, image_topic(kind), INFO, TF)
    if storage == 'mcap':
        with path.open('wb') as file:
            writer = McapWriter(file, compression=CompressionType.NONE)
            writer.start('ros2', 'benchmark')
            channels = {}
            for topic in topics:
                text = STORE.generate_msgdef(TYPES[topic], ros_version=2)[0].encode()
                schema = writer.register_schema(TYPES[topic], 'ros2msg', text)
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            for topic, stamp_ns, data in messages(kind, size_bytes):
                writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
            writer.finish()  # type: ignore[no-untyped-call]
        return path
    with RosbagWriter(path, version=9) as bag:
        connections = {
            topic: bag.add_connection(topic, TYPES[topic], typestore=STORE) for topic in topics
        }
        for topic, stamp_ns, data in messages(kind, size_bytes):
            bag.write(connections[topic], stamp_ns, data)
    return next(path.glob('*.db3'))
