# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection3DArray and the cubes of a MarkerArray -> KITTI labels.

A label's box stands upright in the rectified camera 0 and turns about its y axis alone: the heading
is kept, a tilt is lost. Its 2D box is the projection of its corners cut to the image, truncated is
the part that the image cuts off, occluded is 3 (unknown; readme.txt of the object devkit).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..boxes import (
    DONT_CARE,
    Box,
    Cuboid,
    alpha_of,
    box_corners,
    box_of,
    clip_bounds,
    project_corners,
    wrap_angle,
)
from ..kitti.label_file import parse_box
from ..labels import rect_from_velo
from ..messages.header import transform_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..geometry import Float64Array, Transform
    from ..samples import Calibration

_UNKNOWN = 3
_OTHERS = 'Misc'
_TRUTH_SCORES = frozenset({0.0, 1.0})
_UNSEEN = (-1.0, -1.0, -1.0, -1.0)
_CUBE = 1
_TEXT = 9
_ADD = 0
_EGO = 'ego'
_BLANKS = re.compile(r'\s+')


def cuboids_of_detections(message: Any, to_velo: Mapping[str, Transform]) -> list[Cuboid]:  # noqa: ANN401
    """The boxes of a vision_msgs/Detection3DArray in velo_link.

    The result with the best score counts; scores that are all 0 or 1 are no scores but truth.

    Args:
        message: Of the bag's own types.
        to_velo: velo_T_frame by frame name.

    Raises:
        ValueError: A box is in a frame that is not joined, or of no possible size or place.
    """
    rows = []
    for place, detection in enumerate(message.detections):
        results = [result.hypothesis for result in detection.results]
        best = max(results, key=lambda each: each.score, default=None)
        frame = detection.header.frame_id or message.header.frame_id
        pose = _joined(to_velo, frame) @ transform_of(detection.bbox.center)
        size = detection.bbox.size
        kind, score = (best.class_id, float(best.score)) if best is not None else ('', 1.0)
        identity = str(getattr(detection, 'id', '')) or str(place)
        rows.append((kind, identity, pose, (size.x, size.y, size.z), score))
    predicted = any(score not in _TRUTH_SCORES for *_, score in rows)
    return [
        _sound(Cuboid(kind, identity, pose, size, score if predicted else None))
        for kind, identity, pose, size, score in rows
    ]


def cuboids_of_markers(message: Any, to_velo: Mapping[str, Transform]) -> list[Cuboid]:  # noqa: ANN401
    """The cubes that a visualization_msgs/MarkerArray adds, in velo_link; other shapes are no box.

    The class is the cube's text, else the first word of a text marker with the same id, else the
    cube's namespace; the track is its id. A cube in namespace ego is the recording car.

    Raises:
        ValueError: As cuboids_of_detections.
    """
    added = [marker for marker in message.markers if marker.action == _ADD]
    captions = {
        marker.id: marker.text.split()[0]
        for marker in added
        if marker.type == _TEXT and marker.text.split()
    }
    return [
        _sound(
            Cuboid(
                marker.text or captions.get(marker.id, marker.ns),
                str(marker.id),
                _joined(to_velo, marker.header.frame_id) @ transform_of(marker.pose),
                (marker.scale.x, marker.scale.y, marker.scale.z),
            )
        )
        for marker in added
        if marker.type == _CUBE and marker.ns != _EGO
    ]


def _joined(to_velo: Mapping[str, Transform], frame: str) -> Transform:
    name = frame.lstrip('/')
    if name not in to_velo:
        raise ValueError(f'a box in frame {name!r}, which no static transform joins to the scans')
    return to_velo[name]


def _sound(cuboid: Cuboid) -> Cuboid:
    numbers = [*cuboid.velo_T_box.matrix().ravel(), *cuboid.size_lwh]
    if not np.isfinite(numbers).all() or min(cuboid.size_lwh) <= 0:
        size = ' '.join(f'{value:g}' for value in cuboid.size_lwh)
        raise ValueError(f'box {cuboid.identity} is of size {size}; expected positive numbers')
    return cuboid


def boxes_of_lines(text: str, tracks: TrackIds) -> list[Box]:
    """The labels of a frame as a bag of our own carries them; those without a track get one.

    Raises:
        ValueError: A line is no label.
    """
    boxes = []
    for place, line in enumerate(text.splitlines()):
        box = parse_box(line)
        if box.track_id is None:
            track = -1 if box.kind == DONT_CARE else tracks.number(f'line {place}')
            box = replace(box, track_id=track)
        boxes.append(replace(box, frame=None))
    return boxes


class TrackIds:
    """Whole numbers for the names of tracks: a number is itself, a word the next that is free."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._taken: set[int] = set()

    def number(self, identity: str) -> int:
        """The number of a track, the same each time it is asked for."""
        if identity not in self._numbers:
            number = int(identity) if identity.isdecimal() and len(identity) < 10 else None
            if number is None or number in self._taken:
                number = max(self._taken, default=-1) + 1
            self._numbers[identity] = number
            self._taken.add(number)
        return self._numbers[identity]


def make_boxes(
    cuboids: Sequence[Cuboid],
    calibration: Calibration,
    camera: int,
    size: tuple[int, int],
    tracks: TrackIds,
    *,
    out_of_view: bool = False,
) -> tuple[list[Box], int]:
    """Labels of boxes, and how many were left out because the camera does not see them.

    Args:
        cuboids: In velo_link.
        calibration: Holds the camera and where the scanner is.
        camera: KITTI index of the camera whose pixels the 2D boxes are.
        size: (width, height) of its rectified image.
        tracks: Gives track ids.
        out_of_view: Whether boxes out of view are kept, with a 2D box of -1.

    Raises:
        ValueError: The calibration lacks what is needed.
    """
    if not cuboids:
        return [], 0
    rect_t_velo = rect_from_velo(calibration)
    boxes = [box_of(cuboid, rect_t_velo) for cuboid in cuboids]
    locations = np.array([location for location, _, _ in boxes])
    sizes = np.array([size_hwl for _, size_hwl, _ in boxes])
    headings = np.array([rotation_y for *_, rotation_y in boxes])
    corners = box_corners(locations, sizes, headings)
    bounds, truncated = clip_bounds(
        project_corners(corners, calibration.cameras[camera].p_rect), size
    )
    seen = [bool(np.isfinite(four).all()) for four in bounds]
    kept = [place for place in range(len(cuboids)) if seen[place] or out_of_view]
    alphas = alpha_of(locations, headings)
    made = [
        Box(
            kind=class_name(cuboids[place].kind),
            truncated=round(float(truncated[place]), 2),
            occluded=_UNKNOWN,
            alpha=float(alphas[place]),
            box_2d=_four(bounds[place]) if seen[place] else _UNSEEN,
            size_hwl=boxes[place][1],
            location=_three(locations[place]),
            rotation_y=float(wrap_angle(headings[place])),
            score=cuboids[place].score,
            track_id=tracks.number(cuboids[place].identity),
        )
        for place in kept
    ]
    return made, len(cuboids) - len(made)


def class_name(kind: str) -> str:
    """A class as a word of a label line: blanks become underscores, no name Misc."""
    return _BLANKS.sub('_', kind.strip()) or _OTHERS


def _three(values: Float64Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _four(values: Float64Array) -> tuple[float, float, float, float]:
    left, top, right, bottom = (float(value) for value in values)
    return left, top, right, bottom
