# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Estimate the motion of the scanner with KISS-ICP: a lidar odometry node.

pip install "kiss-icp>=1.2"
python examples/kiss_icp_odometry.py

Answers every scan on /kitti/velo/points with an Odometry on /kiss_icp_odometry/odometry: the pose
of the scan's frame in odom, with the stamp of the scan. Points are compensated for motion if they
have a field `time` (play --ring-time), seconds.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from kiss_icp.config import load_config
from kiss_icp.kiss_icp import KissICP
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from kitti_ros2.messages.clouds import read_field, read_points
from kitti_ros2.model.geometry import Transform

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]


def times_of(cloud: Any) -> Floats:
    """Return the (N,) time of each point, 0 at the first and 1 at the last; () without times."""
    if all(field.name != 'time' for field in cloud.fields):
        return np.empty(0)
    times: Floats = read_field(cloud, 'time').astype(np.float64)
    times -= times.min()
    return times / max(float(times.max()), 1e-9)


class KissIcpOdometry(Node):  # type: ignore[misc] # rclpy has no types
    """Answers each scan with the pose of the scanner."""

    def __init__(self) -> None:
        super().__init__('kiss_icp_odometry')
        self.odometry = KissICP(load_config(None))
        self.publisher = self.create_publisher(Odometry, '~/odometry', 10)
        self.create_subscription(PointCloud2, '/kitti/velo/points', self.answer, 10)

    def answer(self, cloud: Any) -> None:
        """Publish the pose at a scan."""
        points = read_points(cloud, None)[:, :3].astype(np.float64)
        finite = np.isfinite(points).all(axis=1)
        times = times_of(cloud)
        self.odometry.register_frame(points[finite], times[finite] if len(times) else times)
        pose = Transform.from_matrix(self.odometry.last_pose)
        message = Odometry()
        message.header.stamp = cloud.header.stamp
        message.header.frame_id = 'odom'
        message.child_frame_id = cloud.header.frame_id
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        place.x, place.y, place.z = pose.translation.tolist()
        turn.x, turn.y, turn.z, turn.w = pose.quaternion().tolist()
        self.publisher.publish(message)


def main() -> None:
    """Run until the node is stopped."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(KissIcpOdometry())


if __name__ == '__main__':
    main()
