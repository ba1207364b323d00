# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels <-> vision_msgs/Detection3DArray and Detection2DArray: the data, for programs.

A detection's id is the track id, or the box's place in its file; the same box has the same id in
both arrays. Ground truth has score 1, predictions their own. Covariances are zero, unknown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__PoseWithCovariance as PoseWithCovariance,
)

from ..boxes import Cuboid
from ..geometry import Transform
from .cdr import typestore
from .header import Pose, Vector3, make_header, make_pose, transform_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..boxes import Box

_TRUTH_SCORE = 1.0
_UNKNOWN = np.zeros(36)
_IDENTITY = Transform.identity()


def encode_detections(cuboids: Sequence[Cuboid], stamp_ns: int, frame_id: str) -> Any:  # noqa: ANN401 - a class built at run time
    """A Detection3DArray of cuboids; its frame is velo_link."""
    header = make_header(stamp_ns, frame_id)
    detections = []
    for cuboid in cuboids:
        pose = make_pose(cuboid.velo_T_box)
        box = _new('BoundingBox3D', center=pose, size=Vector3(*cuboid.size_lwh))
        results = [_hypothesis(cuboid.kind, cuboid.score, pose)]
        detections.append(
            _new('Detection3D', header=header, results=results, bbox=box, id=cuboid.identity)
        )
    return _new('Detection3DArray', header=header, detections=detections)


def decode_detections(message: Any, *, scores: bool = False) -> list[Cuboid]:  # noqa: ANN401
    """The inverse of encode_detections.

    Args:
        message: A Detection3DArray in velo_link; the first result counts.
        scores: Whether the scores mean something, as those of predictions do.
    """
    cuboids = []
    for detection in message.detections:
        hypothesis = detection.results[0].hypothesis
        size = detection.bbox.size
        cuboids.append(
            Cuboid(
                hypothesis.class_id,
                detection.id,
                transform_of(detection.bbox.center),
                (size.x, size.y, size.z),
                hypothesis.score if scores else None,
            )
        )
    return cuboids


def encode_boxes_2d(boxes: Sequence[tuple[str, Box]], stamp_ns: int, frame_id: str) -> Any:  # noqa: ANN401 - a class built at run time
    """A Detection2DArray of the 2D boxes of labels, DontCare included.

    Args:
        boxes: Each with its id.
        stamp_ns: Nanoseconds.
        frame_id: The optical frame of the camera whose pixels they are.
    """
    header = make_header(stamp_ns, frame_id)
    origin = make_pose(_IDENTITY)
    detections = []
    for identity, box in boxes:
        left, top, right, bottom = box.box_2d
        middle = _new('Point2D', x=(left + right) / 2, y=(top + bottom) / 2)
        bounds = _new(
            'BoundingBox2D',
            center=_new('Pose2D', position=middle, theta=0.0),
            size_x=right - left,
            size_y=bottom - top,
        )
        results = [_hypothesis(box.kind, box.score, origin)]
        detections.append(
            _new('Detection2D', header=header, results=results, bbox=bounds, id=identity)
        )
    return _new('Detection2DArray', header=header, detections=detections)


def decode_boxes_2d(message: Any) -> list[tuple[str, str, tuple[float, float, float, float]]]:  # noqa: ANN401
    """(id, class, (left, top, right, bottom)) of each detection; the inverse of encode_boxes_2d."""
    found = []
    for detection in message.detections:
        place, box = detection.bbox.center.position, detection.bbox
        bounds = (
            place.x - box.size_x / 2,
            place.y - box.size_y / 2,
            place.x + box.size_x / 2,
            place.y + box.size_y / 2,
        )
        found.append((detection.id, detection.results[0].hypothesis.class_id, bounds))
    return found


def _hypothesis(kind: str, score: float | None, pose: Pose) -> Any:  # noqa: ANN401
    known = _TRUTH_SCORE if score is None else score
    return _new(
        'ObjectHypothesisWithPose',
        hypothesis=_new('ObjectHypothesis', class_id=kind, score=known),
        pose=PoseWithCovariance(pose, _UNKNOWN),
    )


def _new(name: str, **fields: object) -> Any:  # noqa: ANN401
    return typestore().types[f'vision_msgs/msg/{name}'](**fields)  # type: ignore[arg-type]
