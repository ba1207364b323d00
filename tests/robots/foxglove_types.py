# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of foxglove_msgs for the tests, without comments and constants.

The fields are those of https://github.com/foxglove/foxglove-sdk, schemas/ros2 (MIT).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_STAMPED = 'builtin_interfaces/Time timestamp|string frame_id'
_SHAPE = 'geometry_msgs/Pose pose|geometry_msgs/Vector3 size|foxglove_msgs/Color color'

DEFINITIONS = {
    'CameraCalibration': (
        f'{_STAMPED}|uint32 width|uint32 height|string distortion_model|float64[] d|float64[9] k'
        '|float64[9] r|float64[12] p'
    ),
    'Color': 'float64 r|float64 g|float64 b|float64 a',
    'CompressedImage': f'{_STAMPED}|uint8[] data|string format',
    'CubePrimitive': _SHAPE,
    'FrameTransform': (
        'builtin_interfaces/Time timestamp|string parent_frame_id|string child_frame_id'
        '|geometry_msgs/Vector3 translation|geometry_msgs/Quaternion rotation'
    ),
    'FrameTransforms': 'foxglove_msgs/FrameTransform[] transforms',
    'KeyValuePair': 'string key|string value',
    'LinePrimitive': (
        'uint8 type|geometry_msgs/Pose pose|float64 thickness|bool scale_invariant'
        '|geometry_msgs/Point[] points|foxglove_msgs/Color color|foxglove_msgs/Color[] colors'
        '|uint32[] indices'
    ),
    'LocationFix': (
        f'{_STAMPED}|float64 latitude|float64 longitude|float64 altitude'
        '|float64[9] position_covariance|uint8 position_covariance_type'
    ),
    'PackedElementField': 'string name|uint32 offset|uint8 type',
    'PointCloud': (
        f'{_STAMPED}|geometry_msgs/Pose pose|uint32 point_stride'
        '|foxglove_msgs/PackedElementField[] fields|uint8[] data'
    ),
    'SceneEntity': (
        f'{_STAMPED}|string id|builtin_interfaces/Duration lifetime|bool frame_locked'
        '|foxglove_msgs/KeyValuePair[] metadata|foxglove_msgs/CubePrimitive[] cubes'
        '|foxglove_msgs/LinePrimitive[] lines|foxglove_msgs/TextPrimitive[] texts'
    ),
    'SceneEntityDeletion': 'builtin_interfaces/Time timestamp|uint8 type|string id',
    'SceneUpdate': (
        'foxglove_msgs/SceneEntityDeletion[] deletions|foxglove_msgs/SceneEntity[] entities'
    ),
    'TextPrimitive': (
        'geometry_msgs/Pose pose|bool billboard|float64 font_size|bool scale_invariant'
        '|foxglove_msgs/Color color|string text'
    ),
}
"""By name the lines of the .msg file, separated by |; SceneEntity without its other shapes."""


def foxglove_store() -> Typestore:
    """The types of ROS 2 Jazzy and those above."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in DEFINITIONS.items():
        types.update(get_types_from_msg(text.replace('|', '\n'), f'foxglove_msgs/msg/{name}'))
    store.register(types)
    return store
