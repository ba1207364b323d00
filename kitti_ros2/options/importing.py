# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the conversion from bags to a KITTI data set."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.geographic import GeoOrigin
from ..model.layouts import Layout
from .declare import choice, option
from .disk import fsync_option
from .parsers import parse_flag, parse_number, parse_path, parse_text
from .selection import SelectionOptions

if TYPE_CHECKING:
    from pathlib import Path


def parse_origin(name: str, value: object) -> str:
    """Parse LAT,LON,ALT, degrees and metres."""
    text = ','.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
    try:
        GeoOrigin.parse(text)
    except ValueError as error:
        raise UsageError(f'{name} is {error}') from None
    return text


@dataclass(frozen=True)
class ImportOptions:
    """Options of the conversion from bags to KITTI.

    Attributes:
        layout: One of KITTI's; None keeps that of a bag written by to-bag.
        name: Drive, split or sequence, None takes the plan's.
        calib: A KITTI calibration file or folder instead of the bag's own calibration.
        origin: Place of the origin of poses that become oxts, LAT,LON,ALT; None takes the plan's.
        train_fraction: Fraction of an object set's frames in train, 0 to 1.
        all_cameras: Whether each camera of a bag of others gets a data set of its own.
        append: Whether to continue the numbering of an existing object set.
        overwrite: Whether an existing data set may be replaced.
        fsync: Whether the finished data set outlasts a power cut.
        selection: First and last frame to convert: KITTI's file numbers in a bag written by
            to-bag, else the numbers that a conversion of the whole bag gives.

    Raises:
        UsageError: A value is out of range, or does not go with the others.
    """

    group: ClassVar = 'Data set'

    layout: Layout | None = choice(
        None, 'Layout to write', Layout, unset='that of a bag written by to-bag'
    )
    name: str | None = option(
        None,
        '2011_09_26_drive_0001_sync, training or testing, sequence 00 or 0000',
        parse_text,
        unset="the plan's",
        metavar='NAME',
    )
    calib: Path | None = option(
        None,
        "KITTI calibration file or folder instead of the bag's calibration",
        parse_path,
        unset="the bag's",
    )
    origin: str | None = option(
        None,
        "Raw, tracking: LAT,LON,ALT of the poses' origin where the bag has no NavSatFix",
        parse_origin,
        unset="the plan's, or 0,0,0",
        metavar='LAT,LON,ALT',
    )
    train_fraction: float = option(
        1.0,
        'Object: fraction of the frames in train, the rest in val',
        parse_number,
        flags=('--split',),
    )
    all_cameras: bool = option(
        False, 'Write one data set for each camera, with scans in common', parse_flag
    )
    append: bool = option(
        False, 'Object: continue the numbering of the data set in OUT', parse_flag
    )

    overwrite: bool = option(False, 'Replace the data set in OUT', parse_flag)
    fsync: bool = fsync_option()
    selection: SelectionOptions = field(default_factory=SelectionOptions)

    def __post_init__(self) -> None:
        if self.append and self.overwrite:
            raise UsageError('--append and --overwrite exclude each other')
        if not 0 <= self.train_fraction <= 1:
            raise UsageError(f'a split of {self.train_fraction:g}; expected 0 to 1, such as 0.8')

    def keeps(self, layout: Layout) -> bool:
        """Whether a recording of this layout keeps its original folders and names."""
        unchanged = self.layout in (None, layout) and self.name is None and self.calib is None
        return unchanged and not self.append and not self.all_cameras
