# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The QoS of a channel, from rosbag2's text of offered QoS profiles."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any

import yaml

from ..model.yaml_text import load_yaml

UNKNOWN_DEPTH = 100  # if a bag contains no depth: enough for every text file of a recording

_MOST = 2**31 - 1

# Metadata versions before 9 contain the number of rmw.
_TRANSIENT_LOCAL = (1, 'transient_local')
_HINT = re.compile(r'durability\W+(1\b|transient_local)', re.IGNORECASE)


def offered_qos(profiles: str) -> dict[str, Any]:
    """Return latched and depth of a Channel from the text of its profiles."""
    depth = _kept_depth(profiles)
    return latched_qos(depth) if depth else {}


def latched_qos(depth: int = UNKNOWN_DEPTH) -> dict[str, Any]:
    """Return latched and depth of a latched Channel."""
    return {'latched': True, 'depth': depth}


@lru_cache(1000)  # a bag repeats a few texts, and is opened several times
def _kept_depth(profiles: str) -> int:
    """Return the number of messages that publishers keep for late subscribers, 0 for none."""
    if not _HINT.search(profiles):
        return 0  # parsing YAML is slow
    try:
        for profile in load_yaml(profiles):
            durability = profile.get('durability')
            if durability == 1 or str(durability).lower() in _TRANSIENT_LOCAL:
                depth = int(profile.get('depth') or UNKNOWN_DEPTH)
                return depth if 0 < depth <= _MOST else UNKNOWN_DEPTH
    except (yaml.YAMLError, TypeError, AttributeError, ValueError, RecursionError):
        return UNKNOWN_DEPTH
    return 0
