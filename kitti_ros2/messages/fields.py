# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Check that the definition of a type in a bag has the required fields.

Definitions differ between distributions, ROS 1 and forks. Additional fields are ignored; missing
ones, or those of another kind, would cause errors later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from rosbags.interfaces import Nodetype

from .ros_types import TYPESTORE

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Basename, FieldDesc
    from rosbags.typesys.store import Typestore

# Unused fields, or those with other names in other versions, which the decoders handle.
_OPTIONAL = {
    'livox_ros_driver/msg/CustomMsg': {'timebase', 'point_num', 'lidar_id', 'rsvd'},
    'livox_ros_driver/msg/CustomPoint': {'offset_time', 'tag', 'line'},
    'livox_ros_driver2/msg/CustomMsg': {'timebase', 'point_num', 'lidar_id', 'rsvd'},
    'livox_ros_driver2/msg/CustomPoint': {'offset_time', 'tag', 'line'},
    'velodyne_msgs/msg/VelodynePacket': {'stamp'},
    'nav_msgs/msg/Odometry': {'twist'},
    'sensor_msgs/msg/PointCloud2': {'is_dense'},
    'vision_msgs/msg/BoundingBox2D': {'center'},
    'vision_msgs/msg/Detection2D': {'id'},
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
# Numbers that have other places in other versions; all of one version are needed.
_VERSIONS = {
    'vision_msgs/msg/BoundingBox2D': (
        ('center.position.x', 'center.position.y', 'center.theta'),
        ('center.x', 'center.y', 'center.theta'),
    ),
}


def lacking_field(typestore: Typestore, msgtype: str) -> str:
    """Return the first missing field or one of another kind, such as header.stamp; empty for none.

    Types that this package does not know have no required fields.
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
    versions = _VERSIONS.get(msgtype, ())
    if not versions or any(
        all(_is_number(typestore, msgtype, place) for place in places) for places in versions
    ):
        return ''
    return versions[0][0]


def _is_number(typestore: Typestore, msgtype: str, place: str) -> bool:
    """Whether a message has a number at a place such as center.x."""
    name, _, inner = place.partition('.')
    fields = dict(typestore.fielddefs[msgtype][1]) if msgtype in typestore.fielddefs else {}
    kind, detail = fields.get(name, (None, ''))
    if inner:
        nested = str(detail)
        return kind == Nodetype.NAME and _is_number(typestore, nested, inner)
    return kind == Nodetype.BASE and cast('tuple[Basename, int]', detail)[0] != 'string'


def _lacking_within(typestore: Typestore, field: FieldDesc) -> str:
    kind, detail = field
    if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        return _lacking_within(typestore, cast('tuple[FieldDesc, int]', detail)[0])
    return lacking_field(typestore, str(detail)) if kind == Nodetype.NAME else ''


def _is_alike(field: FieldDesc, expected: FieldDesc) -> bool:
    """Whether both are numbers, texts, the same message, or arrays of these."""
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
