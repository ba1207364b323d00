# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels -> vision_msgs/Detection3DArray and Detection2DArray: the data, for programs.

A detection's id is the track id, or the box's place in its file; the same box has the same id in
both arrays. Ground truth has score 1, predictions their own. Covariances are zero, unknown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .cdr_writer import CdrWriter
from .header import pose_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Box, Cuboid
    from .cdr import Parts

_TRUTH_SCORE = 1.0
_UNKNOWN = (0.0,) * 36
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NO_TURN = 0.0


def encode_detections(cuboids: Sequence[Cuboid], stamp_ns: int, frame_id: str) -> Parts:
    """Make a Detection3DArray of cuboids, serialised; its frame is velo_link."""
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.uint32(len(cuboids))
    for cuboid in cuboids:
        pose = pose_numbers(cuboid.velo_T_box)
        cdr.header(stamp_ns, frame_id)
        _add_result(cdr, cuboid.kind, cuboid.score, pose)
        cdr.float64((*pose, *cuboid.size_lwh))
        cdr.text(cuboid.identity)
    return (cdr.finish(),)


def encode_boxes_2d(boxes: Sequence[tuple[str, Box]], stamp_ns: int, frame_id: str) -> Parts:
    """Make a Detection2DArray of the 2D boxes of labels, DontCare included, serialised.

    Args:
        boxes: Each with its id.
        stamp_ns: Nanoseconds.
        frame_id: The optical frame of the camera whose pixels they are.
    """
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.uint32(len(boxes))
    for identity, box in boxes:
        left, top, right, bottom = box.box_2d
        cdr.header(stamp_ns, frame_id)
        _add_result(cdr, box.kind, box.score, _NO_POSE)
        middle = ((left + right) / 2, (top + bottom) / 2)
        cdr.float64((*middle, _NO_TURN, right - left, bottom - top))
        cdr.text(identity)
    return (cdr.finish(),)


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


def _add_result(cdr: CdrWriter, kind: str, score: float | None, pose: tuple[float, ...]) -> None:
    """Write the results of a detection: one ObjectHypothesisWithPose."""
    cdr.uint32(1)
    cdr.text(kind)
    cdr.float64((_TRUTH_SCORE if score is None else score, *pose, *_UNKNOWN))
