# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of results that are recorded in a bag: topic, classes, stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .class_parsers import parse_class_map
from .declare import check_bounds, option
from .parsers import parse_text
from .quantity_parsers import parse_seconds_ns


@dataclass(frozen=True)
class BagResultsOptions:
    """Options of results in a bag.

    Attributes:
        topic: Their topic; None is the only one with boxes.
        class_map: Pairs of a class of the results, or its numeric id, and KITTI's; an empty class
            leaves boxes out, and the name * stands for all other classes.
        tolerance_ns: The largest distance between the stamps of a result and of its frame,
            nanoseconds; None is half the time between frames.

    Raises:
        UsageError: The tolerance is out of range.
    """

    group: ClassVar = 'Results in a bag'

    topic: str | None = option(
        None,
        'Topic of a Detection3DArray, Detection2DArray, MarkerArray, or of objects of Autoware',
        parse_text,
        unset='the only one',
        metavar='TOPIC',
    )
    class_map: tuple[tuple[str, str], ...] = option(
        (),
        "KITTI's class of each of your classes: car=Car 3=Pedestrian; NAME= leaves a class out,"
        " '*=' all others",
        parse_class_map,
        unset='the same name in any case',
        metavar='NAME=CLASS...',
    )
    tolerance_ns: int | None = option(
        None,
        'Largest distance in seconds between the stamps of a result and of its frame',
        parse_seconds_ns,
        name='tolerance',
        unset='half the time between frames',
        bounds=(0.0, 60.0),
    )

    def __post_init__(self) -> None:
        if self.tolerance_ns is not None:
            check_bounds(self, 'tolerance')
