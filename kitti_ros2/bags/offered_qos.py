# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The QoS of a channel, from rosbag2's text of offered QoS profiles."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import product
from typing import Any

UNKNOWN_DEPTH = 100  # if a bag contains no depth: enough for every text file of a recording

_MOST = 2**31 - 1

# Metadata versions before 9 contain the number of rmw.
_TRANSIENT_LOCAL = (1, 'transient_local')
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default',
        'automatic',
        'manual_by_node',
        'manual_by_topic',
        'unknown',
        'best_available',
    ),
}
"""The words of each policy, at the places of their numbers. Source: rmw/types.h."""
_LONGEST_KEPT = 10_000
_MATCHED = ('reliability', 'durability')
"""Policies by which subscribers are matched with publishers."""
_HINT = re.compile(r'durability\W+(1\b|transient_local)', re.IGNORECASE)


def offered_qos(profiles: str) -> dict[str, Any]:
    """Return profiles, latched and depth of a StoredChannel from the text of its profiles."""
    depth = _kept_depth(profiles)
    return {'profiles': profiles, **(latched_qos(depth) if depth else {})}


def latched_qos(depth: int = UNKNOWN_DEPTH) -> dict[str, Any]:
    """Return latched and depth of a latched Channel."""
    return {'latched': True, 'depth': depth}


def _kept_depth(profiles: str) -> int:
    """Return the number of messages that publishers keep for late subscribers, 0 for none."""
    # A bag repeats a few texts, and is opened several times; long ones would fill the memory.
    find = _find_kept_depth if len(profiles) <= _LONGEST_KEPT else _find_kept_depth.__wrapped__
    return find(profiles)


@lru_cache(1000)
def _find_kept_depth(profiles: str) -> int:
    if not _HINT.search(profiles):
        return 0  # parsing YAML is slow
    from ..model.yaml_text import load_yaml  # noqa: PLC0415 - 13 ms for bags that latch a topic

    try:
        for profile in load_yaml(profiles):
            durability = profile.get('durability')
            if durability == 1 or str(durability).lower() in _TRANSIENT_LOCAL:
                depth = int(profile.get('depth') or UNKNOWN_DEPTH)
                return depth if 0 < depth <= _MOST else UNKNOWN_DEPTH
    except (TypeError, AttributeError, ValueError, OverflowError):
        return UNKNOWN_DEPTH
    return 0


def qos_faults(profiles: str) -> list[str]:
    """List what is wrong with the text of a channel's profiles; one is stored for each publisher.

    A text without any is valid: recorders write it where they do not know the publishers.
    """
    if not profiles.strip():
        return []
    from ..model.yaml_text import YamlTextError, load_yaml  # noqa: PLC0415 - as above

    try:
        found = load_yaml(profiles)
    except YamlTextError:
        found = None
    if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
        return ['the QoS profiles are no YAML list']
    faults = []
    offered: dict[str, set[object]] = {}
    for profile, (policy, words) in product(found, _POLICIES.items()):
        value = profile.get(policy)
        is_number = isinstance(value, int) and value in range(len(words))
        word = words[value] if is_number else value
        if word not in words:
            faults.append(f'{policy} of a publisher is {value!r}'[:100])
        offered.setdefault(policy, set()).add(str(word))
    differing = [policy for policy in _MATCHED if len(offered.get(policy, ())) > 1]
    faults += [f'publishers differ in {policy}' for policy in differing]
    return list(dict.fromkeys(faults))
