# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The roles that topics of a bag play in a data set, a row each: types, stream, key in the plan."""

from __future__ import annotations

from dataclasses import dataclass

from ..messages.scan_sources import SCAN_TYPES
from ..model import bag_formats as types
from ..model.streams import Stream


@dataclass(frozen=True)
class Role:
    """What a topic can be for a data set.

    Attributes:
        key: In the plan: of the part that names the topic, or in that part.
        stream: KITTI's stream that is made of it; of a camera that of its number.
        msgtypes: The types that a plan is guessed from, the preferred ones first.
        more_types: Others that a plan may name.
        advice: What can be done with a topic of these types that a plan does not use.
    """

    key: str
    stream: Stream
    msgtypes: tuple[str, ...] = ()
    more_types: tuple[str, ...] = ()
    advice: str = ''

    @property
    def every_type(self) -> tuple[str, ...]:
        """The types that a plan may name."""
        return (*self.msgtypes, *self.more_types)


_UNIT_ADVICE = 'for oxts of the layouts raw and tracking: name the topic in imu, fix or velocity'

SCAN = Role(
    'scan',
    Stream.SCAN,
    (types.CLOUD,),
    tuple(sorted(SCAN_TYPES - {types.CLOUD})),
    'scans: name the topic in scan.topic',
)
IMAGES = Role(
    'cameras',
    Stream.IMAGE_2,
    (types.IMAGE, types.COMPRESSED),
    advice='images: name the topic in cameras',
)
INFO = Role(
    'info',
    Stream.CALIBRATION,
    (types.CAMERA_INFO,),
    advice='calibration of images that are not used',
)
POSES = Role(
    'pose',
    Stream.POSE,
    (types.ODOMETRY, types.POSE, types.PATH),
    advice='poses: for the layouts odometry, raw and tracking: name the topic in pose.topic',
)
LABELS = Role(
    'labels',
    Stream.LABELS,
    (types.DETECTIONS_3D, types.TRACKED_OBJECTS, types.DETECTED_OBJECTS, types.MARKERS),
    (types.DETECTIONS_2D,),
    '3D boxes: for labels of the layouts object, raw and tracking: name the topic in labels.topic',
)
BOXES_2D = Role('boxes_2d', Stream.LABELS, more_types=(types.DETECTIONS_2D,))
IMU = Role('imu', Stream.OXTS, (types.IMU,), advice=_UNIT_ADVICE)
FIX = Role('fix', Stream.OXTS, (types.FIX,), advice=_UNIT_ADVICE)
VELOCITY = Role('velocity', Stream.OXTS, (types.TWIST,), (types.ODOMETRY,), _UNIT_ADVICE)

UNIT = (IMU, FIX, VELOCITY)
"""Roles of the GPS/IMU unit, which have no part in the plan: the key is the topic's."""
ROLES = (SCAN, IMAGES, INFO, POSES, LABELS, BOXES_2D, *UNIT)
"""The table; transforms have no row, for a plan uses all of them."""


# The message types that a survey reads.


SOLID = frozenset(LABELS.msgtypes)
"""Types with 3D boxes."""

BOXES = frozenset(LABELS.every_type) - {types.MARKERS}
"""Types with boxes that begin with a Header."""

_PLANNED = frozenset(msgtype for role in ROLES for msgtype in role.every_type)

HEADED = _PLANNED - {types.MARKERS}
"""Types that begin with a Header."""

READ = _PLANNED | types.TF_TYPES
"""Types of which some messages are decoded."""

DESCRIBING = types.TF_TYPES | SOLID | BOXES | {types.CAMERA_INFO, types.STRING}
"""Types that describe the sensors, or what they see."""

FIRST_ONLY = types.LARGE_TYPES | SCAN_TYPES
"""Types of which a glance reads the first message."""
