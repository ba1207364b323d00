# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot whose sensors run on clocks of their own, recorded by one computer; rosbags writes it.

The scanner turns at 10 Hz, the camera exposes once a turn, odometry is at 50 Hz. Every image is of
one grey, and the reflectance of all points of a scan is its number, so that the pairs that belong
together are seen in the files. Time is that of the computer; `Robot` moves the stamps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
START_NS = 1_760_000_000_000_000_000
FRAMES = 20
PERIOD_NS = 100_000_000
SIZE = (64, 48)
UPTIME_NS = 812_345_678_901
"""The scanner was switched on 812 s before: its clock began at 1970."""

K = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
LIDAR_Q_CAMERA = (-0.5, 0.5, -0.5, 0.5)
"""The optical frame (x right, y down, z forward) in axes x forward, y left, z up; xyzw."""

POINT = [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('t', '<u4')]
_KINDS = {
    '|i1': 1, '|u1': 2, '<i2': 3, '<u2': 4, '<i4': 5, '<u4': 6, '<f4': 7, '<f8': 8,
}  # fmt: skip


@dataclass(frozen=True)
class Robot:
    """The stamps of a robot: each maps a time of the computer to a stamp of the sensor.

    Attributes:
        scan, image, odometry: Nanoseconds to nanoseconds.
        latency_ns: Of the scanner's and of the camera's driver.
        image_lag_ns: The exposure after the middle of the turn.
        turn: Times of the first and last point from the scan's stamp; None without a field t.
        stamp_at_ns: Of the scan's stamp, from the middle of the turn.
        labels: Whether a detector answers, with the stamps of the scans.
        log: Of all messages.
    """

    scan: Callable[[int], int] = lambda ns: ns
    image: Callable[[int], int] = lambda ns: ns
    odometry: Callable[[int], int] = lambda ns: ns
    latency_ns: tuple[int, int] = (12_000_000, 9_000_000)
    image_lag_ns: int = 3_000_000
    turn: tuple[int, int] | None = None
    stamp_at_ns: int = 0
    labels: bool = False
    log: Callable[[int], int] = lambda ns: ns


def header(stamp_ns: int, frame: str) -> Any:
    time = TYPES['builtin_interfaces/msg/Time'](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return TYPES['std_msgs/msg/Header'](stamp=time, frame_id=frame)


def cloud(
    points: np.ndarray, stamp_ns: int, frame: str = 'lidar', shape: tuple[int, int] | None = None
) -> Any:
    """A PointCloud2 of a structured array."""
    height, width = shape or (1, len(points))
    kind = TYPES['sensor_msgs/msg/PointField']
    fields = [
        kind(name=name, offset=at, datatype=_KINDS[each.str], count=1)
        for name, (each, at) in points.dtype.fields.items()
    ]
    return TYPES['sensor_msgs/msg/PointCloud2'](
        header=header(stamp_ns, frame),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * width,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def scan(robot: Robot, number: int, stamp_ns: int) -> Any:
    """A ring of points, all with the reflectance number / 255."""
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    points = np.zeros(60, [each for each in POINT if robot.turn is not None or each[0] != 't'])
    points['x'], points['y'], points['z'] = 8 * np.cos(angles), 8 * np.sin(angles), 0.5
    points['intensity'] = number / 255
    if robot.turn is not None:
        points['t'] = np.linspace(*robot.turn, 60).astype(np.int64)
    return cloud(points, stamp_ns)


def image(number: int, stamp_ns: int) -> Any:
    """All pixels have the value 2 number + 1."""
    return TYPES['sensor_msgs/msg/Image'](
        header=header(stamp_ns, 'camera_optical'),
        height=SIZE[1],
        width=SIZE[0],
        encoding='mono8',
        is_bigendian=0,
        step=SIZE[0],
        data=np.full(SIZE[0] * SIZE[1], 2 * number + 1, np.uint8),
    )


def camera_info(stamp_ns: int) -> Any:
    return TYPES['sensor_msgs/msg/CameraInfo'](
        header=header(stamp_ns, 'camera_optical'),
        height=SIZE[1],
        width=SIZE[0],
        distortion_model='plumb_bob',
        d=np.zeros(5),
        k=K.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([K, np.zeros(3)]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=TYPES['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, do_rectify=False),
    )


def true_x(time_ns: int) -> float:
    """Where the robot is: it starts slowly and speeds up, so that every time has its place."""
    seconds = (time_ns - START_NS) / 1e9
    return 2.0 * seconds + 0.5 * seconds**2


def odometry(time_ns: int, stamp_ns: int) -> Any:
    vector, point = TYPES['geometry_msgs/msg/Vector3'], TYPES['geometry_msgs/msg/Point']
    pose = TYPES['geometry_msgs/msg/Pose'](
        position=point(true_x(time_ns), 0.0, 0.0),
        orientation=TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
    )
    twist = TYPES['geometry_msgs/msg/Twist'](vector(2.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    return TYPES['nav_msgs/msg/Odometry'](
        header=header(stamp_ns, 'odom'),
        child_frame_id='lidar',
        pose=TYPES['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
        twist=TYPES['geometry_msgs/msg/TwistWithCovariance'](twist, np.zeros(36)),
    )


def static_tf(stamp_ns: int) -> Any:
    vector = TYPES['geometry_msgs/msg/Vector3'](0.1, 0.0, -0.1)
    turn = TYPES['geometry_msgs/msg/Quaternion'](*LIDAR_Q_CAMERA)
    link = TYPES['geometry_msgs/msg/TransformStamped'](
        header=header(stamp_ns, 'lidar'),
        child_frame_id='camera_optical',
        transform=TYPES['geometry_msgs/msg/Transform'](vector, turn),
    )
    return TYPES['tf2_msgs/msg/TFMessage']([link])


def markers(number: int, stamp_ns: int) -> Any:
    """A car ahead, wider for each frame: its length is 4 m and number cm."""
    marker_type = TYPES['visualization_msgs/msg/Marker']
    point, vector = TYPES['geometry_msgs/msg/Point'], TYPES['geometry_msgs/msg/Vector3']
    pose = TYPES['geometry_msgs/msg/Pose'](
        point(12.0, 0.0, 0.0), TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)
    )
    empty = np.zeros(0, np.uint8)
    names = marker_type.__dataclass_fields__
    values = {
        'header': header(stamp_ns, 'lidar'),
        'ns': 'car',
        'id': 1,
        'type': 1,
        'action': 0,
        'pose': pose,
        'scale': vector(4.0 + number / 100, 1.8, 1.5),
        'color': TYPES['std_msgs/msg/ColorRGBA'](1.0, 0.0, 0.0, 1.0),
        'lifetime': TYPES['builtin_interfaces/msg/Duration'](0, 0),
        'frame_locked': False,
        'points': [],
        'colors': [],
        'texture_resource': '',
        'texture': TYPES['sensor_msgs/msg/CompressedImage'](header(0, ''), '', empty),
        'uv_coordinates': [],
        'text': '',
        'mesh_resource': '',
        'mesh_file': TYPES['visualization_msgs/msg/MeshFile']('', empty),
        'mesh_use_embedded_materials': False,
    }
    return TYPES['visualization_msgs/msg/MarkerArray'](
        [marker_type(**{name: values[name] for name in names if name in values})]
    )


def messages(robot: Robot) -> list[tuple[str, int, Any]]:
    """(topic, log time, message) in the order of recording; jitter of up to 2 ms."""
    rng = np.random.default_rng(11)
    found = [('/tf_static', START_NS - 5 * 10**8, static_tf(START_NS))]

    def add(topic: str, time_ns: int, latency_ns: int, message: Any) -> None:
        late = latency_ns + int(rng.integers(0, 2_000_000))
        found.append((topic, robot.log(time_ns + late), message))

    for number in range(FRAMES):
        middle = START_NS + number * PERIOD_NS
        stamp = robot.scan(middle + robot.stamp_at_ns)
        end = middle + PERIOD_NS // 2
        add('/points', end, robot.latency_ns[0], scan(robot, number, stamp))
        exposed = middle + robot.image_lag_ns
        add('/camera/image', exposed, robot.latency_ns[1], image(number, robot.image(exposed)))
        add('/camera/camera_info', exposed, robot.latency_ns[1], camera_info(robot.image(exposed)))
        if robot.labels:
            add('/boxes', end, 60_000_000, markers(number, stamp))
    for place in range(-10, 5 * FRAMES + 20):
        time_ns = START_NS + place * 20_000_000
        add('/odom', time_ns, 1_000_000, odometry(time_ns, robot.odometry(time_ns)))
    return sorted(found, key=lambda each: each[1])


def write_clouds(path: Path, points_of: Callable[[int], np.ndarray], frame: str = 'lidar') -> Path:
    """Write the robot with other points: a structured array by the number of the scan."""
    found = []
    for topic, log_ns, message in messages(Robot()):
        if topic == '/points':
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            number = sum(each[0] == '/points' for each in found)
            message = cloud(points_of(number), stamp_ns, frame)  # noqa: PLW2901
        found.append((topic, log_ns, message))
    return write(path, found)


def write(path: Path, found: list[tuple[str, int, Any]]) -> Path:
    """Write messages with rosbags' own writer, sqlite3."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections: dict[str, Any] = {}
        for topic, log_ns, message in found:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], log_ns, STORE.serialize_cdr(message, kind))
    return path
