# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The option of all commands with large outputs about the disk."""

from __future__ import annotations

from typing import Any

from .declare import option
from .parsers import parse_flag


def fsync_option(**rest: Any) -> bool:  # noqa: ANN401 - attributes of Option
    """Return the field of an options object: whether a finished output outlasts a power cut."""
    return option(
        True, 'Wait until the output is on the disk, safe from a power cut', parse_flag, **rest
    )
