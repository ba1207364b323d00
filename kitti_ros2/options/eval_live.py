# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the evaluation of a running stack."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..model import msgtypes as types
from ..model.containers import CONTAINERS
from ..model.errors import UsageError
from ..model.spelling import not_one_of
from .declare import check_bounds, choice, option
from .eval_odometry import Alignment
from .parsers import parse_flag, parse_integer, parse_path, parse_text
from .playback import MOST_SUBSCRIBERS
from .quantity_parsers import parse_seconds_ns

if TYPE_CHECKING:
    from pathlib import Path

_TOPIC = re.compile(r'(/[A-Za-z_]\w*)+', re.ASCII)
_BOXES = ('detection', 'tracking')
_POSES = ('odometry',)
TASKS = {
    types.DETECTIONS_3D: _BOXES,
    types.DETECTIONS_2D: _BOXES,
    types.DETECTED_OBJECTS: _BOXES,
    types.TRACKED_OBJECTS: _BOXES[::-1],
    types.MARKERS: _BOXES,
    types.ODOMETRY: _POSES,
    types.POSE: _POSES,
    types.PATH: _POSES,
}
"""By message type the evaluations of such results, the usual one first."""


@dataclass(frozen=True)
class LiveOptions:
    """Options of the evaluation of a running stack.

    Attributes:
        topic: The topic with its results.
        node: The command that starts it; None if it is started otherwise.
        msgtype: The type of the topic; None takes that of its publisher.
        task: The evaluation; None is the usual one for the type.
        align: How poses are aligned before they are scored.
        start_timeout_ns: Nanoseconds within which the node must publish the topic and subscribe.
        timeout_ns: Nanoseconds without an answer after which the run ends.
        wait_for: Nodes that must subscribe before it begins.
        out: The bag of the results; None keeps none.
        overwrite: Whether existing files may be replaced.

    Raises:
        UsageError: The topic is missing, or a value is invalid.
    """

    group: ClassVar = 'Live'

    topic: str = option(
        '', 'Topic with the results of the node', parse_text, unset='required', metavar='TOPIC'
    )
    node: str | None = option(
        None,
        'Command that starts the node, in quotes',
        parse_text,
        unset='none: it is started otherwise',
        metavar='COMMAND',
    )
    msgtype: str | None = option(
        None,
        'Type of the topic, such as vision_msgs/msg/Detection3DArray',
        parse_text,
        name='type',
        unset='that of its publisher',
        metavar='TYPE',
    )
    task: str | None = option(
        None,
        'What is scored',
        parse_text,
        unset="by the topic's type",
        choices=(*_BOXES, *_POSES),
    )
    align: Alignment = choice(
        Alignment.FIRST, 'Alignment of poses; sim3, scale: segments are scaled, too', Alignment
    )
    start_timeout_ns: int = option(
        60_000_000_000,
        'Seconds until the topic must have a publisher, and the player its subscribers',
        parse_seconds_ns,
        name='start_timeout',
        bounds=(1.0, 3600.0),
    )
    timeout_ns: int = option(
        30_000_000_000,
        'Seconds without an answer that end the run',
        parse_seconds_ns,
        name='timeout',
        bounds=(1.0, 3600.0),
    )
    wait_for: int = option(
        1,
        'Wait until so many nodes subscribe, and 1 s more without a new subscription',
        parse_integer,
    )
    out: Path | None = option(
        None,
        'Bag of the results to write, with the transforms',
        parse_path,
        unset='none',
        flags=('--out', '-o'),
        metavar='BAG',
    )
    overwrite: bool = option(False, 'Replace existing files', parse_flag)

    def __post_init__(self) -> None:
        if not self.topic:
            raise UsageError('--topic is missing, the topic with the results of the node')
        if not _TOPIC.fullmatch(self.topic):
            raise UsageError(f'{self.topic!r} is no full name of a topic, such as /my/detections')
        if self.task not in {None, *_BOXES, *_POSES}:
            raise not_one_of('task', self.task, (*_BOXES, *_POSES))
        if self.msgtype is not None:
            self.task_of(self.msgtype)
        self._check_out()
        check_bounds(self, 'start_timeout', 'timeout')
        if not 1 <= self.wait_for <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 1 to {MOST_SUBSCRIBERS}')

    def _check_out(self) -> None:
        """Refuse names of files that only a rosbag2 directory contains."""
        inner = {each.suffix for each in CONTAINERS.values() if not each.in_file}
        if self.out is not None and self.out.suffix in inner:
            raise UsageError(
                f'{self.out}: results are written as MCAP or ROS 1; give'
                f' {self.out.with_suffix(CONTAINERS["mcap"].suffix)}'
            )

    def known_task(self) -> str | None:
        """Return the evaluation if the options name it or the type; None if the topic decides."""
        return self.task if self.msgtype is None else self.task_of(self.msgtype)

    def task_of(self, msgtype: str) -> str:
        """Return the evaluation of results of a type.

        Raises:
            UsageError: Such messages are no results, or not those of the requested evaluation.
        """
        tasks = TASKS.get(msgtype)
        if tasks is None:
            raise UsageError(
                f'{self.topic} is {msgtype}, which cannot be scored; expected one of'
                f' {", ".join(TASKS)}'
            )
        if self.task is not None and self.task not in tasks:
            raise UsageError(
                f'{self.topic} is {msgtype}, which cannot be scored as {self.task}; expected'
                f' --task {" or ".join(tasks)}'
            )
        task = self.task or tasks[0]
        if self.align is not Alignment.FIRST and task not in _POSES:
            raise UsageError(f'--align is for poses; {self.topic} is scored as {task}')
        return task
