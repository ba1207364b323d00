# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Imports are not collected as garbage."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


def keep_imports() -> None:
    """Enable the collector that a program disabled at its start, without the objects of imports.

    Where the collector is enabled, what it has not collected yet stays its.
    """
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


@contextmanager
def imports_of_a_worker() -> Iterator[None]:
    """Keep what a process that starts imports inside; it has made nothing else yet."""
    gc.disable()
    try:
        yield
    finally:
        keep_imports()
