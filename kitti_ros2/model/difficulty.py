# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Easy, moderate and hard: the levels of KITTI's object benchmark.

Source: MIN_HEIGHT, MAX_OCCLUSION and MAX_TRUNCATION in evaluate_object.cpp of the object devkit. A
label counts at a level if its 2D box is at least so high and it is at most so occluded and
truncated; each level includes the easier ones. Unknown occlusion and truncation, -1, are within
every limit; occlusion 3, unknown to the annotator, is within none.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .boxes import Box


class Difficulty(str, Enum):
    """The levels, the easiest first."""

    EASY = 'easy'
    MODERATE = 'moderate'
    HARD = 'hard'


class DifficultyLimits(NamedTuple):
    """The limits of a level.

    Attributes:
        height_px: Least height of the 2D box, pixels.
        occluded: Greatest occlusion, as in Box.
        truncated: Greatest truncation, as in Box.
    """

    height_px: float
    occluded: int
    truncated: float


LIMITS = {
    Difficulty.EASY: DifficultyLimits(40, 0, 0.15),
    Difficulty.MODERATE: DifficultyLimits(25, 1, 0.30),
    Difficulty.HARD: DifficultyLimits(25, 2, 0.50),
}


def difficulty_of(box: Box) -> Difficulty | None:
    """Return the easiest level at which a label counts; None if it counts at none."""
    _, top, _, bottom = box.box_2d
    for level, limits in LIMITS.items():
        if (
            bottom - top >= limits.height_px
            and box.occluded <= limits.occluded
            and box.truncated <= limits.truncated
        ):
            return level
    return None
