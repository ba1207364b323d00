# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot whose detector names classes in its own way: a Detection3DArray, a box of each class."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import clocks_apart as base
import numpy as np
from rosbags.typesys import get_types_from_msg
from vision_types import DETECTIONS_3D

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

for _name, _text in DETECTIONS_3D.items():
    base.STORE.register(get_types_from_msg(_text, _name))
TYPES = base.STORE.types


def detection(name: str, place: int, header: Any, identity: str) -> Any:
    """A box in view, 10 m ahead and further; its width is 1 m and place cm."""
    pose = TYPES['geometry_msgs/msg/Pose'](
        TYPES['geometry_msgs/msg/Point'](10.0 + place / 4, 0.0, 0.0),
        TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
    )
    result = TYPES['vision_msgs/msg/ObjectHypothesisWithPose'](
        TYPES['vision_msgs/msg/ObjectHypothesis'](name, 1.0),
        TYPES['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
    )
    size = TYPES['geometry_msgs/msg/Vector3'](2.0, 1.0 + place / 100, 1.5)
    bounds = TYPES['vision_msgs/msg/BoundingBox3D'](pose, size)
    return TYPES['vision_msgs/msg/Detection3D'](header, [result], bounds, identity)


def write(path: Path, names: Sequence[str], identity: str = '') -> Path:
    """All classes in every message, but the last of them in the last message only.

    Each box has an id of its own, unless one for all is given.
    """
    found = base.messages(replace(base.Robot(), latency_ns=(1_000_000, 1_000_000)))
    for number in range(base.FRAMES):
        stamp = base.START_NS + number * base.PERIOD_NS
        header = base.header(stamp, 'lidar')
        shown = names if number == base.FRAMES - 1 else names[:-1]
        boxes = [
            detection(name, place, header, identity or str(place))
            for place, name in enumerate(shown)
        ]
        array = TYPES['vision_msgs/msg/Detection3DArray'](header, boxes)
        found.append(('/detections', stamp + 80_000_000, array))
    return base.write(path, sorted(found, key=lambda each: each[1]))
