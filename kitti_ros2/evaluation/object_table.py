# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of many frames as columns, and the pairs of objects of the same frame."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

BoolArray: TypeAlias = npt.NDArray[np.bool_]

UNSCORED = 1.0
"""The score of a detection without one."""

_NUMBERS = 15
_MOST_PAIRS = 400_000
"""Compared at once: their columns take some 100 MB."""


@dataclass(frozen=True, eq=False)
class ObjectTable:
    """The objects of a series of frames, in the order of the frames and of the lines of each.

    Attributes:
        frame: (N,) index of the frame in the series, ascending.
        class_names: The different class names, in lower case: the devkit compares them by
            strcasecmp.
        class_index: (N,) index of the class name.
        box_2d: (N, 4) left, top, right, bottom, pixels.
        size_hwl: (N, 3) height, width, length, metres.
        location: (N, 3) bottom face's centre in the rectified camera 0 frame, metres.
        rotation_y, alpha: (N,) radians.
        truncated, occluded: (N,) as in Box.
        score: (N,) detection score; 1 for objects without one.
    """

    frame: Int64Array
    class_names: Sequence[str]
    class_index: Int64Array
    box_2d: Float64Array
    size_hwl: Float64Array
    location: Float64Array
    rotation_y: Float64Array
    alpha: Float64Array
    truncated: Float64Array
    occluded: Float64Array
    score: Float64Array

    def __len__(self) -> int:
        return len(self.frame)

    def of_classes(self, class_names: Collection[str]) -> BoolArray:
        """Return (N,) whether each object is of one of some classes, in lower case."""
        wanted = [index for index, name in enumerate(self.class_names) if name in class_names]
        return np.isin(self.class_index, wanted)


def table_of(frames: Sequence[Sequence[Box]]) -> ObjectTable:
    """Return the objects of a series of frames as columns."""
    boxes = [box for frame in frames for box in frame]
    rows = (
        (
            *box.box_2d,
            *box.size_hwl,
            *box.location,
            box.rotation_y,
            box.alpha,
            box.truncated,
            box.occluded,
            UNSCORED if box.score is None else box.score,
        )
        for box in boxes
    )
    indices: dict[str, int] = {}
    class_index = np.array(
        [indices.setdefault(box.class_name.lower(), len(indices)) for box in boxes], np.int64
    )
    count = _NUMBERS * len(boxes)
    columns = np.fromiter(chain.from_iterable(rows), np.float64, count).reshape(-1, _NUMBERS)
    return ObjectTable(
        np.repeat(np.arange(len(frames), dtype=np.int64), [len(frame) for frame in frames]),
        [*indices],
        class_index,
        columns[:, :4],
        columns[:, 4:7],
        columns[:, 7:10],
        *columns[:, 10:].T,
    )


class Pairs(NamedTuple):
    """Pairs of a label and a detection of the same frame, by label, then by detection.

    Attributes:
        label: (P,) index in the table of ground truth.
        detection: (P,) index in the table of results.
    """

    label: Int64Array
    detection: Int64Array


def pairs_by_frame(
    labels: ObjectTable, detections: ObjectTable, most: int = _MOST_PAIRS
) -> Iterator[Pairs]:
    """Yield all pairs of the same frame, about so many at once; one label's are not divided."""
    first = np.searchsorted(detections.frame, labels.frame, 'left')
    count = np.searchsorted(detections.frame, labels.frame, 'right') - first
    ends = np.cumsum(count)
    start = 0
    while start < len(labels):
        done = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, done + most, 'right')), start + 1)
        label = np.repeat(np.arange(start, stop), count[start:stop])
        offset = np.arange(len(label)) - np.repeat(
            ends[start:stop] - count[start:stop] - done, count[start:stop]
        )
        yield Pairs(label, first[label] + offset)
        start = stop
