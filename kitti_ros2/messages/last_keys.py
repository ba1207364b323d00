# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detects messages that repeat the last one of their topic, such as an unchanged calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable


class LastKeys:
    """The keys of the last messages of topics; see Topic.change_key."""

    def __init__(self) -> None:
        self._keys: dict[int, Hashable] = {}

    def repeats(self, topic: int, key: Hashable) -> bool:
        """Whether a message has the key of its topic's last one; its key is then the last.

        Messages without a key, None, never repeat.
        """
        if key is None:
            return False
        if self._keys.get(topic) == key:
            return True
        self._keys[topic] = key
        return False
