# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cost of an action where a clock would be too noisy."""

from __future__ import annotations

import sys
from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType


def runs_of(function: Callable[..., object], action: Callable[[], object]) -> int:
    """Return how often a function of Python runs in an action."""
    runs = count()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        if event == 'call' and frame.f_code is function.__code__:
            next(runs)

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return next(runs)


def calls_of(action: Callable[[], object]) -> int:
    """Return how many functions, of Python and of C, an action calls."""
    calls = count()

    def note(_frame: object, event: str, _argument: object) -> None:
        if event in {'call', 'c_call'}:
            next(calls)

    sys.setprofile(note)
    try:
        action()
    finally:
        sys.setprofile(None)
    return next(calls)
