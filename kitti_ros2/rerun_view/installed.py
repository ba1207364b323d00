# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A check for Rerun; the only module of rerun_view/ that can be imported without it."""

from __future__ import annotations

from importlib.util import find_spec

from ..model.errors import UsageError


def check_installed() -> None:
    """Check that the SDK is installed.

    Raises:
        UsageError: The SDK is not installed.
    """
    if find_spec('rerun') is None:
        raise UsageError(
            "--rerun needs rerun-sdk, which is not installed; run pip install 'kitti_ros2[rerun]'"
        )
