# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 1 as CDR."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from .pieces import Buffer


def ros1_to_cdr(typestore: Typestore, data: Buffer, msgtype: str) -> memoryview:
    """Convert a message of ROS 1 to CDR.

    Args:
        typestore: Has its type.
        data: The message as stored.
        msgtype: The name of its type.

    Raises:
        Exception: The message is damaged; the generated code may raise anything.
    """
    bounded = copy(typestore)
    # The code for items that are messages reads past the end, as often as a damaged length says.
    bounded.max_sequence_length = max(len(data), 1)
    return bounded.ros1_to_cdr(data, msgtype)
