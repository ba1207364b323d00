# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the message types of the topics that a plan names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..messages.source import LABEL_LINES
from ..model import msgtypes as types
from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .plan import Plan
    from .survey import Survey

_IMAGES = (types.IMAGE, types.COMPRESSED)
_LABELS = (
    types.DETECTIONS_3D,
    types.TRACKED_OBJECTS,
    types.DETECTED_OBJECTS,
    types.MARKERS,
    types.DETECTIONS_2D,
)
_VELOCITIES = (types.TWIST, types.ODOMETRY)


def check_types(plan: Plan, survey: Survey) -> None:
    """Check that messages of a plan's topics can be decoded as what the plan uses them for.

    Topics without messages, scans, poses and CameraInfos are checked where they are used.

    Raises:
        UsageError: The type of one is another; the error names the key.
    """
    for key, name, expected in _uses(plan):
        topic = survey.topics.get(name) if name else None  # a bag may have a topic of no name
        if topic is not None and topic.count and topic.msgtype not in expected:
            raise UsageError(
                f'{key}: {name} is of type {topic.msgtype}; expected {", ".join(expected)}'
            )


def _uses(plan: Plan) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield the key, the topic and the valid types of each use of a topic."""
    for index, camera in plan.cameras.items():
        yield f'cameras.{index}.topic', camera.topic, _IMAGES
    if plan.labels is not None and plan.labels.topic != LABEL_LINES:
        yield 'labels.topic', plan.labels.topic, _LABELS
    yield 'imu', plan.imu, (types.IMU,)
    yield 'fix', plan.fix, (types.FIX,)
    yield 'velocity', plan.velocity, _VELOCITIES
