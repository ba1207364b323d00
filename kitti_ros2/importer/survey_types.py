# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The message types that a survey looks at."""

from __future__ import annotations

from ..messages.scan_sources import SCAN_TYPES
from ..model.channels import LARGE_TYPES
from ..model.msgtypes import (
    CAMERA_INFO,
    COMPRESSED,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    FIX,
    IMAGE,
    IMU,
    MARKERS,
    ODOMETRY,
    PATH,
    POSE,
    STRING,
    TF_TYPES,
    TRACKED_OBJECTS,
    TWIST,
)

_SOLID_BOXES = frozenset({DETECTIONS_3D, DETECTED_OBJECTS, TRACKED_OBJECTS})
_BOXES = _SOLID_BOXES | {DETECTIONS_2D}

SOLID = _SOLID_BOXES | {MARKERS}
"""Types with 3D boxes."""

HEADED = SCAN_TYPES | _BOXES
HEADED |= {IMAGE, COMPRESSED, CAMERA_INFO, IMU, FIX, TWIST, ODOMETRY, POSE, PATH}
"""Types that begin with a Header."""

DESCRIBING = TF_TYPES | _BOXES | {CAMERA_INFO, MARKERS, STRING}
"""Types that describe the sensors, or what they see."""

READ = HEADED | TF_TYPES | {MARKERS}
"""Types of which some messages are decoded."""

FIRST_ONLY = LARGE_TYPES | SCAN_TYPES
"""Types of which a glance reads the first message."""
