# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of robots with cameras all around, by rosbags' own writer, with exact truth.

The truth is in the robot's body frame: x forward, y left, z up, metres. Everything that a data set
should contain is computed from it with plain matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from math import cos, pi, sin
from typing import TYPE_CHECKING

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from vision_types import DETECTIONS_3D

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from rosbags.typesys.store import Typestore

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000
FRAMES = 3
SIZE = (320, 240)
K = np.array([[200.0, 0, 158.5], [0, 201.0, 121.25], [0, 0, 1]])
OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Columns: x, y, z of an optical frame in axes x forward, y left, z up."""


def turned(yaw_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """(3, 3): yaw to the left, then pitch down."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    about_z = np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])
    about_y = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    return about_z @ about_y


def pose(rotation: np.ndarray, xyz: tuple[float, float, float]) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation, xyz
    return made


def looking(yaw_deg: float, xyz: tuple[float, float, float], pitch_deg: float = 0.0) -> np.ndarray:
    """base_T_camera of an optical frame that looks to a side."""
    return pose(turned(yaw_deg, pitch_deg) @ OPTICAL, xyz)


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera: its topics are FOLDER/IMAGE and FOLDER/INFO.

    Attributes:
        base_T_camera: (4, 4) of the optical frame.
        k: Of the images, which are rectified.
        offset_m: Of P's fourth column, along x: minus the baseline of a right camera.
        r: Of its CameraInfo.
        raw_k: K of its CameraInfo, where it is another one.
        d: Of its CameraInfo.
        size: Of its CameraInfo.
    """

    folder: str
    frame: str
    base_T_camera: np.ndarray
    image: str = 'image_rect_color'
    encoding: str = 'bgr8'
    k: np.ndarray = field(default_factory=K.copy)
    offset_m: float = 0.0
    info: str = 'camera_info'
    r: np.ndarray = field(default_factory=lambda: np.eye(3))
    raw_k: np.ndarray | None = None
    d: tuple[float, ...] = (0.0,) * 5
    size: tuple[int, int] = SIZE

    @property
    def topic(self) -> str:
        return f'{self.folder}/{self.image}'

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) true pixels of points of the body, NaN where they are not seen."""
        seen = moved(np.linalg.inv(self.base_T_camera), points)
        with np.errstate(invalid='ignore', divide='ignore'):
            pixels = (seen @ self.k.T)[:, :2] / seen[:, 2:]
        inside = (pixels >= 0).all(axis=1) & (pixels <= np.array(SIZE) - 1).all(axis=1)
        return np.where((inside & (seen[:, 2] > 0.5))[:, None], pixels, np.nan)


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot that stands still.

    Attributes:
        links: (parent, child, parent_T_child) of /tf_static.
        base_T_lidar: (4, 4) of the frame of the points.
        with_boxes: Whether it has detections, in the frame of the points.
        swinging: Children of links that move, so that they are on /tf.
    """

    cameras: tuple[Camera, ...]
    links: tuple[tuple[str, str, np.ndarray], ...]
    lidar: str = 'lidar'
    base_T_lidar: np.ndarray = field(default_factory=lambda: np.eye(4))
    with_boxes: bool = True
    lidar_topic: str = '/lidar/points'
    swinging: tuple[str, ...] = ()

    def camera(self, folder: str) -> Camera:
        return next(camera for camera in self.cameras if camera.folder == folder)

    def without(self, *folders: str) -> Robot:
        kept = tuple(camera for camera in self.cameras if camera.folder not in folders)
        return replace(self, cameras=kept)


def moved(a_T_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ a_T_b[:3, :3].T + a_T_b[:3, 3]


def boxes() -> list[tuple[np.ndarray, tuple[float, float, float], float]]:
    """Centre in the body, size (l, w, h), yaw: ahead, left, behind, right."""
    places = [(9.0, 0.8, 0.2), (-1.0, 8.5, 0.3), (-9.5, -0.7, 0.1), (0.5, -9.0, 0.4)]
    return [
        (np.array(place), (3.9, 1.6, 1.5), 0.3 + 0.9 * number)
        for number, place in enumerate(places)
    ]


def inside(points: np.ndarray, box: tuple) -> np.ndarray:
    centre, size, yaw = box
    local = (points - centre) @ turned(np.degrees(yaw))
    return (np.abs(local) <= np.array(size) / 2).all(axis=1)


@cache
def world() -> np.ndarray:
    """(N, 3) points of the body, all around and in the boxes, none near a box's face."""
    rng = np.random.default_rng(19)
    everywhere = rng.uniform([-20, -20, -2], [20, 20, 3], (1500, 3))
    parts = [everywhere[np.linalg.norm(everywhere[:, :2], axis=1) > 3]]
    for centre, size, yaw in boxes():
        local = rng.uniform(-0.5, 0.5, (60, 3)) * size
        parts.append(centre + local @ turned(np.degrees(yaw)).T)
    points = np.vstack(parts)
    clear = np.ones(len(points), dtype=bool)
    for centre, size, yaw in boxes():
        wide = inside(points, (centre, np.array(size) + 0.02, yaw))
        clear &= wide == inside(points, (centre, np.array(size) - 0.02, yaw))
    return points[clear]


@cache
def store(release: Stores = Stores.ROS2_HUMBLE) -> Typestore:
    made = get_typestore(release)
    types = {}
    for name, text in DETECTIONS_3D.items():
        types |= get_types_from_msg(text, name)
    if release is Stores.ROS1_NOETIC:
        text = 'geometry_msgs/TransformStamped[] transforms'
        types |= get_types_from_msg(text, 'tf2_msgs/msg/TFMessage')
    made.register(types)
    return made


class _Messages:
    """Makes messages of a robot with rosbags' own types."""

    def __init__(self, stamp_ns: int, release: Stores = Stores.ROS2_HUMBLE) -> None:
        self.stamp_ns = stamp_ns
        self.is_ros1 = release is Stores.ROS1_NOETIC
        self._types = store(release).types

    def make(self, kind: str, **values: object) -> object:
        return self._types[kind](**values)

    def header(self, frame: str) -> object:
        seconds, nanoseconds = divmod(self.stamp_ns, 10**9)
        stamp = self.make('builtin_interfaces/msg/Time', sec=seconds, nanosec=nanoseconds)
        seq = {'seq': 0} if self.is_ros1 else {}
        return self.make('std_msgs/msg/Header', **seq, stamp=stamp, frame_id=frame)

    def vector(self, xyz: np.ndarray, kind: str = 'Vector3') -> object:
        x, y, z = (float(each) for each in xyz)
        return self.make(f'geometry_msgs/msg/{kind}', x=x, y=y, z=z)

    def quaternion(self, rotation: np.ndarray) -> object:
        x, y, z, w = xyzw(rotation)
        return self.make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)

    def transforms(self, links: tuple) -> object:
        found = []
        for parent, child, parent_T_child in links:
            placed = self.make(
                'geometry_msgs/msg/Transform',
                translation=self.vector(parent_T_child[:3, 3]),
                rotation=self.quaternion(parent_T_child[:3, :3]),
            )
            kind = 'geometry_msgs/msg/TransformStamped'
            found.append(
                self.make(kind, header=self.header(parent), child_frame_id=child, transform=placed)
            )
        return self.make('tf2_msgs/msg/TFMessage', transforms=found)

    def cloud(self, frame: str, points: np.ndarray) -> object:
        values = np.column_stack([points, np.full(len(points), 0.5)]).astype(np.float32)
        fields = [
            self.make(
                'sensor_msgs/msg/PointField', name=name, offset=4 * place, datatype=7, count=1
            )
            for place, name in enumerate(('x', 'y', 'z', 'intensity'))
        ]
        return self.make(
            'sensor_msgs/msg/PointCloud2', header=self.header(frame), height=1, width=len(values),
            fields=fields, is_bigendian=False, point_step=16, row_step=16 * len(values),
            data=values.view(np.uint8).ravel(), is_dense=True,
        )  # fmt: skip

    def image(self, camera: Camera) -> object:
        channels = 1 if camera.encoding == 'mono8' else 3
        data = np.full(SIZE[0] * SIZE[1] * channels, 60, np.uint8)
        if 'compressed' in camera.image:
            _, data = cv2.imencode('.jpg', data.reshape(SIZE[1], SIZE[0], channels))
            return self.make(
                'sensor_msgs/msg/CompressedImage', header=self.header(camera.frame),
                format='jpeg', data=data.ravel(),
            )  # fmt: skip
        return self.make(
            'sensor_msgs/msg/Image', header=self.header(camera.frame), height=SIZE[1],
            width=SIZE[0], encoding=camera.encoding, is_bigendian=0, step=SIZE[0] * channels,
            data=data,
        )  # fmt: skip

    def info(self, camera: Camera) -> object:
        p = np.column_stack([camera.k, camera.k @ [camera.offset_m, 0, 0]])
        k = camera.k if camera.raw_k is None else camera.raw_k
        numbers = {'d': np.array(camera.d), 'k': k.ravel(), 'r': camera.r.ravel(), 'p': p.ravel()}
        if self.is_ros1:
            numbers = {name.upper(): values for name, values in numbers.items()}
        roi = self.make(
            'sensor_msgs/msg/RegionOfInterest',
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        return self.make(
            'sensor_msgs/msg/CameraInfo',
            header=self.header(camera.frame),
            height=camera.size[1],
            width=camera.size[0],
            distortion_model='plumb_bob',
            binning_x=0,
            binning_y=0,
            roi=roi,
            **numbers,
        )

    def detections(self, robot: Robot) -> object:
        lidar_T_base = np.linalg.inv(robot.base_T_lidar)
        found = []
        for number, (centre, size, yaw) in enumerate(boxes()):
            placed = lidar_T_base @ pose(turned(np.degrees(yaw)), tuple(centre))
            centre_pose = self.make(
                'geometry_msgs/msg/Pose',
                position=self.vector(placed[:3, 3], 'Point'),
                orientation=self.quaternion(placed[:3, :3]),
            )
            unknown = self.make(
                'geometry_msgs/msg/PoseWithCovariance', pose=centre_pose, covariance=np.zeros(36)
            )
            car = self.make('vision_msgs/msg/ObjectHypothesis', class_id='Car', score=1.0)
            result = self.make(
                'vision_msgs/msg/ObjectHypothesisWithPose', hypothesis=car, pose=unknown
            )
            box = self.make(
                'vision_msgs/msg/BoundingBox3D', center=centre_pose, size=self.vector(size)
            )
            found.append(
                self.make(
                    'vision_msgs/msg/Detection3D',
                    header=self.header(robot.lidar),
                    results=[result],
                    bbox=box,
                    id=str(number),
                )
            )
        return self.make(
            'vision_msgs/msg/Detection3DArray', header=self.header(robot.lidar), detections=found
        )


def write(
    robot: Robot,
    path: Path,
    leave_out: tuple[tuple[str, int | None], ...] = (),
    change_info: Callable[[Camera], Camera] = lambda camera: camera,
    ahead_ns: Mapping[str, int] | None = None,
) -> Path:
    """Write FRAMES messages of each topic to a bag: of ROS 1 if its name ends in .bag, else MCAP.

    Args:
        robot: The robot.
        path: Of the bag.
        leave_out: Messages to leave out: topic and frame, None for all.
        change_info: Changes the camera that a CameraInfo describes.
        ahead_ns: By folder of a camera, how far its clock is ahead.
    """
    is_ros1 = path.suffix == '.bag'
    types = store(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    serialize = types.serialize_ros1 if is_ros1 else types.serialize_cdr
    new = Writer1(path) if is_ros1 else Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    with new as bag:
        channels: dict[str, object] = {}
        for topic, stamp_ns, message in _messages(
            robot, change_info, ahead_ns or {}, is_ros1=is_ros1
        ):
            number = (stamp_ns - START_NS) // PERIOD_NS
            if {(topic, number), (topic, None)} & set(leave_out):
                continue
            kind = message.__msgtype__
            if topic not in channels:
                channels[topic] = bag.add_connection(topic, kind, typestore=types)
            bag.write(channels[topic], stamp_ns, serialize(message, kind))
    return path


def _messages(
    robot: Robot,
    change_info: Callable[[Camera], Camera],
    ahead_ns: Mapping[str, int],
    *,
    is_ros1: bool,
) -> Iterator[tuple[str, int, object]]:
    release = Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE
    still = [link for link in robot.links if link[1] not in robot.swinging]
    if still:
        yield '/tf_static', START_NS, _Messages(START_NS, release).transforms(still)
    points = moved(np.linalg.inv(robot.base_T_lidar), world())
    for number in range(FRAMES):
        stamp_ns = START_NS + number * PERIOD_NS
        made = _Messages(stamp_ns, release)
        for parent, child, place in robot.links:
            if child in robot.swinging:
                swung = pose(turned(5.0 * number), (0.0, 0.0, 0.0)) @ place
                yield '/tf', stamp_ns, made.transforms([(parent, child, swung)])
        yield robot.lidar_topic, stamp_ns, made.cloud(robot.lidar, points)
        if robot.with_boxes:
            yield '/detections', stamp_ns, made.detections(robot)
        for camera in robot.cameras:
            made = _Messages(stamp_ns + ahead_ns.get(camera.folder, 0), release)
            yield camera.topic, stamp_ns, made.image(camera)
            yield f'{camera.folder}/{camera.info}', stamp_ns, made.info(change_info(camera))


def xyzw(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """The quaternion of a rotation, by the eigenvector of Bar-Itzhack's matrix."""
    m = rotation
    symmetric = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    )
    _, vectors = np.linalg.eigh(symmetric / 3)
    x, y, z, w = (float(each) for each in vectors[:, -1])
    return x, y, z, w


# The data set.


@dataclass(frozen=True)
class KittiFrame:
    """A frame as loaders read it, without this package."""

    calib: dict[str, np.ndarray]
    points: np.ndarray
    labels: list[list[str]]


def read_frame(split: Path, number: int) -> KittiFrame:
    lines = (split / f'calib/{number:06d}.txt').read_text().splitlines()
    calib = {
        key: np.array(values.split(), float).reshape(3, -1)
        for key, _, values in (line.partition(':') for line in lines if line)
    }
    points = np.fromfile(split / f'velodyne/{number:06d}.bin', np.float32).reshape(-1, 4)
    label = split / f'label_2/{number:06d}.txt'
    labels = [line.split() for line in label.read_text().splitlines()] if label.is_file() else []
    return KittiFrame(calib, points[:, :3].astype(float), labels)


def assert_true(split: Path, camera: Camera, number: int = 2, *, index: int = 2) -> KittiFrame:
    """Assert that a frame of an object set is right: x ahead, pixels, labels.

    Args:
        split: Of the data set.
        camera: The camera that became image_INDEX.
        number: Of the frame.
        index: KITTI's number of the camera.
    """
    assert (split / f'image_{index}/{number:06d}.png').is_file()
    frame = read_frame(split, number)
    velo_T_base = _rotation_between(world(), frame.points)
    assert velo_T_base[0, 0] > cos(pi / 6), 'x is not forward'
    assert velo_T_base[2, 2] > cos(pi / 6), 'z is not up'
    tr = np.vstack([frame.calib['Tr_velo_to_cam'], [0, 0, 0, 1]])
    r0 = np.eye(4)
    r0[:3, :3] = frame.calib['R0_rect']
    rect = moved(r0 @ tr, frame.points)
    true = camera.pixels(world())
    seen = np.isfinite(true[:, 0])
    assert seen.sum() > 20
    p = frame.calib[f'P{index}']
    projected = moved(np.vstack([p, [0, 0, 0, 1]]), rect[seen])
    error = projected[:, :2] / projected[:, 2:3] - true[seen]
    assert np.abs(error).max() < 0.3
    assert (rect[seen, 2] > 0).all()
    for label in frame.labels:
        _assert_label(label, rect)
    return frame


def _assert_label(label: list[str], rect: np.ndarray) -> None:
    """A label contains exactly the points of one true box."""
    h, w, length, x, y, z, ry = map(float, label[8:15])
    assert z > 0
    turn = np.array([[cos(ry), 0, sin(ry)], [0, 1, 0], [-sin(ry), 0, cos(ry)]])
    local = (rect - [x, y - h / 2, z]) @ turn
    held = (np.abs(local) <= np.array([length, h, w]) / 2).all(axis=1)
    assert any((held == inside(world(), box)).all() for box in boxes())


def _rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, 3) b_R_a of two sets of the same points (Kabsch)."""
    u, _, vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    return vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
