# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What rosbags reads of the messages that the encoders write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kitti_ros2.messages.cdr import deserialize, join, serialize

if TYPE_CHECKING:
    from kitti_ros2.messages.cdr import Parts


def decoded(parts: Parts, msgtype: str) -> Any:
    """Decode the CDR of a message, which is what rosbags would have written, too."""
    data = join(parts)
    message = deserialize(data, msgtype)
    assert join(serialize(message)) == data
    return message
