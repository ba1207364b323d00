# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that records more than KITTI has a place for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import clocks_apart as base
import numpy as np
from rosbags.typesys import get_types_from_msg

if TYPE_CHECKING:
    from pathlib import Path

_DEFINITIONS = {
    'livox_ros_driver2/msg/CustomMsg': 'std_msgs/Header header\nuint64 timebase\nuint32 point_num',
    'velodyne_msgs/msg/VelodyneScan': 'std_msgs/Header header',
    'radar_msgs/msg/RadarScan': 'std_msgs/Header header',
    'vision_msgs/msg/Detection2DArray': 'std_msgs/Header header',
    'acme_msgs/msg/Widget': 'int32 value',
}
for _name, _text in _DEFINITIONS.items():
    if _name not in base.STORE.types:
        base.STORE.register(get_types_from_msg(_text, _name))
TYPES = base.STORE.types

COUNTS = {
    '/livox/lidar': ('livox_ros_driver2/msg/CustomMsg', 3),
    '/velodyne_packets': ('velodyne_msgs/msg/VelodyneScan', 4),
    '/radar': ('radar_msgs/msg/RadarScan', 5),
    '/yolo/detections': ('vision_msgs/msg/Detection2DArray', 6),
    '/particles': ('geometry_msgs/msg/PoseArray', 7),
    '/scan': ('sensor_msgs/msg/LaserScan', 8),
    '/depth/image_raw': ('sensor_msgs/msg/Image', 9),
    '/widget': ('acme_msgs/msg/Widget', 2),
    '/widget/second': ('acme_msgs/msg/Widget', 1),
    '/rosout': ('rcl_interfaces/msg/Log', 11),
    '/parameter_events': ('rcl_interfaces/msg/ParameterEvent', 12),
    '/diagnostics': ('diagnostic_msgs/msg/DiagnosticArray', 13),
}


def message(msgtype: str, stamp_ns: int) -> Any:
    """A message without content."""
    header, empty = base.header(stamp_ns, 'there'), np.zeros(0, np.float32)
    name = msgtype.rpartition('/')[2]
    if name == 'Widget':
        return TYPES[msgtype](1)
    if name == 'CustomMsg':
        return TYPES[msgtype](header, 0, 0)
    if name in {'PoseArray', 'DiagnosticArray'}:
        return TYPES[msgtype](header, [])
    if name == 'LaserScan':
        return TYPES[msgtype](header, *[0.0] * 7, empty, empty)
    if name == 'Image':
        return TYPES[msgtype](header, 2, 2, '16UC1', 0, 4, np.zeros(8, np.uint8))
    if name == 'Log':
        return TYPES[msgtype](header.stamp, 20, 'node', 'text', 'file', 'function', 1)
    if name == 'ParameterEvent':
        return TYPES[msgtype](header.stamp, 'node', [], [], [])
    if name == 'Detection2DArray' and len(TYPES[msgtype].__dataclass_fields__) > 2:
        return TYPES[msgtype](header, [])
    return TYPES[msgtype](header)


def write(path: Path) -> Path:
    found = base.messages(base.Robot())
    for topic, (msgtype, count) in COUNTS.items():
        for place in range(count):
            at = base.START_NS + place * base.PERIOD_NS
            found.append((topic, at, message(msgtype, at)))
    return base.write(path, sorted(found, key=lambda each: each[1]))
