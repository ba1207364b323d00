# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels -> vision_msgs/Detection3DArray and Detection2DArray; any of these -> boxes.

A detection's id is the track id, or the box's place in its file; the same box has the same id in
both arrays. Ground truth has score 1, predictions their own. Covariances are zero, unknown.
"""

from __future__ import annotations

from math import cos, isfinite, nan, sin
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.boxes import Cuboid
from ..model.geometry import Transform
from .cdr_writer import CdrWriter
from .header import pose_numbers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from ..model.boxes import Box
    from .cdr import Parts

ABSURD = 'without a possible size, place or score'
UNPLACED = 'in a frame that nothing joins to the scans'

_TRUTH_SCORE = 1.0
_UNKNOWN = (0.0,) * 36
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NO_TURN = 0.0
_TRUTH_SCORES = frozenset({0.0, 1.0})
_FARTHEST_M = 1e5  # from the scanner; no sensor sees it, and no box is so large


class ImageBox(NamedTuple):
    """A 2D detection.

    Attributes:
        class_name, identity: As in Cuboid.
        box_2d: left, top, right, bottom, pixels.
        score: Detection score, None without a result.
        frame: Its frame, without a leading slash: the camera whose pixels they are.
    """

    class_name: str
    identity: str
    box_2d: tuple[float, float, float, float]
    score: float | None
    frame: str


def encode_detections(cuboids: Sequence[Cuboid], stamp_ns: int, frame_id: str) -> Parts:
    """Make a Detection3DArray of cuboids, serialised; its frame is velo_link."""
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.uint32(len(cuboids))
    for cuboid in cuboids:
        pose = pose_numbers(cuboid.velo_T_box)
        cdr.header(stamp_ns, frame_id)
        _add_result(cdr, cuboid.class_name, cuboid.score, pose)
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
        _add_result(cdr, box.class_name, box.score, _NO_POSE)
        middle = ((left + right) / 2, (top + bottom) / 2)
        cdr.float64((*middle, _NO_TURN, right - left, bottom - top))
        cdr.text(identity)
    return (cdr.finish(),)


def _add_result(
    cdr: CdrWriter, class_name: str, score: float | None, pose: tuple[float, ...]
) -> None:
    """Write the results of a detection: one ObjectHypothesisWithPose."""
    cdr.uint32(1)
    cdr.text(class_name)
    cdr.float64((_TRUTH_SCORE if score is None else score, *pose, *_UNKNOWN))


def has_scores(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether boxes are predictions: those with scores that are all 0 or 1 are ground truth."""
    scores = [each.existence_probability for each in getattr(message, 'objects', ())]
    for detection in getattr(message, 'detections', ()):
        scores += map(_score, detection.results)
    return any(score not in _TRUTH_SCORES for score in scores)


def cuboids_of_detections(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool = False,
) -> tuple[list[Cuboid], list[str]]:
    """Decode a vision_msgs/Detection3DArray to boxes in velo_link; also why others were skipped.

    The result with the best score is used. The definitions of ROS 1 and of Foxy are supported: a
    result without hypothesis, its id the class, no id or a tracking_id of the detection.

    Args:
        message: Of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether the recording has scores, even if these look like ground truth.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    scores = scores or has_scores(message)

    def make(detection: Any) -> Cuboid:  # noqa: ANN401 - as above
        class_name, identity, score = _best_result(detection)
        frame = detection.header.frame_id or message.header.frame_id
        size = detection.bbox.size
        return Cuboid(
            class_name,
            identity,
            place_in_velo(detection.bbox.center, frame, to_velo),
            (size.x, size.y, size.z),
            score if scores else None,
        )

    return placed(message.detections, make)


def boxes_of_detections_2d(message: Any) -> tuple[list[ImageBox], list[str]]:  # noqa: ANN401
    """Decode a vision_msgs/Detection2DArray; also why others were skipped.

    A rotated box becomes the upright one around it. Definitions of ROS 1 and of Foxy are supported.
    """
    boxes = []
    for detection in message.detections:
        center = detection.bbox.center
        middle = getattr(center, 'position', center)
        theta = center.theta if isfinite(center.theta) else nan
        c, s = abs(cos(theta)), abs(sin(theta))
        size = detection.bbox.size_x, detection.bbox.size_y
        across, down = (c * size[0] + s * size[1]) / 2, (s * size[0] + c * size[1]) / 2
        bounds = middle.x - across, middle.y - down, middle.x + across, middle.y + down
        class_name, identity, score = _best_result(detection)
        frame = (detection.header.frame_id or message.header.frame_id).lstrip('/')
        if min(size) > 0 and all(map(isfinite, bounds)) and isfinite(score or 0.0):
            boxes.append(ImageBox(class_name, identity, bounds, score, frame))
    return boxes, [ABSURD] * (len(message.detections) - len(boxes))


def frames_of_detections(message: Any) -> set[str]:  # noqa: ANN401 - of the bag's types
    """Return the frames of the detections of an array, without leading slashes."""
    return {
        (each.header.frame_id or message.header.frame_id).lstrip('/') for each in message.detections
    }


def _best_result(detection: Any) -> tuple[str, str, float | None]:  # noqa: ANN401 - as above
    """Return the class, empty without a result, the id and the score of a detection."""
    best = max(detection.results, key=_score, default=None)
    identity = getattr(detection, 'id', '') or getattr(detection, 'tracking_id', '')
    return (
        '' if best is None else _class(best),
        identity,
        None if best is None else _score(best),
    )


def place_in_velo(
    pose: Any,  # noqa: ANN401 - of the bag's types
    frame: str,
    to_velo: Mapping[str, Transform],
) -> Transform:
    """Convert a Pose in a frame to velo_link; an orientation of zeros is no rotation, as in RViz.

    A pose that is not finite becomes NaN.

    Raises:
        ValueError: The frame is not joined.
    """
    name = frame.lstrip('/')
    if name not in to_velo:
        raise ValueError(f'a box in frame {name!r}, which no static transform joins to the scans')
    p, q = pose.position, pose.orientation
    place, xyzw = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
    if not np.isfinite([*place, *xyzw]).all():
        found = Transform(np.full((3, 3), np.nan), np.full(3, np.nan))
    elif xyzw.any():
        found = Transform.from_quaternion(xyzw, place)
    else:
        found = Transform.from_translation(place)
    return to_velo[name] @ found


def placed(
    boxes: Iterable[Any],
    make: Callable[[Any], Cuboid],
) -> tuple[list[Cuboid], list[str]]:
    """Make the boxes of a message; also return why others were skipped: ABSURD or UNPLACED.

    Args:
        boxes: Of the bag's types.
        make: Raises ValueError for a box in a frame that is not joined.

    Raises:
        ValueError: They all are.
    """
    made, faults = [], []
    for each in boxes:
        try:
            made.append(make(each))
        except ValueError as error:
            faults.append(error)
    if faults and not made:
        raise faults[0]
    kept, left_out = possible(made)
    return kept, left_out + [UNPLACED] * len(faults)


def possible(cuboids: list[Cuboid]) -> tuple[list[Cuboid], list[str]]:
    """Return the boxes with a possible size, place and score, and ABSURD for each of the others."""
    kept = [
        each
        for each in cuboids
        if (np.abs([*each.velo_T_box.matrix().ravel(), *each.size_lwh]) < _FARTHEST_M).all()
        and min(each.size_lwh) > 0
        and (each.score is None or np.isfinite(each.score))
    ]
    return kept, [ABSURD] * (len(cuboids) - len(kept))


def _score(result: Any) -> float:  # noqa: ANN401 - of the bag's types
    score = getattr(getattr(result, 'hypothesis', result), 'score', 1.0)
    return float(score) if isinstance(score, (int, float)) else 1.0


def _class(result: Any) -> str:  # noqa: ANN401 - of the bag's types
    hypothesis = getattr(result, 'hypothesis', result)
    return str(getattr(hypothesis, 'class_id', getattr(hypothesis, 'id', '')))
