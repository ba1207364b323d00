# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels -> autoware_perception_msgs/DetectedObjects and TrackedObjects; any of these -> boxes.

As Autoware's own detectors fill them (autoware_universe, perception/autoware_lidar_centerpoint,
lib/ros_utils.cpp, lines 26 to 80 of commit 02ee90f): the pose is the middle of the box, dimensions
are length, width and height along its x, y and z, the score is existence_probability, and the one
classification has probability 1. KITTI's headings are known with their sign. Its labels have no
covariance, velocity or acceleration: these are zero, and marked as unknown where there is a field
for it. An object_id is a UUID of version 8 (RFC 9562) that ends with the track id.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import UUID

import numpy as np

from ..model.autoware_labels import class_of, label_of
from ..model.boxes import Cuboid
from ..model.geometry import Transform
from .cdr_writer import CdrWriter
from .detections import place_in_velo, possible
from .header import pose_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from .cdr import Parts

_BOUNDING_BOX, _CYLINDER, _POLYGON = range(3)
_ORIENTATION_AVAILABLE = 2
_TRUE = 1.0
_COVARIANCE = (0.0,) * 36
_MOTION = (0.0,) * 42
"""A TwistWithCovariance or AccelWithCovariance."""

_TRACK = struct.Struct('>12sI')
_TRACK_PREFIX = bytes.fromhex('6b6974746900 8000 80000000')
"""The UUIDs 6b697474-6900-8000-8000-0000TTTTTTTT: "kitti", version, variant, track id."""


class ObjectFrame(NamedTuple):
    """The frame that objects are given in.

    Attributes:
        name: Its frame_id.
        frame_T_velo: velo_link in it.
        labels: Names of Autoware's labels by class; see autoware_labels.label_of.
    """

    name: str
    frame_T_velo: Transform
    labels: Mapping[str, str]


def encode_detected_objects(cuboids: Sequence[Cuboid], stamp_ns: int, frame: ObjectFrame) -> Parts:
    """Make a DetectedObjects of cuboids, serialised."""
    cdr = _begin(len(cuboids), stamp_ns, frame)
    for cuboid in cuboids:
        _add_class_and_pose(cdr, cuboid, frame)
        cdr.boolean(value=False)  # has_position_covariance
        cdr.byte(_ORIENTATION_AVAILABLE)
        cdr.float64(_MOTION)
        cdr.boolean(value=False)  # has_twist
        cdr.boolean(value=False)  # has_twist_covariance
        _add_shape(cdr, cuboid)
    return (cdr.finish(),)


def encode_tracked_objects(cuboids: Sequence[Cuboid], stamp_ns: int, frame: ObjectFrame) -> Parts:
    """Make a TrackedObjects of the cuboids with a track, serialised.

    Raises:
        struct.error: A track id has more than 32 bits.
    """
    tracked = [(each, each.track_id) for each in cuboids if _has_track(each)]
    cdr = _begin(len(tracked), stamp_ns, frame)
    for cuboid, track_id in tracked:
        cdr.octets(_TRACK.pack(_TRACK_PREFIX, track_id))
        _add_class_and_pose(cdr, cuboid, frame)
        cdr.float64(_MOTION)
        cdr.float64(_MOTION)
        cdr.byte(_ORIENTATION_AVAILABLE)
        cdr.boolean(value=False)  # is_stationary
        _add_shape(cdr, cuboid)
    return (cdr.finish(),)


def _has_track(cuboid: Cuboid) -> bool:
    return cuboid.track_id is not None and cuboid.track_id >= 0


def _begin(count: int, stamp_ns: int, frame: ObjectFrame) -> CdrWriter:
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame.name)
    cdr.uint32(count)
    return cdr


def _add_class_and_pose(cdr: CdrWriter, cuboid: Cuboid, frame: ObjectFrame) -> None:
    """Write existence_probability, classification and the pose of the kinematics."""
    cdr.float32(_TRUE if cuboid.score is None else cuboid.score)
    cdr.uint32(1)
    cdr.byte(label_of(cuboid.class_name, frame.labels))
    cdr.float32(_TRUE)
    cdr.float64((*pose_numbers(frame.frame_T_velo @ cuboid.velo_T_box), *_COVARIANCE))


def _add_shape(cdr: CdrWriter, cuboid: Cuboid) -> None:
    cdr.byte(_BOUNDING_BOX)
    cdr.uint32(0)  # footprint
    cdr.float64(cuboid.size_lwh)


def cuboids_of_objects(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool = False,
) -> tuple[list[Cuboid], list[str]]:
    """Decode DetectedObjects or TrackedObjects to boxes in velo_link; also why others were skipped.

    The most probable class is used. A cylinder or a polygon becomes the box around it.

    Args:
        message: Of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether existence probabilities are scores.

    Raises:
        ValueError: The message is in a frame that is not joined.
    """
    cuboids = []
    for each in message.objects:
        pose = each.kinematics.pose_with_covariance.pose
        offset, size = _bounds(each.shape)
        best = max(each.classification, key=lambda one: one.probability, default=None)
        cuboids.append(
            Cuboid(
                '' if best is None else class_of(int(best.label)),
                _identity(each),
                place_in_velo(pose, message.header.frame_id, to_velo) @ offset,
                size,
                float(each.existence_probability) if scores else None,
            )
        )
    return possible(cuboids)


def _bounds(shape: Any) -> tuple[Transform, tuple[float, float, float]]:  # noqa: ANN401 - as above
    """Return the place of the box around a shape in the object's frame, and its size.

    The x of a cylinder is its diameter, and the footprint of a polygon is in the object's frame
    (autoware_universe, common/autoware_universe_utils/src/geometry/boost_polygon_utils.cpp,
    toPolygon2d, commit abee5b5).
    """
    size = shape.dimensions
    points = [(point.x, point.y) for point in shape.footprint.points]
    if shape.type == _CYLINDER:
        return Transform.identity(), (size.x, size.x, size.z)
    if shape.type != _POLYGON or not points:
        return Transform.identity(), (size.x, size.y, size.z)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    middle_x, middle_y = ((low + high) / 2).tolist()
    length, width = (high - low).tolist()
    return Transform.from_translation((middle_x, middle_y, 0.0)), (length, width, size.z)


def _identity(each: Any) -> str:  # noqa: ANN401 - as above
    """Return the track id of our own UUIDs, others as text; empty without one, or for zeros."""
    if not hasattr(each, 'object_id'):
        return ''
    data = bytes(each.object_id.uuid)
    prefix, track_id = _TRACK.unpack(data)
    if prefix == _TRACK_PREFIX:
        return str(track_id)
    return str(UUID(bytes=data)) if any(data) else ''
