# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The message types that a survey looks at."""

from __future__ import annotations

from ..messages.scan_sources import SCAN_TYPES
from ..model import msgtypes as types
from ..model.channels import LARGE_TYPES

_SOLID_BOXES = frozenset({types.DETECTIONS_3D, types.DETECTED_OBJECTS, types.TRACKED_OBJECTS})
BOXES = _SOLID_BOXES | {types.DETECTIONS_2D}
"""Types with boxes that begin with a Header."""

SOLID = _SOLID_BOXES | {types.MARKERS}
"""Types with 3D boxes."""

HEADED = SCAN_TYPES | BOXES
HEADED |= {
    types.IMAGE,
    types.COMPRESSED,
    types.CAMERA_INFO,
    types.IMU,
    types.FIX,
    types.TWIST,
    types.ODOMETRY,
    types.POSE,
    types.PATH,
}
"""Types that begin with a Header."""

DESCRIBING = types.TF_TYPES | BOXES | {types.CAMERA_INFO, types.MARKERS, types.STRING}
"""Types that describe the sensors, or what they see."""

READ = HEADED | types.TF_TYPES | {types.MARKERS}
"""Types of which some messages are decoded."""

FIRST_ONLY = LARGE_TYPES | SCAN_TYPES
"""Types of which a glance reads the first message."""
