# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a program as publishers of serialised messages."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos_overriding_options import QoSOverridingOptions, QoSPolicyKind

from ..model.errors import MissingDataError
from ..model.stamps import to_sec_nanosec
from ..model.text import one_line
from ..player.transport import Audience, Transport
from .byte_publisher import byte_publisher
from .flow import FlowControl
from .message_types import message_class
from .qos import make_profile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from ..player.program import Program
    from .qos import QosOverride

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
"""What rclpy raises for a topic: its name is none, or another type is published on it already."""

_CLOCK = struct.Struct('<4siI')
_ENCAPSULATION = b'\x00\x01\x00\x00'


class Outlets(Transport):
    """The publishers of a program; the Transport of a session.

    Subscribers detect a seek by the time going backwards.

    Args:
        node: The publishing node.
        program: The program with the topics.
        overrides: QoS by topic name.
        tell_time: Publishes a serialised rosgraph_msgs/Clock.
    """

    def __init__(
        self,
        node: Node,
        program: Program,
        overrides: Mapping[str, QosOverride],
        tell_time: Callable[[bytes], None],
    ) -> None:
        super().__init__(program.channels)
        self._node = node
        self._tell_time = tell_time
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
                self.complaints[index] = f'{topic} cannot be published: {one_line(str(error))}'
        # Sending a small message takes less time than acquiring the interpreter's lock again.
        self._publish = {
            index: byte_publisher(each) if self.channels[index].on_demand else each.publish
            for index, each in self._publishers.items()
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
                found = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
                nodes |= {
                    (bytes(each.endpoint_gid[:12]), each.node_namespace, each.node_name)
                    for each in found
                }
        return Audience(len(nodes), subscriptions)

    def has_subscriber(self, outlet: int) -> bool:
        """Whether an outlet has a subscriber."""
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

    def tell_time(self, stamp_ns: int) -> None:
        """Publish /clock."""
        self._tell_time(_CLOCK.pack(_ENCAPSULATION, *to_sec_nanosec(stamp_ns)))

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until all reliable messages are acknowledged; return the topics where one is not."""
        return self._flow.finish(seconds)

    def close(self) -> None:
        """Remove the topics."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()
        self._publish.clear()
