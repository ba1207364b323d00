# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a type as a bag defines it has the fields that are read of it.

Definitions differ between distributions, ROS 1 and forks. What one has more does not matter; what
it lacks, or has of another kind, would fail somewhere later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from rosbags.interfaces import Nodetype

from .ros_types import TYPESTORE

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Basename, FieldDesc
    from rosbags.typesys.store import Typestore

# Fields that nothing is made of, or that have had other names: the code that reads them knows.
_OPTIONAL = {
    'nav_msgs/msg/Odometry': {'twist'},
    'sensor_msgs/msg/PointCloud2': {'is_dense'},
    'vision_msgs/msg/Detection3D': {'id'},
    'vision_msgs/msg/ObjectHypothesisWithPose': {'hypothesis', 'pose'},
    'visualization_msgs/msg/Marker': {
        'lifetime',
        'frame_locked',
        'color',
        'points',
        'colors',
        'texture_resource',
        'texture',
        'uv_coordinates',
        'mesh_resource',
        'mesh_file',
        'mesh_use_embedded_materials',
    },
}


def lacking_field(typestore: Typestore, msgtype: str) -> str:
    """The first field that a type lacks or has of another kind, as in header.stamp; empty for none.

    Types that this package does not know lack nothing.
    """
    if msgtype not in TYPESTORE.fielddefs:
        return ''
    if msgtype not in typestore.fielddefs:
        return msgtype
    fields = dict(typestore.fielddefs[msgtype][1])
    optional = _OPTIONAL.get(msgtype, set())
    for name, expected in TYPESTORE.fielddefs[msgtype][1]:
        if name in optional:
            continue
        if name not in fields or not _is_alike(fields[name], expected):
            return name
        inner = _lacking_within(typestore, fields[name])
        if inner:
            return f'{name}.{inner}'
    return ''


def _lacking_within(typestore: Typestore, field: FieldDesc) -> str:
    kind, detail = field
    if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        return _lacking_within(typestore, cast('tuple[FieldDesc, int]', detail)[0])
    return lacking_field(typestore, str(detail)) if kind == Nodetype.NAME else ''


def _is_alike(field: FieldDesc, expected: FieldDesc) -> bool:
    """Whether both are numbers, texts, the same message, or rows of such."""
    kind, detail = field
    if kind != expected[0]:
        return False
    if kind == Nodetype.BASE:
        names = [cast('tuple[Basename, int]', each[1])[0] for each in (field, expected)]
        return (names[0] == 'string') == (names[1] == 'string')
    if kind == Nodetype.NAME:
        return detail == expected[1]
    inner, size = cast('tuple[FieldDesc, int]', detail)
    expected_inner, expected_size = cast('tuple[FieldDesc, int]', expected[1])
    same_size = kind == Nodetype.SEQUENCE or size == expected_size
    return same_size and _is_alike(inner, expected_inner)
