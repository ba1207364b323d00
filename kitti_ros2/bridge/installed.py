# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whether Foxglove's SDK is there; the one part of bridge/ that may be imported where it is not."""

from __future__ import annotations

from ..model.errors import UsageError


def check_installed() -> None:
    """Complain where the SDK is missing, or too old to be controlled by a viewer.

    Raises:
        UsageError: What to install.
    """
    try:
        from foxglove.websocket import PlaybackState  # noqa: F401, PLC0415 - only here it may fail
    except ImportError:
        raise UsageError(
            "--foxglove needs foxglove-sdk 0.30; run pip install 'kitti_ros2[foxglove]'"
        ) from None
