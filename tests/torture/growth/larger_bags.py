# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's bag in which one kind of thing is there N times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from bags.bag_samples import random_message
from foreign import (
    START_NS,
    base_pose,
    camera_info,
    cloud,
    imu,
    jpeg_image,
    make_truth,
    odometry,
    write_foreign,
)

from kitti_ros2.messages.camera_info import encode_static
from kitti_ros2.messages.cdr import make_header, make_pose
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.ros_types import TYPESTORE, Path, PointField, PoseStamped, String
from kitti_ros2.model.bag_formats import MARKERS
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform

if TYPE_CHECKING:
    import pathlib
    from collections.abc import Callable, Iterable, Iterator

    Stored = tuple[str, int, object, bool]

TRUTH = make_truth()
LAST_NS = TRUTH[-1].stamp_ns
CUBE, TEXT = 1, 9


def _place(number: int) -> Transform:
    """One of places in front of the robot."""
    return Transform.from_translation((5.0 + number % 40, number % 17 - 8.0, 0.3))


def _link(parent: str, number: int) -> tuple[str, str, Transform]:
    return parent, f'part_{number}', _place(number)


def static_links(count: int) -> Iterator[Stored]:
    links = [_link('base_link', number) for number in range(count)]
    yield '/tf_static', START_NS, encode_static(links, START_NS), True


def trees(count: int) -> Iterator[Stored]:
    links = [_link(f'root_{number}', number) for number in range(count)]
    yield '/tf_static', START_NS, encode_static(links, START_NS), True


def moving_links(count: int) -> Iterator[Stored]:
    for at in (START_NS, LAST_NS):
        links = [(parent, child, _place(at % 7)) for parent, child, _ in
                 (_link('base_link', number) for number in range(count))]  # fmt: skip
        yield '/tf', at, encode_static(links, at), False


def transforms(count: int) -> Iterator[Stored]:
    for at in np.linspace(START_NS, LAST_NS, count, dtype=np.int64).tolist():
        yield '/tf', at, encode_static([('odom', 'base_link', base_pose(at))], at), False


def samples_of_an_imu(count: int) -> Iterator[Stored]:
    for at in np.linspace(START_NS, LAST_NS, count, dtype=np.int64).tolist():
        yield '/imu/second', at, imu(at, base_pose(at)), False


def frames(count: int) -> Iterator[Stored]:
    for number in range(count):
        at = LAST_NS + number * 1_000_000
        yield '/sensors/ouster/points', at, cloud(TRUTH[0], at), False


def topics(count: int) -> Iterator[Stored]:
    for number in range(count):
        yield f'/said_{number}', START_NS, String('anything'), False


def odometry_topics(count: int) -> Iterator[Stored]:
    for number in range(count):
        for at in (START_NS, LAST_NS):
            yield f'/odom_{number}', at, odometry(at, base_pose(at)), False


def scan_topics(count: int) -> Iterator[Stored]:
    for number in range(count):
        yield f'/lidar_{number}', START_NS, cloud(TRUTH[0], START_NS), False


def cameras(count: int) -> Iterator[Stored]:
    grey = np.zeros((8, 8), np.uint8)
    for number in range(count):
        frame = f'cam_{number}'
        info = camera_info(START_NS, frame, right=True)
        yield f'/{frame}/camera_info', START_NS, info, False
        picture = jpeg_image(grey, START_NS, frame)
        yield f'/{frame}/image/compressed', START_NS, picture, False


def boxes_of_a_frame(count: int) -> Iterator[Stored]:
    boxes = [
        Cuboid('Car', str(number), _place(number), (4.0, 1.7, 1.5), None, number)
        for number in range(count)
    ]
    for each in TRUTH:
        at = each.stamp_ns
        yield '/second/objects', at, encode_detections(boxes, at, 'os_sensor'), False


def _markers(kind: int, count: int) -> Any:
    rng = np.random.default_rng(1)
    markers = []
    for number in range(count):
        marker = random_message(TYPESTORE, 'visualization_msgs/msg/Marker', rng)
        marker.header = make_header(START_NS, 'os_sensor')
        marker.ns, marker.id, marker.type, marker.action = 'car', number, kind, 0
        marker.text, marker.pose = f'Car {number}', make_pose(_place(number))
        markers.append(marker)
    return TYPESTORE.types[MARKERS](markers)


def cubes(count: int) -> Iterator[Stored]:
    yield '/cubes', START_NS, _markers(CUBE, count), False


def captions(count: int) -> Iterator[Stored]:
    yield '/captions', START_NS, _markers(TEXT, count), False


def poses_of_a_path(count: int) -> Iterator[Stored]:
    poses = [
        PoseStamped(make_header(START_NS + number, 'odom'), make_pose(_place(number)))
        for number in range(count)
    ]
    yield '/path', START_NS, Path(make_header(START_NS, 'odom'), poses), False


def fields_of_a_scan(count: int) -> Iterator[Stored]:
    for each in TRUTH:
        made = cloud(each, each.stamp_ns)
        extra = [PointField(f'field_{number}', 0, PointField.UINT8, 1) for number in range(count)]
        made.fields = [*made.fields, *extra]
        yield '/sensors/second/points', each.stamp_ns, made, False


def numbers_of_a_lens(count: int) -> Iterator[Stored]:
    info = camera_info(START_NS, 'cam_left_optical', right=False)
    info.d = np.zeros(count)
    yield '/cam/third/camera_info', START_NS, info, False


def text(count: int) -> Iterator[Stored]:
    yield '/text', START_NS, String('a line\n' * count), False


KINDS: dict[Callable[[int], Iterator[Stored]], int] = {
    static_links: 5_000, trees: 5_000, moving_links: 5_000, transforms: 10_000,
    samples_of_an_imu: 10_000, frames: 400, topics: 5_000, odometry_topics: 1_000,
    scan_topics: 200, cameras: 200, boxes_of_a_frame: 500, cubes: 2_000, captions: 2_000,
    poses_of_a_path: 10_000, fields_of_a_scan: 2_000, numbers_of_a_lens: 100_000, text: 200_000,
}  # fmt: skip
"""How many at first: enough to see, above the start of a command."""


def write_larger(path: pathlib.Path, more: Iterable[Stored] = ()) -> pathlib.Path:
    """Write the bag with more messages; compressed, so that few bytes hold much."""
    return write_foreign(path.with_suffix('.mcap'), TRUTH, more=more, compression='zstd')
