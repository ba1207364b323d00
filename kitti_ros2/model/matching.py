# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which predictions find which labels, by the rules of KITTI's devkit.

Source: evaluate_object.cpp of the object devkit. A prediction is a true positive (TP) if its
intersection over union (IoU) with a label of its class is above 0.7 for cars and 0.5 for
pedestrians and cyclists, or above a chosen one; another is a false positive (FP), and a label that
none finds a false negative (FN). Not counted are predictions on a label of a neighbouring class (a
car on a van, a pedestrian on a person sitting) or within a DontCare region, and labels of classes
that KITTI does not evaluate. Classes are compared without regard to case.

Other than there, predictions choose by descending score, classes that KITTI does not evaluate count
when they are predicted, and neither size nor occlusion makes a label too hard to count.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .boxes import DONT_CARE
from .least_overlaps import KITTI_OVERLAPS
from .overlaps import Boxed, BoxTable, parts_within

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .least_overlaps import LeastOverlaps
    from .overlaps import Mask

NEIGHBOURS = {
    'car': frozenset({'van'}),
    'pedestrian': frozenset({'person_sitting', 'person (sitting)'}),
}
"""A class that KITTI evaluates, and those that look like it, in lower case."""

_DONT_CARE = DONT_CARE.lower()
_MOST_PAIRS = 2**18
"""Pairs of a prediction and a label that are compared at a time."""
_UNEVALUATED = frozenset(
    {'van', 'truck', 'tram', 'person_sitting', 'person (sitting)', 'misc', _DONT_CARE}
)


class Matchable(Boxed, Protocol):
    """A label or a prediction."""

    @property
    def class_name(self) -> str:
        """Class name."""

    @property
    def score(self) -> float | None:
        """Detection score, None for ground truth."""


class Verdict(str, Enum):
    """The result of a comparison of predictions with labels, for one of them."""

    TRUE_POSITIVE = 'TP'
    FALSE_POSITIVE = 'FP'
    FALSE_NEGATIVE = 'FN'


class Match(NamedTuple):
    """The comparison of one prediction with the labels of a frame, or of one label.

    Attributes:
        verdict: None for one that does not count.
        partner: The index of the label that a prediction finds, or of the prediction that finds a
            label; None without one.
        overlap: IoU with the partner; without one, the greatest with any label of the class.
    """

    verdict: Verdict | None
    partner: int | None = None
    overlap: float = 0.0


class Matches(NamedTuple):
    """A match for each label and for each prediction, in their order."""

    labels: Sequence[Match]
    predictions: Sequence[Match]


@np.errstate(all='ignore')  # labels may hold any numbers
def match(
    labels: Sequence[Matchable],
    predictions: Sequence[Matchable],
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
) -> Matches:
    """Compare the predictions of a frame with its labels.

    Args:
        labels: Ground truth, with its DontCare regions.
        predictions: Of any classes; one without a score is the surest.
        overlaps: The IoU above which a prediction finds a label.
    """
    predicted = {each.class_name.lower() for each in predictions}
    names = [each.class_name.lower() for each in labels]
    of_labels = [
        Match(None if _is_uncounted(name, predicted) else Verdict.FALSE_NEGATIVE) for name in names
    ]
    of_predictions = [Match(Verdict.FALSE_POSITIVE)] * len(predictions)
    for place, overlapped in _overlapped(labels, predictions, overlaps):
        found = _choose(overlapped, of_labels)
        of_predictions[place] = found
        if found.partner is not None:
            of_labels[found.partner] = found._replace(partner=place)
    return Matches(of_labels, of_predictions)


class _OverlappedLabels(NamedTuple):
    """The labels that a prediction overlaps.

    Attributes:
        own: Pairs of IoU and negative index, of the class of the prediction.
        near: The same, of the neighbours of its class.
        least: The IoU above which the prediction finds a label.
        is_ignored: Whether it is within a DontCare region.
    """

    own: list[tuple[float, int]]
    near: list[tuple[float, int]]
    least: float
    is_ignored: bool


def _choose(overlapped: _OverlappedLabels, taken: Sequence[Match]) -> Match:
    """Return the match of a prediction with the labels that are not taken yet."""
    for verdict, pairs in ((Verdict.TRUE_POSITIVE, overlapped.own), (None, overlapped.near)):
        free = [
            (overlap, place)
            for overlap, place in pairs
            if overlap > overlapped.least and taken[-place].partner is None
        ]
        if free:
            overlap, place = max(free)
            return Match(verdict, -place, overlap)
    best, _ = max(overlapped.own, default=(0.0, 0))
    return Match(None if overlapped.is_ignored else Verdict.FALSE_POSITIVE, overlap=best)


def _overlapped(
    labels: Sequence[Matchable], predictions: Sequence[Matchable], overlaps: LeastOverlaps
) -> Iterator[tuple[int, _OverlappedLabels]]:
    """Yield the index of each prediction and the labels it overlaps, by descending score."""
    names = [each.class_name.lower() for each in labels]
    table, boxes = BoxTable(labels), BoxTable(predictions)
    regions = table.flat[[name == _DONT_CARE for name in names]]
    order = sorted(range(len(predictions)), key=lambda place: -_sureness(predictions[place]))
    step = max(_MOST_PAIRS // max(len(labels), 1), 1)
    for start in range(0, len(order), step):
        rows = np.array(order[start : start + step])
        own = [predictions[place].class_name.lower() for place in rows]
        least = [overlaps.of(name) for name in own]
        parts = parts_within(boxes.flat[rows, None], regions)
        ignored = np.any(parts > np.array(least)[:, None], axis=1).tolist()
        pairs = boxes.overlaps(table, rows, _compared(own, names))
        ends = np.searchsorted(pairs.first, np.arange(len(rows) + 1))
        for index, place in enumerate(rows.tolist()):
            mine = slice(*ends[index : index + 2])
            found = zip(pairs.overlaps[mine].tolist(), pairs.second[mine].tolist(), strict=True)
            both: tuple[list[tuple[float, int]], list[tuple[float, int]]] = ([], [])
            for overlap, label in found:
                both[names[label] != own[index]].append((overlap, -label))
            yield place, _OverlappedLabels(*both, least[index], ignored[index])


def _compared(own: Sequence[str], names: Sequence[str]) -> Mask:
    """Return (N, M) whether each label is of the class of each prediction, or of a neighbour."""
    codes = {name: code for code, name in enumerate(dict.fromkeys(names))}
    of_labels = np.array([codes[name] for name in names], np.intp)
    rows = {
        name: np.isin(
            of_labels, [codes.get(each, -1) for each in (name, *NEIGHBOURS.get(name, ()))]
        )
        for name in set(own)
    }
    return np.array([rows[name] for name in own])


def _sureness(prediction: Matchable) -> float:
    score = prediction.score
    return math.inf if score is None else score if math.isfinite(score) else -math.inf


def _is_uncounted(class_name: str, predicted: set[str]) -> bool:
    return class_name == _DONT_CARE or (class_name in _UNEVALUATED and class_name not in predicted)
