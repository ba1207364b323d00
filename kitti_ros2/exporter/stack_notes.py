# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on what a stack of --for needs and a recording does not have."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..messages.naming import naming_of
from ..stacks.stack_names import IMU, StackName

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..messages.topics import Topic
    from ..options.messages import MessageOptions
    from .schedule import Schedule


def stack_notes(
    options: MessageOptions, table: Sequence[Topic], images: str, schedule: Schedule
) -> list[str]:
    """Return what the stack of the options will miss.

    Args:
        options: Of the messages, with a stack.
        table: The rows that have messages.
        images: The last part of the names of image topics.
        schedule: The selected samples.
    """
    from ..stacks.catalogue import STACKS  # noqa: PLC0415 - for --for only

    stack, names = STACKS[StackName(options.stack).value], naming_of(options)
    rows = {row.topic: row for row in table}
    read = {
        own: names.topic(own if own in names.topics else own.replace('/image_rect', f'/{images}'))
        for own in stack.inputs
    }
    notes = [f'{stack.name} reads {topic}: no messages' for topic in read.values()
             if topic not in rows]  # fmt: skip
    imu = rows.get(read.get(IMU, ''))
    if imu is not None and stack.imu_hz:
        stamps = [entry.stamp_ns for entry in schedule if entry.stream is imu.stream]
        rate = 1e9 / float(np.median(np.diff(stamps))) if len(set(stamps)) > 1 else np.inf
        notes += stack.notes_of_imu(imu.topic, rate)
    return notes
