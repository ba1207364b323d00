# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of labelled objects: counts by class, and their distributions."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import Counter, defaultdict
from dataclasses import dataclass, field, fields
from functools import partial
from typing import TYPE_CHECKING

from ..model.boxes import DONT_CARE, OCCLUSIONS, Box, has_cuboid, is_absurd
from ..model.difficulty import LIMITS, Difficulty, difficulty_of
from .distribution import Distribution

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..model.boxes import Cuboid

DISTANCES_M = tuple(range(0, 85, 5))
SIZES_M = tuple(value / 4 for value in range(81))
POINTS = (0, 1, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
OBJECTS = tuple(range(31))
TRACK_FRAMES = (1, 2, 5, 10, 20, 50, 100, 200, 500)

DIFFICULTIES = (*(level.value for level in Difficulty), 'beyond')
"""The levels of the benchmark, and labels that are beyond all of them."""

_CUTS = (0.0, *(limits.truncated for limits in LIMITS.values()))
TRUNCATIONS = ('none', *(f'to {cut:.2f}' for cut in _CUTS[1:]), f'over {_CUTS[-1]:.2f}')
"""Truncation, by the limits of the levels of difficulty."""


def _zeros(names: Iterable[str]) -> Counter[str]:
    return Counter(dict.fromkeys(names, 0))


@dataclass
class ObjectStatistics:
    """The objects of one class; of DontCare regions only count, frames and most.

    Attributes:
        count: Number of labels.
        frames: Number of frames with one.
        most: Greatest number in a frame.
        difficulty: Number by DIFFICULTIES, each label at its easiest level; of labels with 2D box.
        occlusion: Number by OCCLUSIONS; of labels with a value.
        truncation: Number by TRUNCATIONS; of labels with a value. Tracking has levels 0, 1 and 2
            instead of a fraction: 0 is none.
        distance_m: Horizontal distance of the box's middle from the sensor that labels are given
            for: camera 0 of label files, the scanner of tracklets and other boxes.
        length_m, width_m, height_m: Sizes of 3D boxes.
        points: Points of the scan inside a 3D box, if counted.
        tracks: Length of each track, in frames that it is labelled in.
    """

    count: int = 0
    frames: int = 0
    most: int = 0
    difficulty: Counter[str] = field(default_factory=lambda: _zeros(DIFFICULTIES))
    occlusion: Counter[str] = field(default_factory=lambda: _zeros(OCCLUSIONS))
    truncation: Counter[str] = field(default_factory=lambda: _zeros(TRUNCATIONS))
    distance_m: Distribution = field(default_factory=partial(Distribution, DISTANCES_M))
    length_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    width_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    height_m: Distribution = field(default_factory=partial(Distribution, SIZES_M))
    points: Distribution = field(default_factory=partial(Distribution, POINTS))
    tracks: Distribution = field(default_factory=partial(Distribution, TRACK_FRAMES))

    def add_frame(self, labels: Sequence[Box | Cuboid]) -> None:
        """Add the labels of this class in one frame."""
        self.count += len(labels)
        self.frames += 1
        self.most = max(self.most, len(labels))
        for label in labels:
            if label.class_name == DONT_CARE:
                continue
            if isinstance(label, Box):
                self._add_box(label)
            else:
                self._add_solid(label.velo_T_box.translation[:2].tolist(), label.size_lwh)

    def _add_box(self, box: Box) -> None:
        left, top, right, bottom = box.box_2d
        if right > left and bottom > top:
            level = difficulty_of(box)
            self.difficulty[DIFFICULTIES[-1] if level is None else level.value] += 1
        if 0 <= box.occluded < len(OCCLUSIONS):
            self.occlusion[OCCLUSIONS[box.occluded]] += 1
        if box.truncated >= 0:
            self.truncation[TRUNCATIONS[bisect_left(_CUTS, box.truncated)]] += 1
        if has_cuboid(box) and not is_absurd(box):
            height, width, length = box.size_hwl
            self._add_solid((box.location[0], box.location[2]), (length, width, height))

    def _add_solid(self, place: Iterable[float], size_lwh: tuple[float, float, float]) -> None:
        self.distance_m.add(math.hypot(*place))
        sizes = (self.length_m, self.width_m, self.height_m)
        for distribution, size in zip(sizes, size_lwh, strict=True):
            distribution.add(size)

    def merge(self, other: ObjectStatistics) -> None:
        """Add the objects of another recording."""
        self.count += other.count
        self.frames += other.frames
        self.most = max(self.most, other.most)
        for each in fields(self):
            mine, theirs = getattr(self, each.name), getattr(other, each.name)
            if isinstance(mine, Counter):
                mine.update(theirs)
            elif isinstance(mine, Distribution):
                mine.merge(theirs)


class ObjectTally:
    """Counts the labels of a recording, frame by frame.

    Attributes:
        classes: By class name.
        a_frame: Number of objects in a labelled frame, without DontCare.
    """

    def __init__(self) -> None:
        self.classes: dict[str, ObjectStatistics] = defaultdict(ObjectStatistics)
        self.a_frame = Distribution(OBJECTS)
        self._tracks: Counter[tuple[str, int]] = Counter()

    def add(
        self, labels: Iterable[Box | Cuboid], box_points: Iterable[tuple[str, int]] = ()
    ) -> None:
        """Add the labels of a frame, possibly none, and the points inside each 3D box."""
        by_class: dict[str, list[Box | Cuboid]] = defaultdict(list)
        for label in labels:
            by_class[label.class_name].append(label)
            if label.track_id is not None and label.track_id >= 0:
                self._tracks[label.class_name, label.track_id] += 1
        for class_name, found in by_class.items():
            self.classes[class_name].add_frame(found)
        self.a_frame.add(
            sum(len(found) for class_name, found in by_class.items() if class_name != DONT_CARE)
        )
        for class_name, count in box_points:
            self.classes[class_name].points.add(count)

    def finish(self) -> None:
        """Add the tracks, after the last frame."""
        for (class_name, _), frames in self._tracks.items():
            self.classes[class_name].tracks.add(frames)
