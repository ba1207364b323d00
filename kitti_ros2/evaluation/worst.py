# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames in which a detector errs most, and their pictures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..drawing.objects import compared, objects_of_boxes
from ..drawing.text import captioned
from ..model.geometry import Transform
from ..model.least_overlaps import KITTI_OVERLAPS, LeastOverlaps
from ..model.matching import Verdict
from ..model.samples import FrameLabels
from ..model.text import some_of
from ..options.pictures import PictureOptions
from ..pictures.modes import MODES
from ..pictures.output import write_picture
from ..pictures.predictions import Predictions
from ..pictures.series import PictureTally, draw_frames

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..drawing.objects import LabelledObject
    from ..model.boxes import Box
    from ..model.losses import Loss
    from ..pictures.frame import FrameSource

__all__ = ['WorstFrame', 'draw_worst_frames', 'worst_frames']

_COUNT = 20
_LEAST_DIGITS = 2


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
    """
    weigh = _weight(results)
    found = []
    for number, boxes in ground_truth.items():
        labels, predictions = compared(_objects(boxes), _objects(results.get(number, ())), overlaps)
        missed = _of_verdict(labels, Verdict.FALSE_NEGATIVE)
        wrong = _of_verdict(predictions, Verdict.FALSE_POSITIVE)
        if missed or wrong:
            wrong.sort(key=weigh, reverse=True)
            penalty = len(missed) + sum(map(weigh, wrong))
            reason = _reason(missed, wrong)
            found.append(WorstFrame(number, penalty, len(missed), len(wrong), reason))
    return sorted(found, key=lambda each: (-each.penalty, each.number))[:count]


def draw_worst_frames(
    source: FrameSource,
    worst: Sequence[WorstFrame],
    results: Mapping[int, Sequence[Box]],
    folder: Path,
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
    *,
    mode: str = 'panel',
    progress: Callable[[int], None] = lambda _: None,
) -> tuple[Loss, ...]:
    """Draw frames with their errors: RANK_NUMBER.png, such as 01_000123.png.

    Args:
        source: The recording of the ground truth.
        worst: Of worst_frames.
        results: The predictions by number.
        folder: An existing folder.
        overlaps: As given to worst_frames.
        mode: One of pictures.modes.MODES.
        progress: Called with the number of frames done.

    Returns:
        Data of the frames that is missing or damaged.

    Raises:
        MissingDataError: Not one frame could be drawn.
        UsageError: The source does not have a frame.
        OSError: A picture cannot be written.
    """
    predictions = Predictions(lambda number: FrameLabels(results.get(number, ())), overlaps)
    ranks = {each.number: (rank, each) for rank, each in enumerate(worst, 1)}
    digits = max(len(str(len(worst))), _LEAST_DIGITS)
    series = draw_frames(source, [*ranks], MODES[mode], PictureOptions(), predictions.add_to)
    tally = PictureTally()
    for number, picture in tally.pictures(series, progress):
        rank, each = ranks[number]
        text = f'{rank}. frame {number}: {each.reason}'
        write_picture(folder / f'{rank:0{digits}d}_{number:06d}.png', captioned(picture, text))
    if worst:
        tally.check()
    return tally.losses()


def _objects(boxes: Sequence[Box]) -> list[LabelledObject]:
    """Return boxes as objects in the camera's frame, in which overlaps are the same."""
    return objects_of_boxes(FrameLabels(boxes), Transform.identity())


def _of_verdict(objects: Sequence[LabelledObject], verdict: Verdict) -> list[LabelledObject]:
    return [each for each in objects if each.match is not None and each.match.verdict is verdict]


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
