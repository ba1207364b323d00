# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How bags become a KITTI data set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.streams import Layout


@dataclass(frozen=True)
class ImportOptions:
    """How bags become KITTI.

    Attributes:
        layout: raw, object, odometry or tracking; None for a bag of our own, which has one.
        name: Drive, split or sequence, None for the plan's.
        calib: A KITTI calibration file or folder instead of the bag's own calibration.
        train_fraction: The part of an object set's frames that trains, 0 to 1.
        append: Whether an object set is continued instead of begun.

    Raises:
        UsageError: A value is out of range, or does not go with the others.
    """

    layout: Layout | None = None
    name: str | None = None
    calib: Path | None = None
    train_fraction: float = 1.0
    append: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.train_fraction <= 1:
            raise UsageError(f'a split of {self.train_fraction:g}; expected 0 to 1, such as 0.8')

    def keeps(self, layout: Layout) -> bool:
        """Whether a recording of a layout is to be laid out as it was."""
        as_it_was = self.layout in (None, layout) and self.name is None and self.calib is None
        return as_it_was and not self.append
