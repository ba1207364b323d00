# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the 100 Hz packets of an unsynchronised drive."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from .declare import choice, option
from .parsers import parse_path

if TYPE_CHECKING:
    from pathlib import Path


class ImuStamps(str, Enum):
    """Stamps of the packets: those of the files, or a line fitted to them."""

    ORIGINAL = 'original'
    REGULAR = 'regular'


@dataclass(frozen=True)
class ImuOptions:
    """Options of the 100 Hz packets of an unsynchronised drive.

    Attributes:
        path: The extract of the drive; None takes the synchronised packets.
        stamps: Of its packets.

    Raises:
        UsageError: Regular stamps are requested without an extract.
    """

    group: ClassVar = 'IMU'

    path: Path | None = option(
        None,
        '100 Hz Imu, fix and velocity of the unsynchronised drive, DRIVE_extract',
        parse_path,
        name='imu_from',
        unset="the drive's own, 10 Hz",
        live=True,
        metavar='DIR',
    )
    stamps: ImuStamps = choice(
        ImuStamps.ORIGINAL,
        'With --imu-from: stamps of the files, or evenly spaced ones fitted to them',
        ImuStamps,
        name='imu_stamps',
        live=True,
    )

    def __post_init__(self) -> None:
        if self.path is None and self.stamps is not ImuStamps.ORIGINAL:
            raise UsageError('--imu-stamps is for --imu-from; give both')
