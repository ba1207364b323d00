# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection3DArray and the cubes of a MarkerArray -> boxes in velo_link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.boxes import Cuboid
from ..model.geometry import Transform
from .marker_boxes import class_of_marker, is_list, shown_markers

if TYPE_CHECKING:
    from collections.abc import Mapping

ABSURD = 'without a possible size, place or score'
AS_LINES = 'drawn as lines or lists of cubes'

_TRUTH_SCORES = frozenset({0.0, 1.0})
_CUBE = 1
_FARTHEST_M = 1e5  # from the scanner; no sensor sees it, and no box is so large


def has_scores(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether a Detection3DArray holds predictions: scores that are all 0 or 1 are ground truth."""
    return any(
        _score(result) not in _TRUTH_SCORES
        for detection in getattr(message, 'detections', ())
        for result in detection.results
    )


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
        ValueError: A box is in a frame that is not joined.
    """
    scores = scores or has_scores(message)
    cuboids = []
    for detection in message.detections:
        best = max(detection.results, key=_score, default=None)
        frame = detection.header.frame_id or message.header.frame_id
        identity = getattr(detection, 'id', '') or getattr(detection, 'tracking_id', '')
        size = detection.bbox.size
        cuboids.append(
            Cuboid(
                '' if best is None else _class(best),
                identity,
                _joined(to_velo, frame) @ _pose(detection.bbox.center),
                (size.x, size.y, size.z),
                _score(best) if scores and best is not None else None,
            )
        )
    return _sound(cuboids)


def cuboids_of_markers(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
) -> tuple[list[Cuboid], list[str]]:
    """Decode the cubes of a visualization_msgs/MarkerArray; also why others were skipped.

    A cube in namespace ego is the recording car. Boxes drawn as lines, and lists of cubes, are not
    supported and skipped, except for those that frame a cube of the same id.

    Raises:
        ValueError: A box is in a frame that is not joined.
    """
    shown = shown_markers(message)
    cubes = [each for each in shown if each.type == _CUBE]
    framed = {cube.id for cube in cubes}
    lists = [each for each in shown if is_list(each) and each.id not in framed]
    cuboids, left_out = _sound(
        [
            Cuboid(
                class_of_marker(cube, shown),
                f'{cube.ns}/{cube.id}',
                _joined(to_velo, cube.header.frame_id) @ _pose(cube.pose),
                (cube.scale.x, cube.scale.y, cube.scale.z),
            )
            for cube in cubes
        ]
    )
    return cuboids, left_out + [AS_LINES] * len(lists)


def _score(result: Any) -> float:  # noqa: ANN401 - of the bag's types
    return float(getattr(getattr(result, 'hypothesis', result), 'score', 1.0))


def _class(result: Any) -> str:  # noqa: ANN401 - of the bag's types
    hypothesis = getattr(result, 'hypothesis', result)
    return str(getattr(hypothesis, 'class_id', getattr(hypothesis, 'id', '')))


def _joined(to_velo: Mapping[str, Transform], frame: str) -> Transform:
    name = frame.lstrip('/')
    if name not in to_velo:
        raise ValueError(f'a box in frame {name!r}, which no static transform joins to the scans')
    return to_velo[name]


def _pose(pose: Any) -> Transform:  # noqa: ANN401 - of the bag's types
    """Convert a pose; as in RViz, an orientation of zeros is unset and means no rotation."""
    p, q = pose.position, pose.orientation
    place, xyzw = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
    if not np.isfinite([*place, *xyzw]).all():
        return Transform(np.full((3, 3), np.nan), np.full(3, np.nan))
    if not xyzw.any():
        return Transform.from_translation(place)
    return Transform.from_quaternion(xyzw, place)


def _sound(cuboids: list[Cuboid]) -> tuple[list[Cuboid], list[str]]:
    kept = [
        each
        for each in cuboids
        if (np.abs([*each.velo_T_box.matrix().ravel(), *each.size_lwh]) < _FARTHEST_M).all()
        and min(each.size_lwh) > 0
        and (each.score is None or np.isfinite(each.score))
    ]
    return kept, [ABSURD] * (len(cuboids) - len(kept))
