# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A message read from a bag, and a channel that messages are read from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

    from .pieces import StoredChannel


class BagMessage(NamedTuple):
    """One message.

    Attributes:
        topic: Topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        stamp_ns: Log time, nanoseconds since 1970.
        data: CDR with its encapsulation header; ROS 1 messages are converted. After
            BagMessages.skim perhaps only its MessageStart.
    """

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes | memoryview


class Reading(NamedTuple):
    """A channel that is read, with the number of its file, its id there, and bag and file."""

    number: int
    channel_id: int
    bag: Path
    file: Path
    channel: StoredChannel
