# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detect cars, cyclists and pedestrians in scans: a ROS 2 node to copy from, not to compete with.

python examples/cluster_detector.py

Removes the ground, joins occupied cells of a grid to clusters, and fits an upright box to each. It
answers every scan on /kitti/velo/points with a Detection3DArray on /cluster_detector/detections,
in the frame and with the stamp of the scan.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform
from kitti_ros2.player.message_types import message_class

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]
    Integers = npt.NDArray[np.int64]

RANGE_M = 60.0
GROUND_CELL_M, CELL_M = 2.0, 0.3
STEPS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]  # to a cell and around it
LOWEST_M, HIGHEST_M = 0.3, 2.8  # of points of objects, above the ground
LEAST_POINTS = 8
YAWS = np.radians(np.arange(0, 90, 3))
# By class: least and most length, width and height; the usual length and width.
CLASSES = {
    'Car': ((1.4, 5.8), (0.0, 2.6), (0.9, 2.3)),
    'Cyclist': ((1.1, 2.2), (0.1, 1.1), (1.2, 2.2)),
    'Pedestrian': ((0.2, 1.1), (0.1, 1.0), (1.0, 2.2)),
}
WIDEST_CAR_M = 2.2
USUAL = {'Car': (3.9, 1.6), 'Cyclist': (1.7, 0.6), 'Pedestrian': (0.8, 0.6)}


def xyz_of(cloud: Any) -> Floats:
    """Return the (N, 3) finite points of a PointCloud2 within RANGE_M."""
    xyz = read_points(cloud, None)[:, :3].astype(np.float64)
    return xyz[np.isfinite(xyz).all(axis=1) & (np.abs(xyz[:, :2]) < RANGE_M).all(axis=1)]


def cells_of(xyz: Floats, size_m: float) -> tuple[Integers, Integers, int]:
    """Return row and column of each point in a grid with an empty border, and the grid's side."""
    rows, columns = np.floor((xyz[:, :2] + RANGE_M) / size_m).astype(np.int64).T + 1
    return rows, columns, int(np.ceil(2 * RANGE_M / size_m)) + 2


def heights_above_ground(xyz: Floats) -> Floats:
    """Return the height of each point above the lowest one of the cells around it."""
    rows, columns, side = cells_of(xyz, GROUND_CELL_M)
    lowest = np.full((side, side), np.inf)
    np.minimum.at(lowest, (rows, columns), xyz[:, 2])
    ground: Floats = np.minimum.reduce([np.roll(lowest, step, axis=(0, 1)) for step in STEPS])
    return xyz[:, 2] - ground[rows, columns]


def clusters_of(xyz: Floats) -> list[Integers]:
    """Return the indices of the points of each cluster: occupied cells that touch."""
    rows, columns, side = cells_of(xyz, CELL_M)
    cells, cell_of = np.unique(rows * side + columns, return_inverse=True)
    index = np.full(side * side, -1)
    index[cells] = np.arange(len(cells))
    touching = index[cells[:, None] + [row * side + column for row, column in STEPS]]
    touching = np.where(touching < 0, np.arange(len(cells))[:, None], touching)
    labels = np.arange(len(cells))
    while True:  # the smallest label spreads over all cells that touch
        spread = labels[touching].min(axis=1)
        spread = spread[spread]
        if (spread == labels).all():
            break
        labels = spread
    of_points = labels[cell_of]
    order = np.argsort(of_points, kind='stable')
    return np.split(order, np.flatnonzero(np.diff(of_points[order])) + 1)


def class_of(*size: float) -> str | None:
    """Return the first class that has objects of a length, width and height."""
    for class_name, spans in CLASSES.items():
        if all(least <= side <= most for side, (least, most) in zip(size, spans, strict=True)):
            return class_name
    return None


def fit_box(identity: str, xyz: Floats, above: Floats) -> Cuboid | None:
    """Fit the smallest upright box to a cluster; None if its size is that of no class.

    Only the sides that face the scanner are measured: a box that is smaller than usual grows away
    from it.
    """
    along = np.stack([np.cos(YAWS), np.sin(YAWS)])  # (2, yaws)
    across = np.stack([-along[1], along[0]])
    u, v = xyz[:, :2] @ along, xyz[:, :2] @ across
    best = int(np.argmin(np.ptp(u, axis=0) * np.ptp(v, axis=0)))
    axes, sides = np.stack([along[:, best], across[:, best]]), np.stack([u[:, best], v[:, best]])
    height = float(above.max())
    extent = np.ptp(sides, axis=1)
    class_name = class_of(extent.max(), extent.min(), height)
    if class_name is None:
        return None
    is_end = class_name == 'Car' and extent.max() < WIDEST_CAR_M  # the front or the rear alone
    if (extent[0] < extent[1]) != is_end:
        axes, sides = np.stack([axes[1], -axes[0]]), np.stack([sides[1], -sides[0]])
    low, high = sides.min(axis=1), sides.max(axis=1)
    grown = np.maximum(USUAL[class_name], high - low) - (high - low)
    behind = np.where(low > 0, 0.0, np.where(high < 0, 1.0, 0.5))
    low, high = low - grown * behind, high + grown * (1 - behind)
    x, y = (low + high) / 2 @ axes
    z = xyz[:, 2].max() - height / 2
    half_yaw = np.arctan2(axes[0, 1], axes[0, 0]) / 2
    place = Transform.from_quaternion((0, 0, np.sin(half_yaw), np.cos(half_yaw)), (x, y, z))
    length, width = (high - low).tolist()
    score = len(xyz) / (len(xyz) + 50)
    return Cuboid(class_name, identity, place, (length, width, height), score)


def detect(xyz: Floats) -> list[Cuboid]:
    """Return the objects in the (N, 3) points of a scan, in its frame."""
    above = heights_above_ground(xyz)
    kept = (above > LOWEST_M) & (above < HIGHEST_M)
    xyz, above = xyz[kept], above[kept]
    if not len(xyz):
        return []
    clusters = (each for each in clusters_of(xyz) if len(each) >= LEAST_POINTS)
    boxes = (fit_box(str(n), xyz[each], above[each]) for n, each in enumerate(clusters))
    return [box for box in boxes if box is not None]


class ClusterDetector(Node):  # type: ignore[misc] # rclpy has no types
    """Answers each scan with the objects in it."""

    def __init__(self) -> None:
        super().__init__('cluster_detector')
        # The class of vision_msgs if it is installed, else one that is made at run time.
        kind = message_class('vision_msgs/msg/Detection3DArray', TYPESTORE)
        self.publisher = self.create_publisher(kind, '~/detections', 10)
        self.create_subscription(PointCloud2, '/kitti/velo/points', self.answer, 10)

    def answer(self, cloud: Any) -> None:
        """Publish the objects in a scan."""
        stamp, frame = cloud.header.stamp, cloud.header.frame_id
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        (data,) = encode_detections(detect(xyz_of(cloud)), stamp_ns, frame)
        self.publisher.publish(bytes(data))


def main() -> None:
    """Run until the node is stopped."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(ClusterDetector())


if __name__ == '__main__':
    main()
