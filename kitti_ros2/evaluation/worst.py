# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames in which a detector errs most."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..drawing.objects import compared, objects_of_boxes
from ..model.geometry import Transform
from ..model.least_overlaps import KITTI_OVERLAPS, LeastOverlaps
from ..model.matching import Verdict
from ..model.samples import FrameLabels
from ..model.text import some_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from ..drawing.objects import LabelledObject
    from ..model.boxes import Box


_COUNT = 20


@dataclass(frozen=True)
class WorstFrame:
    """A frame with errors.

    Attributes:
        number: The frame.
        penalty: The number of missed labels and the weights of the false positives, summed.
        missed: The number of labels that no prediction finds.
        false_positives: The number of predictions that find no label.
        reason: The errors, one line.
    """

    number: int
    penalty: float
    missed: int
    false_positives: int
    reason: str


def worst_frames(
    ground_truth: Mapping[int, Sequence[Box]],
    results: Mapping[int, Sequence[Box]],
    count: int = _COUNT,
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
    *,
    classes: Collection[str] = (),
) -> list[WorstFrame]:
    """Rank frames by their errors: each missed label is 1, each false positive its score.

    Labels and predictions are matched as in pictures (model/matching.py). Scores that are not all
    within 0 to 1 are scaled to it, from the lowest to the highest; predictions without a score are
    1. Of frames with equal errors the lower number is first; frames without errors are left out.

    Args:
        ground_truth: The labels of the frames to rank, by number.
        results: The predictions by number; a frame that is not in it has none.
        count: Number of frames to return, at most.
        overlaps: The IoU above which a prediction is a true positive.
        classes: Classes whose errors count, in lower case; empty for all.
    """
    weigh = _weight(results)
    found = []
    for number, boxes in ground_truth.items():
        labels, predictions = compared(_objects(boxes), _objects(results.get(number, ())), overlaps)
        missed = _of_verdict(labels, Verdict.FALSE_NEGATIVE, classes)
        wrong = _of_verdict(predictions, Verdict.FALSE_POSITIVE, classes)
        if missed or wrong:
            wrong.sort(key=weigh, reverse=True)
            penalty = len(missed) + sum(map(weigh, wrong))
            reason = _reason(missed, wrong)
            found.append(WorstFrame(number, penalty, len(missed), len(wrong), reason))
    return sorted(found, key=lambda each: (-each.penalty, each.number))[:count]


def _objects(boxes: Sequence[Box]) -> list[LabelledObject]:
    """Return boxes as objects in the camera's frame, in which overlaps are the same."""
    return objects_of_boxes(FrameLabels(boxes), Transform.identity())


def _of_verdict(
    objects: Sequence[LabelledObject], verdict: Verdict, classes: Collection[str]
) -> list[LabelledObject]:
    return [
        each
        for each in objects
        if each.match is not None
        and each.match.verdict is verdict
        and (not classes or each.class_name.lower() in classes)
    ]


def _weight(results: Mapping[int, Sequence[Box]]) -> Callable[[LabelledObject], float]:
    """Return the function of the weight of a false positive, 0 to 1."""
    scores = [box.score for boxes in results.values() for box in boxes if box.score is not None]
    low, high = min(scores, default=0.0), max(scores, default=1.0)
    if low >= 0 and high <= 1:
        low, high = 0.0, 1.0
    span = high - low
    return lambda each: (each.score - low) / span if span and each.score is not None else 1.0


def _reason(missed: Sequence[LabelledObject], wrong: Sequence[LabelledObject]) -> str:
    """Describe errors: missed: 2 Car, 1 Cyclist; false positives: Car 0.93, Car 0.81."""
    parts = []
    if missed:
        classes = Counter(each.class_name for each in missed).most_common()
        parts.append(f'missed: {", ".join(f"{n} {class_name}" for class_name, n in classes)}')
    if wrong:
        named = [
            each.class_name if each.score is None else f'{each.class_name} {each.score:.2f}'
            for each in wrong
        ]
        noun = 'false positive' if len(wrong) == 1 else 'false positives'
        parts.append(f'{noun}: {some_of(named)}')
    return '; '.join(parts)
