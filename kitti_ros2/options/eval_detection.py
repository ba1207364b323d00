# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of scoring detections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.least_overlaps import LeastOverlaps
from .class_parsers import parse_class_overlaps
from .declare import option
from .parsers import parse_flag, parse_integer, parse_path

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

BENCHMARK_CLASSES = {'car': 0.7, 'pedestrian': 0.5, 'cyclist': 0.5}
"""By class of the object benchmark the overlap above which a detection matches (MIN_OVERLAP)."""


@dataclass(frozen=True)
class DetectionOptions:
    """Options of scoring detections.

    Attributes:
        classes: Names with the overlap above which a detection matches, None for that of the
            benchmark; empty for the benchmark's classes.
        frames: A list of the frames to score; None for all that have results.
        loose: Whether to score with the loose overlaps, too.
        worst: Number of the frames with the most errors to list; None for none.

    Raises:
        UsageError: A class has no overlap, or an impossible one, or no frame is to be listed.
    """

    group: ClassVar = 'Benchmark'

    classes: tuple[tuple[str, float | None], ...] = option(
        (),
        'Classes to score, with the overlap (IoU) above which a detection counts: car truck=0.5',
        parse_class_overlaps,
        unset='car, pedestrian, cyclist',
        metavar='NAME=IOU...',
    )
    frames: Path | None = option(
        None,
        'Score only the frames of a list such as ImageSets/val.txt',
        parse_path,
        unset='all with a result file',
        metavar='FILE',
    )
    loose: bool = option(
        False,
        'Also score BEV and 3D with an overlap of 0.5 for cars, 0.25 for pedestrians and cyclists',
        parse_flag,
        flags=('--loose',),
    )
    worst: int | None = option(
        None,
        'List the N frames with the most errors; with -o FOLDER they are drawn',
        parse_integer,
        unset='none',
    )

    def __post_init__(self) -> None:
        if self.worst is not None and self.worst < 1:
            raise UsageError(f'worst {self.worst} lists no frame; give a number from 1, such as 20')
        for name, overlap in self.classes:
            if overlap is None and name not in BENCHMARK_CLASSES:
                raise UsageError(
                    f'the class {name} needs an overlap, such as --classes {name}=0.5; the'
                    f' benchmark has one for {", ".join(BENCHMARK_CLASSES)} only'
                )
            if overlap is not None and not 0 <= overlap < 1:
                raise UsageError(
                    f'the overlap {overlap:g} of {name} is not within 0 to 1; give one such as 0.5'
                )

    @property
    def overlaps(self) -> LeastOverlaps:
        """The same for the comparison of single frames."""
        return LeastOverlaps(tuple(self.limits.items()))

    @property
    def limits(self) -> Mapping[str, float]:
        """The overlap above which a detection matches, by class in lower case."""
        if not self.classes:
            return BENCHMARK_CLASSES
        return {
            name: BENCHMARK_CLASSES[name] if overlap is None else overlap
            for name, overlap in self.classes
        }
