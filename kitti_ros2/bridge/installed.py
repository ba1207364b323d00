# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A check for Foxglove's SDK; the only module of bridge/ that can be imported without it."""

from __future__ import annotations

from ..model.errors import UsageError


def check_installed() -> None:
    """Check that the SDK is installed and supports playback control.

    Raises:
        UsageError: It is missing or too old.
    """
    try:
        from foxglove.websocket import PlaybackState  # noqa: F401, PLC0415 - only here it may fail
    except ImportError:
        raise UsageError(
            "--foxglove needs foxglove-sdk 0.30; run pip install 'kitti_ros2[foxglove]'"
        ) from None
