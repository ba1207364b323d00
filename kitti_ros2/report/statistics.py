# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of labels."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import DONT_CARE, OCCLUSIONS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..drawing.objects import LabelledObject
    from ..model.geometry import Float64Array


@dataclass(frozen=True, eq=False)
class ClassFacts:
    """The objects of one class.

    Attributes:
        class_name: Such as Car.
        count: Number of boxes.
        frames: Number of frames with one.
        most: Maximum number in a frame.
        tracks: Number of track ids; None without any.
        distances_m: (N,) horizontal distance from the scanner, of those with a 3D box.
        occlusions: Number for each of OCCLUSIONS; None if unknown.
        truncated: Number truncated by the image edge; None if unknown.
    """

    class_name: str
    count: int
    frames: int
    most: int
    tracks: int | None
    distances_m: Float64Array
    occlusions: tuple[int, ...] | None
    truncated: int | None


@dataclass(frozen=True, eq=False)
class ClassStatistics:
    """The labels of all frames.

    Attributes:
        classes: Most frequent first.
        frames: Number of frames.
        labelled: Number of frames with an object.
        dont_care: Number of regions without labels.
    """

    classes: tuple[ClassFacts, ...]
    frames: int
    labelled: int
    dont_care: int

    @property
    def count(self) -> int:
        """Number of all objects."""
        return sum(each.count for each in self.classes)


@dataclass
class _ClassCounts:
    count: int = 0
    frames: int = 0
    most: int = 0
    tracks: set[int] = field(default_factory=set)
    distances_m: list[float] = field(default_factory=list)
    occlusions: Counter[int] = field(default_factory=Counter)
    truncation_known: int = 0
    truncated: int = 0

    def add(self, objects: Sequence[LabelledObject]) -> None:
        """Add the objects of this class in one frame."""
        self.count += len(objects)
        self.frames += 1
        self.most = max(self.most, len(objects))
        for each in objects:
            if each.track_id is not None:
                self.tracks.add(each.track_id)
            if each.cuboid is not None:
                x, y, _ = each.cuboid.velo_T_box.translation.tolist()
                self.distances_m.append(float(np.hypot(x, y)))
            if each.occluded is not None:
                self.occlusions[each.occluded] += 1
            if each.truncated is not None:
                self.truncation_known += 1
                self.truncated += each.truncated > 0

    def facts(self, class_name: str) -> ClassFacts:
        """Return the facts of the objects so far."""
        known = sum(self.occlusions.values())
        places = range(len(OCCLUSIONS))
        return ClassFacts(
            class_name,
            self.count,
            self.frames,
            self.most,
            len(self.tracks) or None,
            np.array(self.distances_m),
            tuple(self.occlusions[place] for place in places) if known else None,
            self.truncated if self.truncation_known else None,
        )


class ClassTally:
    """Counts labels frame by frame."""

    def __init__(self) -> None:
        self._counts: dict[str, _ClassCounts] = defaultdict(_ClassCounts)
        self._frames = 0
        self._labelled = 0
        self._dont_care = 0

    def add(self, objects: Iterable[LabelledObject]) -> None:
        """Add a frame, also one without objects."""
        by_class: dict[str, list[LabelledObject]] = defaultdict(list)
        for each in objects:
            by_class[each.class_name].append(each)
        self._dont_care += len(by_class.pop(DONT_CARE, ()))
        self._frames += 1
        self._labelled += bool(by_class)
        for class_name, found in by_class.items():
            self._counts[class_name].add(found)

    def statistics(self) -> ClassStatistics:
        """Return the statistics of the frames so far."""
        facts = (tally.facts(class_name) for class_name, tally in self._counts.items())
        ordered = sorted(facts, key=lambda each: (-each.count, each.class_name))
        return ClassStatistics(tuple(ordered), self._frames, self._labelled, self._dont_care)


def histogram(values: Float64Array, edges: Sequence[float]) -> list[int]:
    """Count values in each bin [edge, next edge); the last bin is open."""
    counts, _ = np.histogram(values, [*edges, np.inf])
    return [int(count) for count in counts]


def spread(count: int, most: int) -> list[int]:
    """Return up to most evenly spaced indices of 0 .. count-1, including first and last."""
    if not count:
        return []
    places = np.linspace(0, count - 1, min(count, most)).round().astype(int)
    return [int(place) for place in np.unique(places)]
