# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service: the defaults, and rosbag2's file of overrides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from ..errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass(frozen=True)
class QosOverride:
    """What a file says of a topic: values by the name that QoSProfile has for them."""

    values: dict[str, Any]


def make_profile(latched: bool, depth: int, override: QosOverride | None) -> QoSProfile:  # noqa: FBT001
    """The profile of a publisher.

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
    return QoSProfile(**{**values, **(override.values if override else {})})


def load_overrides(path: Path) -> dict[str, QosOverride]:
    """The overrides of a file, by topic: the format of ros2 bag's --qos-profile-overrides-path.

    Raises:
        UsageError: The file is not there, no YAML, or says what cannot be.
    """
    try:
        content = yaml.safe_load(path.read_text('utf-8'))
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; it should hold QoS overrides') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'{path}:{mark.line + 1}' if mark is not None else str(path)
        raise UsageError(f'{where}: no YAML; expected topics with their QoS') from None
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
        if name not in _POLICIES:
            known = ', '.join(_POLICIES)
            raise UsageError(f'{path}: {topic}: unknown policy {name!r}; known are {known}')
        try:
            field, parsed = _POLICIES[name](value)
        except (KeyError, TypeError, ValueError):
            raise UsageError(f'{path}: {topic}: {name} cannot be {value!r}') from None
        values[field] = parsed
    return QosOverride(values)


def _choice(field: str, kind: type, *names: str) -> Callable[[Any], tuple[str, Any]]:
    known = {name: kind[name.upper()] for name in names}  # type: ignore[index] # an enum
    return lambda value: (field, known[value])


def _duration(field: str) -> Callable[[Any], tuple[str, Any]]:
    def parse(value: Any) -> tuple[str, Any]:  # noqa: ANN401 - from YAML
        if set(value) - {'sec', 'nsec'}:
            raise ValueError(value)
        return field, Duration(
            seconds=int(value.get('sec', 0)), nanoseconds=int(value.get('nsec', 0))
        )

    return parse


def _whole(field: str) -> Callable[[Any], tuple[str, Any]]:
    def parse(value: Any) -> tuple[str, Any]:  # noqa: ANN401 - from YAML
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise ValueError(value)
        return field, value

    return parse


def _flag(field: str) -> Callable[[Any], tuple[str, Any]]:
    def parse(value: Any) -> tuple[str, Any]:  # noqa: ANN401 - from YAML
        if not isinstance(value, bool):
            raise TypeError(value)
        return field, value

    return parse


_POLICIES: dict[str, Callable[[Any], tuple[str, Any]]] = {
    'history': _choice('history', HistoryPolicy, 'keep_last', 'keep_all', 'system_default'),
    'depth': _whole('depth'),
    'reliability': _choice(
        'reliability', ReliabilityPolicy, 'reliable', 'best_effort', 'system_default'
    ),
    'durability': _choice(
        'durability', DurabilityPolicy, 'volatile', 'transient_local', 'system_default'
    ),
    'liveliness': _choice(
        'liveliness', LivelinessPolicy, 'automatic', 'manual_by_topic', 'system_default'
    ),
    'deadline': _duration('deadline'),
    'lifespan': _duration('lifespan'),
    'liveliness_lease_duration': _duration('liveliness_lease_duration'),
    'avoid_ros_namespace_conventions': _flag('avoid_ros_namespace_conventions'),
}
