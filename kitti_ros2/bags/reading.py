# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A message read from a bag, and a channel that messages are read from.

Nothing that outlives a message refers to the chunk that it was read from: one number that is kept
would keep megabytes. Small messages have bytes of their own. Large ones are views of their chunk,
for it takes long to copy them: see Decoder.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

    from .pieces import StoredChannel

LENT_FROM = 2**16
"""Bytes of the smallest message that may be a view of its chunk."""


class BagMessage(NamedTuple):
    """One message.

    Attributes:
        topic: Topic name.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        stamp_ns: Log time, nanoseconds since 1970.
        data: CDR with its encapsulation header; ROS 1 messages are converted. A memoryview is of a
            chunk: what is kept of it must be copied. After BagMessages.skim perhaps only its
            MessageStart.
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
