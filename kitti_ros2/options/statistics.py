# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of statistics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .declare import option
from .parsers import parse_flag


@dataclass(frozen=True)
class StatisticsOptions:
    """Options of statistics.

    Attributes:
        points: Whether scans are read, to count the points inside 3D boxes.
    """

    group: ClassVar = 'Statistics'

    points: bool = option(False, 'Also count points in boxes; reads all scans', parse_flag)
