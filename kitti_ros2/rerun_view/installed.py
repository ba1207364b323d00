# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whether Rerun is there; the one part of rerun_view/ that may be imported where it is not."""

from __future__ import annotations

from importlib.util import find_spec

from ..model.errors import UsageError


def check_installed() -> None:
    """Complain where the SDK is missing.

    Raises:
        UsageError: It is not installed.
    """
    if find_spec('rerun') is None:
        raise UsageError(
            "--rerun needs rerun-sdk, which is not installed; run pip install 'kitti_ros2[rerun]'"
        )
