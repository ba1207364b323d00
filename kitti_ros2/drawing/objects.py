# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labelled objects of a frame, in the form that all drawing uses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import cuboid_of, has_cuboid, is_absurd
from ..model.labels import identified, rect_from_velo
from ..model.least_overlaps import KITTI_OVERLAPS
from ..model.matching import Verdict, match

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Box, Cuboid
    from ..model.geometry import Transform
    from ..model.least_overlaps import LeastOverlaps
    from ..model.matching import Match
    from ..model.samples import Calibration, FrameLabels

_LEAST_SHOWN = 0.005

LABEL_CAMERA = 2
"""KITTI's 2D boxes are in pixels of this camera: the left colour one, rectified."""


@dataclass(frozen=True, eq=False)
class LabelledObject:
    """One object of a frame.

    Attributes:
        class_name: DontCare for a region without labels.
        cuboid: Its 3D box in velo_link, None without one.
        box_2d: left, top, right, bottom in pixels of the labelled camera (KITTI's camera 2), None
            without one (tracklets).
        truncated: 0..1, None if unknown.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown, None without a value.
        score: Detection score, None for ground truth.
        track_id: Identity across frames, None without one.
        match: Comparison of labels and predictions, None without one.
    """

    class_name: str
    cuboid: Cuboid | None
    box_2d: tuple[float, float, float, float] | None = None
    truncated: float | None = None
    occluded: int | None = None
    score: float | None = None
    track_id: int | None = None
    match: Match | None = None


def objects_of(labels: FrameLabels, calibration: Calibration | None) -> list[LabelledObject]:
    """Return the objects of a frame, from label lines or from tracklets.

    If the calibration or its cam0_T_velo is missing, objects of label lines have 2D boxes only.
    """
    if labels.cuboids:
        return [
            LabelledObject(each.class_name, each, score=each.score, track_id=each.track_id)
            for each in labels.cuboids
        ]
    return objects_of_boxes(labels, _rect_t_velo(calibration))


def objects_of_boxes(labels: FrameLabels, rect_t_velo: Transform | None) -> list[LabelledObject]:
    """Return the objects of label lines, their 3D boxes in velo_link.

    Args:
        labels: Of a frame.
        rect_t_velo: velo_link to the rectified camera 0; None for 2D boxes only.
    """
    return [_object_of(identity, box, rect_t_velo) for identity, box in identified(labels)]


def resized(
    objects: Sequence[LabelledObject], scale_x: float, scale_y: float
) -> list[LabelledObject]:
    """Return the objects with the 2D boxes of the resized image."""
    scales = np.array([scale_x, scale_y] * 2)
    shifts = (scales - 1) / 2
    return [
        each
        if each.box_2d is None
        else replace(each, box_2d=tuple((np.array(each.box_2d) * scales + shifts).tolist()))
        for each in objects
    ]


def compared(
    labels: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
) -> tuple[list[LabelledObject], list[LabelledObject]]:
    """Return labels and predictions with their matches.

    Args:
        labels: Of a frame.
        predictions: Of the same frame.
        overlaps: The IoU above which a prediction finds a label.
    """
    matches = match(labels, predictions, overlaps)
    with_labels, with_predictions = (
        [replace(each, match=found) for each, found in zip(some, of_some, strict=True)]
        for some, of_some in zip((labels, predictions), matches, strict=True)
    )
    return with_labels, with_predictions


def is_missed(each: LabelledObject) -> bool:
    """Whether an object is a label that no prediction finds."""
    return each.match is not None and each.match.verdict is Verdict.FALSE_NEGATIVE


def name_of(each: LabelledObject) -> str:
    """Format class, track, score, and the result of the comparison."""
    track = '' if each.track_id is None else f' {each.track_id}'
    score = '' if each.score is None else f' {each.score:.2f}'
    return f'{each.class_name}{track}{score}{_mark(each)}'


def distance_of(each: LabelledObject) -> float:
    """Return metres from the scanner, infinity without a 3D box."""
    if each.cuboid is None:
        return math.inf
    distance = float(np.linalg.norm(each.cuboid.velo_T_box.translation))
    return distance if math.isfinite(distance) else math.inf


def _mark(each: LabelledObject) -> str:
    """Format the result of the comparison of a prediction, or of a label that none finds."""
    verdict, overlap = (
        (None, 0.0) if each.match is None else (each.match.verdict, each.match.overlap)
    )
    if verdict is None or (each.score is None and verdict is Verdict.TRUE_POSITIVE):
        return ''
    shown = f' IoU {overlap:.2f}' if overlap >= _LEAST_SHOWN and each.score is not None else ''
    return f' {verdict.value}{shown}'


def _rect_t_velo(calibration: Calibration | None) -> Transform | None:
    try:
        return None if calibration is None else rect_from_velo(calibration)
    except ValueError:
        return None


def _object_of(identity: str, box: Box, rect_t_velo: Transform | None) -> LabelledObject:
    solid = rect_t_velo is not None and has_cuboid(box) and not is_absurd(box)
    left, top, right, bottom = box.box_2d
    return LabelledObject(
        box.class_name,
        cuboid_of(box, identity, rect_t_velo) if solid and rect_t_velo is not None else None,
        box.box_2d if right > left and bottom > top else None,
        box.truncated if box.truncated >= 0 else None,
        box.occluded if box.occluded >= 0 else None,
        box.score,
        box.track_id if box.track_id is not None and box.track_id >= 0 else None,
    )
