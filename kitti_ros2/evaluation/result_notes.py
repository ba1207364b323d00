# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Remarks on results whose figures may surprise, each with its reason in the benchmark's rules."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.difficulty import LIMITS, Difficulty
from ..model.text import format_count, some_of
from .object_benchmark import SAMPLES
from .object_table import UNSCORED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .frame_boxes import FrameBoxes
    from .object_benchmark import Scores
    from .object_table import ObjectTable

_MOST_CELLS = 4
_NO_SIZE = -1.0


def left_out_note(count: int) -> tuple[str, ...]:
    """Return the note on labels of the scored classes whose occlusion is unknown."""
    if not count:
        return ()
    what = f'{format_count(count, "label")} left out: occlusion {UNKNOWN_OCCLUSION}, unknown'
    return (f'{what}; 0 counts as visible',)


def notes_on(
    scores: Scores, found: FrameBoxes, labels: ObjectTable, detections: ObjectTable
) -> Iterator[str]:
    """Yield remarks on the scores of some results."""
    unknown = labels.of_classes({*scores}) & (labels.occluded == UNKNOWN_OCCLUSION)
    yield from left_out_note(int(np.count_nonzero(unknown)))
    unscored = sum(box.score is None for boxes in found.boxes.values() for box in boxes)
    if unscored:
        yield (
            f'{found.source}: {unscored} detections without a score, the 16th column, count as'
            f' {UNSCORED:g}; equal scores make a curve of one point'
        )
    yield from _invalid_boxes(found, detections)
    for class_name, metrics in scores.items():
        yield from _notes_on_class(class_name, found, detections)
        absent = [name for name, levels in metrics.items() if None in levels.values()]
        if absent:
            yield (
                f'{class_name}: {", ".join(absent)} not evaluated, as in the devkit: no detection'
                f' of the class has such a box, or, for aos, a detection has alpha -10'
            )
    few = dict.fromkeys(
        f'{class_name} {level.value} {curve.objects} (at most {curve.highest_r40:.2f})'
        for class_name, metrics in scores.items()
        for level in Difficulty
        for curve in (levels[level] for levels in metrics.values())
        if curve is not None and 0 < curve.objects < SAMPLES
    )
    if few:
        yield (
            f'fewer objects than the {SAMPLES} samples of recall, so that no detector reaches an'
            f' R40 of 100: {some_of([*few], _MOST_CELLS)}'
        )


def _invalid_boxes(found: FrameBoxes, detections: ObjectTable) -> Iterator[str]:
    """Yield remarks on boxes that match no label, whatever they are compared with."""
    left, top, right, bottom = detections.box_2d.T
    sizes = detections.size_hwl
    counts = {
        '2D box whose right is left of its left edge, or its bottom above its top': (
            (right < left) | (bottom < top)
        ),
        'height, width or length below 0': ((sizes < 0) & (sizes != _NO_SIZE)).any(axis=1),
    }
    for what, invalid in counts.items():
        count = int(np.count_nonzero(invalid))
        if count:
            yield f'{found.source}: {format_count(count, "detection")} with a {what}'


def _notes_on_class(class_name: str, found: FrameBoxes, detections: ObjectTable) -> Iterator[str]:
    own = detections.of_classes({class_name})
    if not own.any():
        yield f'{class_name}: {found.source} has no detection of this class in the scored frames'
        return
    least = min(limits.height_px for limits in LIMITS.values())
    if (np.abs(detections.box_2d[own, 3] - detections.box_2d[own, 1]) < least).all():
        yield (
            f'{class_name}: all detections have a 2D box lower than {least:g} px, or none: the'
            f' benchmark ignores them, also in bev and 3d; project the 3D boxes into the image'
        )
