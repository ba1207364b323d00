# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OpenCV's own threads, of which a fork has no copy but would wait for."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def one_opencv_thread(*, imported: bool) -> Iterator[None]:
    """End OpenCV's threads, so that processes can be forked which use it.

    Args:
        imported: Import OpenCV if it is not: once here takes less than once in each fork.
    """
    if not imported and 'cv2' not in sys.modules:
        yield
        return
    import cv2  # noqa: PLC0415 - 0.2 s

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
