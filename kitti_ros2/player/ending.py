# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How a player is told to end."""

from __future__ import annotations

from typing import Protocol


class Ending(Protocol):
    """What the main thread of a player waits for."""

    def set(self) -> None:
        """Let the wait end; from any thread or signal handler."""

    def wait(self) -> None:
        """Wait for it."""

    def abandon(self) -> None:
        """Let the process end without what cannot be closed."""
