# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""2D boxes of a detector in the image -> the 2D columns of labels.

A 2D box belongs to the 3D box with its id, else to the one whose projection it covers best. What is
left becomes a label without a 3D box, as the readme.txt of the object devkit has it: size -1,
location -1000, angles -10.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import Box, clip_bounds
from ..rig.rectify import rectify_pixels
from .labels import class_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..messages.camera_info import CameraModel
    from ..messages.detections import ImageBox
    from ..model.geometry import Float64Array
    from .labels import TrackIds

_LEAST_OVERLAP = 0.5
_SIDES = np.linspace(0.0, 1.0, 9)
_NO_SIZE = (-1.0, -1.0, -1.0)
_NO_PLACE = (-1000.0, -1000.0, -1000.0)
_NO_ANGLE = -10.0


def join_boxes(
    boxes: Sequence[Box],
    flat: Sequence[ImageBox],
    size: tuple[int, int],
    tracks: TrackIds,
    *,
    occluded: int,
    scores: bool,
) -> tuple[list[Box], int]:
    """Return labels with the 2D boxes of a detector; also how many of these are out of the image.

    Args:
        boxes: Labels by 3D boxes; those without a 2D box of their own keep the projection.
        flat: Boxes in the pixels of the labels' camera.
        size: (width, height) of its image.
        tracks: Gives track ids, and those of the 3D boxes.
        occluded: The occlusion of labels without a 3D box.
        scores: Whether labels have scores.
    """
    if not flat:
        return list(boxes), 0
    bounds, truncated = clip_bounds(np.array([each.box_2d for each in flat]), size)
    seen = np.flatnonzero(np.isfinite(bounds).all(axis=1)).tolist()
    pairs = _pairs(boxes, flat, bounds, seen, tracks)
    made = list(boxes)
    for place, (box, number) in enumerate(zip(boxes, pairs, strict=True)):
        if number is not None:
            made[place] = replace(box, box_2d=_four(bounds[number]))
    for number in sorted(set(seen) - set(pairs)):
        each = flat[number]
        made.append(
            Box(
                class_name=class_name(each.class_name),
                truncated=float(truncated[number]),
                occluded=occluded,
                alpha=_NO_ANGLE,
                box_2d=_four(bounds[number]),
                size_hwl=_NO_SIZE,
                location=_NO_PLACE,
                rotation_y=_NO_ANGLE,
                score=(1.0 if each.score is None else each.score) if scores else None,
                track_id=tracks.number(each.identity),
            )
        )
    return made, len(flat) - len(seen)


def rectified_boxes(flat: Sequence[ImageBox], camera: CameraModel) -> list[ImageBox]:
    """Return the boxes around the sides of boxes in unrectified pixels, in rectified ones."""
    found = []
    for each in flat:
        left, top, right, bottom = each.box_2d
        x, y = left + _SIDES * (right - left), top + _SIDES * (bottom - top)
        flat_x, flat_y = np.full_like(x, 1.0), np.full_like(y, 1.0)
        sides = [(x, flat_y * top), (x, flat_y * bottom), (flat_x * left, y), (flat_x * right, y)]
        moved = rectify_pixels(np.vstack([np.column_stack(side) for side in sides]), camera)
        found.append(each._replace(box_2d=_four(np.ravel([moved.min(axis=0), moved.max(axis=0)]))))
    return found


def _pairs(
    boxes: Sequence[Box],
    flat: Sequence[ImageBox],
    bounds: Float64Array,
    seen: Sequence[int],
    tracks: TrackIds,
) -> list[int | None]:
    """Return for each label the number of its 2D box: by id, then by overlap, the largest first."""
    pairs: list[int | None] = [None] * len(boxes)
    free = set(seen)
    by_track = {box.track_id: place for place, box in enumerate(boxes)}
    for number in sorted(free):
        track = tracks.find(flat[number].identity)
        place = by_track.get(track) if track is not None else None
        if place is not None and pairs[place] is None:
            pairs[place] = number
            free.discard(number)
    overlaps = sorted(
        (
            (overlap_of(boxes[place].box_2d, bounds[number]), place, number)
            for place in range(len(boxes))
            for number in free
        ),
        key=lambda each: (-each[0], each[1], each[2]),
    )
    for overlap, place, number in overlaps:
        if overlap >= _LEAST_OVERLAP and pairs[place] is None and number in free:
            pairs[place] = number
            free.discard(number)
    return pairs


def overlap_of(one: Sequence[float], other: Sequence[float] | Float64Array) -> float:
    """Return the intersection over union of two boxes, 0 where one is empty."""
    across = min(one[2], other[2]) - max(one[0], other[0])
    down = min(one[3], other[3]) - max(one[1], other[1])
    common = max(across, 0.0) * max(down, 0.0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    union = sum(areas) - common
    return float(common / union) if common and union > 0 else 0.0


def _four(values: Float64Array) -> tuple[float, float, float, float]:
    left, top, right, bottom = (float(value) for value in values)
    return left, top, right, bottom
