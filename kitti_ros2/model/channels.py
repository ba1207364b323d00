# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Channels: topics with message type and QoS, whether played, written or stored."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..model.msgtypes import CLOUD, COMPRESSED, IMAGE

PICTURES = frozenset({COMPRESSED, IMAGE})
"""Types of images."""

LARGE_TYPES = PICTURES | {CLOUD}
"""Types of messages of a megabyte and more."""


@dataclass(frozen=True)
class Channel:
    """A topic with its message type and QoS.

    Attributes:
        topic: Full topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        latched: Whether late subscribers receive the last messages: QoS transient local.
        depth: History depth of the offered QoS (keep last).
    """

    topic: str
    msgtype: str
    latched: bool = field(default=False, kw_only=True)
    depth: int = field(default=10, kw_only=True)

    @property
    def on_demand(self) -> bool:
        """Whether its messages are large, so that a player encodes them for subscribers only."""
        return self.msgtype in LARGE_TYPES
