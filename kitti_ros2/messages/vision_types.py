# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The message definitions of vision_msgs 4, which rosbags does not bring.

Source: the msg folder of vision_msgs 4.1 (Apache-2.0), without its comments, which are no part of
a type's hash.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.typesys import get_types_from_msg

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

_DEFINITIONS = {
    'Point2D': 'float64 x\nfloat64 y\n',
    'Pose2D': 'vision_msgs/Point2D position\nfloat64 theta\n',
    'BoundingBox2D': 'vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n',
    'BoundingBox3D': 'geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n',
    'ObjectHypothesis': 'string class_id\nfloat64 score\n',
    'ObjectHypothesisWithPose': (
        'vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n'
    ),
    'Detection2D': (
        'std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n'
        'vision_msgs/BoundingBox2D bbox\nstring id\n'
    ),
    'Detection2DArray': 'std_msgs/Header header\nvision_msgs/Detection2D[] detections\n',
    'Detection3D': (
        'std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n'
        'vision_msgs/BoundingBox3D bbox\nstring id\n'
    ),
    'Detection3DArray': 'std_msgs/Header header\nvision_msgs/Detection3D[] detections\n',
}


def vision_types() -> Typesdict:
    """The definitions, to be registered in a typestore."""
    types: Typesdict = {}
    for name, text in _DEFINITIONS.items():
        types.update(get_types_from_msg(text, f'vision_msgs/msg/{name}'))
    return types
