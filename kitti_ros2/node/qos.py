# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service: the defaults, and rosbag2's file of overrides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from ..model.errors import UsageError
from ..model.spelling import did_you_mean
from ..model.yaml_text import YamlTextError, load_yaml

if TYPE_CHECKING:
    from collections.abc import Callable
    from enum import Enum
    from pathlib import Path
    from typing import TypeGuard


QosOverride: TypeAlias = 'dict[str, Any]'
"""The QoS of a topic in a file: values by their names in QoSProfile."""


def make_profile(latched: bool, depth: int, override: QosOverride | None) -> QoSProfile:  # noqa: FBT001
    """Make the profile of a publisher.

    Reliable and volatile, so that reliable and best-effort subscribers both match; latched topics
    are transient local.
    """
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    values = {
        'history': HistoryPolicy.KEEP_LAST,
        'depth': depth,
        'reliability': ReliabilityPolicy.RELIABLE,
        'durability': durability,
    }
    return QoSProfile(**{**values, **(override or {})})


def load_overrides(path: Path) -> dict[str, QosOverride]:
    """Load overrides by topic, in the format of ros2 bag's --qos-profile-overrides-path.

    Raises:
        UsageError: The file is missing, no YAML, or invalid.
    """
    try:
        if path.exists() and not path.is_file():  # reading a pipe would wait
            raise UsageError(f'{path}: is no regular file; expected a file with QoS overrides')
        content = load_yaml(path.read_bytes())
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; expected a file with QoS overrides') from None
    except YamlTextError as error:
        where = path if error.line is None else f'{path}:{error.line}'
        raise UsageError(
            f'{where}: no YAML, {error.problem}; expected topics with their QoS'
        ) from None
    if not isinstance(content, dict):
        raise UsageError(f'{path}: no mapping of topics to their QoS')
    return {str(topic): _override(path, str(topic), each) for topic, each in content.items()}


def _override(path: Path, topic: str, policies: object) -> QosOverride:
    if not topic.startswith('/'):
        raise UsageError(f'{path}: {topic!r} is no topic; names begin with /')
    if not isinstance(policies, dict):
        raise UsageError(f'{path}: {topic}: expected policies such as "depth: 5"')
    values = {}
    for name, value in policies.items():
        if name not in POLICIES:
            known = ', '.join(POLICIES) + did_you_mean(str(name), POLICIES)
            raise UsageError(f'{path}: {topic}: unknown policy {name!r}; known are {known}')
        try:
            values[name] = POLICIES[name](value)
        except ValueError as expected:
            raise UsageError(
                f'{path}: {topic}: {name} cannot be {value!r}; expected {expected}'
            ) from None
    return values


def _choice(kind: type[Enum], *names: str) -> Callable[[object], Enum]:
    known = {name: kind[name.upper()] for name in names}

    def parse(value: object) -> Enum:
        policy = known.get(str(value).lower())  # rosbag2 ignores case, too
        if policy is None:
            raise ValueError(f'one of {", ".join(names)}')
        return policy

    return parse


def _duration(value: object) -> Duration:
    """Parse a duration; zero means infinity and both parts are required, as in rosbag2."""
    expected = ValueError('{sec: SECONDS, nsec: NANOSECONDS}, whole numbers from 0')
    if not isinstance(value, dict) or set(value) != {'sec', 'nsec'}:
        raise expected
    if not all(_is_whole(part) for part in value.values()):
        raise expected
    nanoseconds = value['sec'] * 1_000_000_000 + value['nsec']
    if nanoseconds > _LONGEST_NS:
        raise ValueError(f'at most {_LONGEST_NS} ns in all')
    return Duration(nanoseconds=nanoseconds)


def _depth(value: object) -> int:
    if not _is_whole(value) or value > _DEEPEST:
        raise ValueError(f'a whole number from 0 to {_DEEPEST}')
    return value


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError('true or false')  # noqa: TRY004 - the value is wrong, not the call
    return value


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


_LONGEST_NS = 2**63 - 1  # of rcl
_DEEPEST = 2**31 - 1  # of DDS

POLICIES: dict[str, Callable[[object], object]] = {
    'history': _choice(HistoryPolicy, 'keep_last', 'keep_all', 'system_default'),
    'depth': _depth,
    'reliability': _choice(ReliabilityPolicy, 'reliable', 'best_effort', 'system_default'),
    'durability': _choice(DurabilityPolicy, 'volatile', 'transient_local', 'system_default'),
    'liveliness': _choice(LivelinessPolicy, 'automatic', 'manual_by_topic', 'system_default'),
    'deadline': _duration,
    'lifespan': _duration,
    'liveliness_lease_duration': _duration,
    'avoid_ros_namespace_conventions': _flag,
}
