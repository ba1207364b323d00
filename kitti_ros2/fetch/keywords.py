# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Types of the keyword options: those of the command line, with underscores."""

from __future__ import annotations

from typing import TypedDict


class ExtractKeywords(TypedDict, total=False):
    """Options of extract."""

    overwrite: bool
    remove_archives: bool
    max_ratio: float
    max_size: int | str
