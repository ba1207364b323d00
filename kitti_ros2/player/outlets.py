# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a program as publishers of serialised messages."""

from __future__ import annotations

import ctypes
import struct
import time
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions, QoSPolicyKind

from ..model.errors import MissingDataError, UsageError, did_you_mean, one_line
from ..model.streams import to_sec_nanosec
from ..model.yaml_text import YamlTextError, load_yaml
from .message_types import message_class
from .session import Audience, Transport

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from enum import Enum
    from pathlib import Path
    from typing import TypeGuard

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from .program import Program


# Flow control: a publisher waits for acknowledgements before its queue overwrites a message.

_SLOW_NS = 1_000_000_000
_STALLED_NS = 5_000_000_000
_SAY_EVERY_S = 10.0


class FlowControl:
    """Bounds the unacknowledged messages of reliable publishers; best-effort ones have no bound.

    The middleware only reports whether all messages of a publisher are acknowledged.

    Args:
        publishers: By outlet.
        logger: An rclpy logger; warns about slow subscribers and about those that may have stopped.
        now_ns: Steady time.
    """

    def __init__(
        self,
        publishers: Mapping[int, Publisher],
        logger: Any,  # noqa: ANN401 - rclpy has no types
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._publishers = publishers
        self._logger = logger
        self._now_ns = now_ns
        self._window = {
            outlet: max(1, publisher.qos_profile.depth - 1)
            for outlet, publisher in publishers.items()
            if publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        }
        self._unacknowledged = dict.fromkeys(self._window, 0)
        self._waiting_since: dict[int, int] = {}

    def make_room(self, outlet: int, seconds: float) -> bool:
        """Wait until the queue of an outlet has room for one message; return whether it has."""
        window = self._window.get(outlet)
        if window is None:
            return True
        if self._unacknowledged[outlet] >= window:
            since_ns = self._waiting_since.setdefault(outlet, self._now_ns())
            arrived = self._arrived(outlet, seconds)
            self._say(outlet, self._now_ns() - since_ns, arrived=arrived)
            if not arrived:
                return False
            del self._waiting_since[outlet]
            self._unacknowledged[outlet] = 0
        self._unacknowledged[outlet] += 1
        return True

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until every message is acknowledged; return the topics where one is not."""
        end_ns = self._now_ns() + int(seconds * 1e9)
        return tuple(
            self._publishers[outlet].topic_name
            for outlet in self._window
            if not self._arrived(outlet, max(0.0, (end_ns - self._now_ns()) / 1e9))
        )

    def _arrived(self, outlet: int, seconds: float) -> bool:
        arrived: bool = self._publishers[outlet].wait_for_all_acked(Duration(seconds=seconds))
        return arrived

    def _say(self, outlet: int, waited_ns: int, *, arrived: bool) -> None:
        name = self._publishers[outlet].topic_name
        count = self._unacknowledged[outlet]
        seconds = waited_ns / 1e9
        # Two calls: rclpy throttles each line of code separately.
        if arrived and waited_ns >= _SLOW_NS:
            text = f'{name}: slow subscriber, {seconds:.1f} s to acknowledge {count} messages'
            self._logger.warning(text, throttle_duration_sec=_SAY_EVERY_S)
        elif not arrived and waited_ns >= _STALLED_NS:
            text = (
                f'{name}: the last {count} messages are not all acknowledged after {seconds:.0f} s;'
                f' a subscriber may have stopped'
            )
            self._logger.warning(text, throttle_duration_sec=_SAY_EVERY_S)


# Publishes serialised messages without holding the interpreter's lock.
#
# rclpy keeps the lock while the middleware copies a message, half a millisecond for a scan, so that
# the next message cannot be read in that time. The same function of rcl, called through ctypes,
# releases it: rcl_publish_serialized_message of rcl/publisher.h, with rcl_serialized_message_t,
# which is rcutils_uint8_array_t of rcutils/types/uint8_array.h.

_OK = 0


class _SerializedMessage(ctypes.Structure):
    """rcutils_uint8_array_t; the allocator is not used for reading."""

    _fields_: ClassVar = [
        ('buffer', ctypes.c_char_p),
        ('buffer_length', ctypes.c_size_t),
        ('buffer_capacity', ctypes.c_size_t),
        ('allocator', ctypes.c_void_p * 5),
    ]


@lru_cache(maxsize=1)
def _rcl_publish() -> Any:  # noqa: ANN401 - a C function, or None if it is not found
    try:
        function = ctypes.CDLL('librcl.so').rcl_publish_serialized_message
    except (OSError, AttributeError):
        return None
    function.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(_SerializedMessage),
        ctypes.c_void_p,
    ]
    function.restype = ctypes.c_int32
    return function


def byte_publisher(publisher: Publisher) -> Callable[[bytes], None]:
    """Return a function that publishes serialised messages like publisher.publish; one thread."""
    function, handle = _rcl_publish(), publisher.handle
    if function is None or not hasattr(handle, 'pointer'):
        plain: Callable[[bytes], None] = publisher.publish
        return plain
    pointer = handle.pointer
    message = _SerializedMessage()
    reference = ctypes.byref(message)

    def publish(data: bytes) -> None:
        message.buffer = data
        message.buffer_length = message.buffer_capacity = len(data)
        with handle:  # keeps it from being destroyed
            result = function(pointer, reference, None)
        message.buffer = None
        if result != _OK:
            publisher.publish(data)  # raises the proper error

    return publish


# Quality of service: the defaults, and rosbag2's file of overrides.

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
    return {str(topic): _override(path, str(topic), qos) for topic, qos in content.items()}


def _override(path: Path, topic: str, policies: object) -> QosOverride:
    if not topic.startswith('/'):
        raise UsageError(f'{path}: {topic!r} is no topic; names begin with /')
    if not isinstance(policies, dict):
        raise UsageError(f'{path}: {topic}: expected policies such as "depth: 5"')
    values = {}
    for name, value in policies.items():
        if name not in POLICIES:
            policy_names = ', '.join(POLICIES) + did_you_mean(str(name), POLICIES)
            raise UsageError(f'{path}: {topic}: unknown policy {name!r}; known are {policy_names}')
        try:
            values[name] = POLICIES[name](value)
        except ValueError as expected:
            raise UsageError(
                f'{path}: {topic}: {name} cannot be {value!r}; expected {expected}'
            ) from None
    return values


def _choice(kind: type[Enum], *names: str) -> Callable[[object], Enum]:
    choices = {name: kind[name.upper()] for name in names}

    def parse(value: object) -> Enum:
        policy = choices.get(str(value).lower())  # rosbag2 ignores case, too
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


_OVERRIDABLE = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)
_REFUSALS = (
    rclpy_implementation.RCLError,
    InvalidTopicNameException,
    ValueError,
)
"""Errors of rclpy for a topic: an invalid name, or another type is published on it already."""

_CLOCK = struct.Struct('<4siI')
_ENCAPSULATION = b'\x00\x01\x00\x00'


class Outlets(Transport):
    """The publishers of a program; the Transport of a session.

    Subscribers detect a seek by the time going backwards.

    Args:
        node: The publishing node.
        program: The program with the topics.
        overrides: QoS by topic name.
        publish_time: Publishes a serialised rosgraph_msgs/Clock.
    """

    def __init__(
        self,
        node: Node,
        program: Program,
        overrides: Mapping[str, QosOverride],
        publish_time: Callable[[bytes], None],
    ) -> None:
        super().__init__(program.channels)
        self._node = node
        self._publish_time = publish_time
        self._publishers: dict[int, Publisher] = {}
        for index, outlet in enumerate(self.channels):
            try:
                self._publishers[index] = node.create_publisher(
                    message_class(outlet.msgtype, program.typestore),
                    outlet.topic,
                    make_profile(outlet.latched, outlet.depth, overrides.get(outlet.topic)),
                    qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
                )
            except (MissingDataError, *_REFUSALS) as error:
                topic = one_line(outlet.topic) or 'a topic without a name'
                self.unpublishable[index] = f'{topic} cannot be published: {one_line(str(error))}'
        # Sending a small message takes less time than acquiring the interpreter's lock again.
        self._publish = {
            index: byte_publisher(pub) if self.channels[index].on_demand else pub.publish
            for index, pub in self._publishers.items()
        }
        self._flow = FlowControl(self._publishers, node.get_logger())

    def audience(self) -> Audience:
        """Count the subscribing nodes and their subscriptions, of all outlets.

        Participant and name identify a node: a GID begins with the 12 bytes of the participant's
        GUID prefix (RTPS 2.3, 8.2.4.1).
        """
        nodes = set()
        subscriptions = 0
        for publisher in self._publishers.values():
            matched = publisher.get_subscription_count()
            if matched:
                subscriptions += matched
                infos = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
                nodes |= {
                    (bytes(info.endpoint_gid[:12]), info.node_namespace, info.node_name)
                    for info in infos
                }
        return Audience(len(nodes), subscriptions)

    def has_subscriber(self, outlet: int) -> bool:
        """Return whether an outlet has a subscriber."""
        return bool(self._publishers[outlet].get_subscription_count())

    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:  # noqa: ARG002 - see Transport
        """Publish serialised data."""
        self._publish[outlet](data)

    def make_room(self, outlet: int, seconds: float) -> bool:
        """Wait until a reliable outlet's queue has room for one message.

        Returns:
            Whether it has room; always True for best-effort outlets.
        """
        return self._flow.make_room(outlet, seconds)

    def publish_time(self, stamp_ns: int) -> None:
        """Publish /clock."""
        self._publish_time(_CLOCK.pack(_ENCAPSULATION, *to_sec_nanosec(stamp_ns)))

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until all reliable messages are acknowledged; return the topics where one is not."""
        return self._flow.finish(seconds)

    def close(self) -> None:
        """Remove the topics."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()
        self._publish.clear()
