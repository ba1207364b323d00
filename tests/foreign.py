# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag that knows nothing of KITTI: other names, rates, jitter, fields, a distorted camera, boxes.

What is true in the world is computed here from the rig alone, with OpenCV and plain matrices.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.camera_info import encode_static
from kitti_ros2.messages.cdr import (
    join,
    make_header,
    make_pose,
    make_quaternion,
    make_vector3,
    serialize,
)
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.ros_types import (
    TYPESTORE,
    CameraInfo,
    CompressedImage,
    ImageMsg,
    Imu,
    NavSatFix,
    NavSatStatus,
    Odometry,
    PointCloud2,
    PointField,
    PoseWithCovariance,
    RegionOfInterest,
    Twist,
    TwistStamped,
    TwistWithCovariance,
)
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.outputs import BagOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

START_NS = 1_700_000_000_123_456_789
FRAMES = 12
SIZE = (640, 360)
K = np.array([[520.0, 0, 322.5], [0, 518.0, 178.25], [0, 0, 1]])
D = np.array([-0.28, 0.09, 0.0012, -0.0007, -0.01])
K_RECT = np.array([[500.0, 0, 318.0], [0, 500.0, 181.0], [0, 0, 1]])
BASELINE = 0.12

AXES = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Columns: an optical frame's x, y, z in axes x forward, y left, z up."""

BASE_T_LIDAR = Transform(rotation_from_rpy(0.01, -0.02, 0.3), np.array([0.4, 0.1, 1.7]))
BASE_T_CAMERA = Transform(rotation_from_rpy(0.0, 0.05, -0.02) @ AXES, np.array([0.9, 0.2, 1.3]))
BASE_T_IMU = Transform(rotation_from_rpy(0.0, 0.0, 0.0), np.array([0.1, 0.0, 0.5]))

POINT = np.dtype(
    {
        'names': ['intensity', 'ring', 'z', 'x', 'y'],
        'formats': ['>u2', '>u1', '>f8', '>f8', '>f8'],
        'offsets': [2, 5, 8, 16, 24],
        'itemsize': 40,
    }
)
ROW_PADDING = 24
_DATATYPES = {'>u2': PointField.UINT16, '|u1': PointField.UINT8, '>f8': PointField.FLOAT64}


@dataclass(frozen=True)
class Frame:
    """What is true at one frame.

    Attributes:
        stamp_ns: Of the scan.
        points: (N, 4) in the lidar's frame, reflectance 0..1; without those that are NaN.
        blobs: (M, 3) white dots that the cameras see, in the lidar's frame.
        cuboid: A car, in the lidar's frame.
    """

    stamp_ns: int
    points: np.ndarray
    blobs: np.ndarray
    cuboid: Cuboid


def lidar_t_camera() -> Transform:
    return BASE_T_LIDAR.inverse() @ BASE_T_CAMERA


def base_pose(stamp_ns: int) -> Transform:
    """odom_T_base at a time."""
    share = (stamp_ns - START_NS) / 100_000_000
    return Transform(rotation_from_rpy(0, 0, 0.02 * share), np.array([0.5 * share, 0.01, 0]))


def camera_poses(truth: list[Frame]) -> np.ndarray:
    """(N, 4, 4) of the left camera at the stamps of the scans, in its first place."""
    poses = [(base_pose(frame.stamp_ns) @ BASE_T_CAMERA).matrix() for frame in truth]
    return np.linalg.inv(poses[0]) @ poses


def make_truth() -> list[Frame]:
    rng = np.random.default_rng(5)
    frames = []
    for index in range(FRAMES):
        points = rng.uniform([-20, -20, -2, 0], [20, 20, 3, 1], (400, 4))
        points[:, 3] = np.round(points[:, 3] * 255) / 255
        grid = np.stack(np.meshgrid([-2.0, 0.1, 1.9], [-1.0, 0.05, 1.05], [6.0]), -1).reshape(-1, 3)
        turn = rotation_from_rpy(0, 0, 0.1 * index)
        place = np.array([9.0 + 0.2 * index, -1.0, -0.9])
        cuboid = Cuboid('Car', '7', Transform(turn, place), (4.1, 1.7, 1.5), None, 7)
        jitter = int(rng.integers(-3_000_000, 3_000_000))
        stamp_ns = START_NS + index * 100_000_000 + jitter
        frames.append(Frame(stamp_ns, points, lidar_t_camera().apply(grid), cuboid))
    return frames


def cloud(frame: Frame, stamp_ns: int) -> PointCloud2:
    """Organised in 4 rows with padding, big-endian, doubles; three points are NaN."""
    points = np.vstack([frame.points, np.full((4, 4), np.nan)])
    rich = np.zeros(len(points), POINT)
    for column, name in enumerate('xyz'):
        rich[name] = points[:, column]
    rich['intensity'] = np.nan_to_num(points[:, 3] * 255)
    rows = rich.reshape(4, -1)
    data = np.zeros((4, rows.shape[1] * POINT.itemsize + ROW_PADDING), np.uint8)
    data[:, :-ROW_PADDING] = rows.view(np.uint8).reshape(4, -1)
    fields = [
        PointField(name, POINT.fields[name][1], _DATATYPES[POINT.fields[name][0].str], 1)
        for name in POINT.names
    ]
    return PointCloud2(
        header=make_header(stamp_ns, 'os_sensor'),
        height=4,
        width=rows.shape[1],
        fields=fields,
        is_bigendian=True,
        point_step=POINT.itemsize,
        row_step=data.shape[1],
        data=data.ravel(),
        is_dense=False,
    )


def draw(pixels: np.ndarray) -> np.ndarray:
    """A grey image, not to be changed, with a soft white dot at each of (M, 2) places."""
    return _drawn(tuple(map(tuple, pixels.tolist())))


@lru_cache(maxsize=64)
def _drawn(places: tuple[tuple[float, float], ...]) -> np.ndarray:
    image = np.full(SIZE[::-1], 20.0)
    for u, v in places:
        left, top = int(u) - 18, int(v) - 18
        rows, columns = np.mgrid[top : top + 37, left : left + 37]
        dot = 200 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 3.0**2))
        seen = (rows >= 0) & (rows < SIZE[1]) & (columns >= 0) & (columns < SIZE[0])
        image[rows[seen], columns[seen]] += dot[seen]
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def left_image(frame: Frame) -> np.ndarray:
    """Through the distorting lens."""
    places = lidar_t_camera().inverse().apply(frame.blobs)
    pixels, _ = cv2.projectPoints(places, np.zeros(3), np.zeros(3), K, D)
    return draw(pixels[:, 0])


def right_image(frame: Frame) -> np.ndarray:
    """Rectified, a baseline to the right."""
    places = lidar_t_camera().inverse().apply(frame.blobs) - [BASELINE, 0, 0]
    pixels = places @ K_RECT.T
    return draw(pixels[:, :2] / pixels[:, 2:])


def camera_info(stamp_ns: int, frame_id: str, *, right: bool) -> CameraInfo:
    p = np.column_stack([K_RECT, [-500.0 * BASELINE if right else 0.0, 0, 0]])
    return CameraInfo(
        header=make_header(stamp_ns, frame_id),
        height=SIZE[1],
        width=SIZE[0],
        distortion_model='plumb_bob',
        d=np.zeros(5) if right else D.copy(),
        k=(K_RECT if right else K).flatten(),
        r=np.eye(3).ravel(),
        p=p.ravel(),
        binning_x=0,
        binning_y=0,
        roi=RegionOfInterest(0, 0, 0, 0, False),
    )


def links() -> list[tuple[str, str, Transform]]:
    right = Transform.from_translation((BASELINE, 0, 0))
    return [
        ('base_link', 'os_sensor', BASE_T_LIDAR),
        ('base_link', 'cam_left_optical', BASE_T_CAMERA),
        ('cam_left_optical', 'cam_right_optical', right),
        ('base_link', 'imu_sensor', BASE_T_IMU),
    ]


def rgb_image(grey: np.ndarray, stamp_ns: int, frame_id: str) -> ImageMsg:
    """rgb8 with padded rows."""
    step = SIZE[0] * 3 + 16
    data = np.zeros((SIZE[1], step), np.uint8)
    data[:, : SIZE[0] * 3] = np.repeat(grey, 3, axis=1).reshape(SIZE[1], -1)
    header = make_header(stamp_ns, frame_id)
    return ImageMsg(header, SIZE[1], SIZE[0], 'rgb8', 0, step, data.ravel())


def jpeg_image(grey: np.ndarray, stamp_ns: int, frame_id: str) -> CompressedImage:
    done, data = cv2.imencode('.jpg', cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), [1, 97])
    assert done
    header = make_header(stamp_ns, frame_id)
    return CompressedImage(header, 'bgr8; jpeg compressed bgr8', data.ravel())


def imu(stamp_ns: int, pose: Transform) -> Imu:
    unknown = np.zeros(9)
    return Imu(
        make_header(stamp_ns, 'imu_sensor'),
        make_quaternion(pose.quaternion()),
        unknown,
        make_vector3((0.01, 0.02, 0.2)),
        unknown,
        make_vector3((0.1, 0.2, 9.8)),
        unknown,
    )


def fix(stamp_ns: int, latitude: float) -> NavSatFix:
    covariance = np.diag([0.04] * 3).ravel()
    status = NavSatStatus(0, 1)
    header = make_header(stamp_ns, 'gps')
    return NavSatFix(header, status, latitude, 8.5, 110.0, covariance, 2)


def odometry(stamp_ns: int, pose: Transform) -> Odometry:
    nothing = np.zeros(36)
    twist = Twist(make_vector3((5.0, 0, 0)), make_vector3((0, 0, 0.2)))
    return Odometry(
        make_header(stamp_ns, 'odom'),
        'base_link',
        PoseWithCovariance(make_pose(pose), nothing),
        TwistWithCovariance(twist, nothing),
    )


def messages(truth: list[Frame]) -> list[tuple[str, int, object, bool]]:
    """(topic, log time, message, latched)."""
    rng = np.random.default_rng(6)
    found: list[tuple[str, int, object, bool]] = [
        ('/tf_static', START_NS - 10**9, encode_static(links(), START_NS), True)
    ]

    def add(topic: str, stamp_ns: int, message: object) -> None:
        found.append((topic, stamp_ns + int(rng.integers(0, 2_000_000)), message, False))

    for index, frame in enumerate(truth):
        stamp = frame.stamp_ns
        add('/sensors/ouster/points', stamp, cloud(frame, stamp))
        detections = encode_detections([frame.cuboid], stamp, 'os_sensor')
        add('/perception/objects', stamp, detections)
        for extra, shown in ((0, frame), (50_000_000, frame)):
            at = START_NS + index * 100_000_000 + extra + int(rng.integers(0, 4_000_000))
            add('/cam/left/image_raw', at, rgb_image(left_image(shown), at, 'cam_left_optical'))
            add('/cam/left/camera_info', at, camera_info(at, 'cam_left_optical', right=False))
            jpeg = jpeg_image(right_image(shown), at, 'cam_right_optical')
            add('/cam/right/image_rect/compressed', at, jpeg)
            add('/cam/right/camera_info', at, camera_info(at, 'cam_right_optical', right=True))
    span = FRAMES * 100
    for millisecond in range(-50, span + 50, 10):
        at = START_NS + millisecond * 1_000_000
        pose = base_pose(at)
        add('/imu/data', at, imu(at, pose))
        if millisecond % 20 == 10:
            add('/odom', at, odometry(at, pose))
        if millisecond % 200 == 150:
            add('/gps/fix', at, fix(at, 49.0 + 1e-6 * millisecond))
        if millisecond % 50 == 0:
            twist = Twist(make_vector3((5.0, 0, 0)), make_vector3((0.01, 0.02, 0.2)))
            add('/gps/vel', at, TwistStamped(make_header(at, 'imu_sensor'), twist))
    return sorted(found, key=lambda item: item[1])


def write_foreign(
    path: Path,
    truth: list[Frame],
    storage: str = 'mcap',
    *leave_out: str,
    change: Callable[[str, int, object], object] = lambda _topic, _place, message: message,
    more: Iterable[tuple[str, int, object, bool]] = (),
    **options: str,
) -> Path:
    """The bag, without some topics, with messages changed, by topic and place in it, and more.

    Options are those of BagOptions.
    """
    seen: Counter[str] = Counter()
    with open_bag(path, BagOptions(storage=storage, **options), TYPESTORE) as writer:
        channels: dict[str, int] = {}
        stored = sorted([*messages(truth), *more], key=lambda item: item[1])
        for topic, stamp_ns, message, latched in stored:
            if topic in leave_out:
                continue
            kind = getattr(message, '__msgtype__', 'vision_msgs/msg/Detection3DArray')
            if topic not in channels:
                channel = Channel(topic, kind, latched=latched, depth=1 if latched else 10)
                channels[topic] = writer.add_channel(channel)
            changed = change(topic, seen[topic], message)
            seen[topic] += 1
            parts = changed if isinstance(changed, tuple) else serialize(changed)
            writer.write(channels[topic], stamp_ns, (join(parts),))
    return path
