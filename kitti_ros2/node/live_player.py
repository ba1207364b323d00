# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player of a stack under test: it sends a frame when the one before is answered."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rclpy.logging import LoggingSeverity
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ..messages.header import peek_header
from ..messages.ros_types import TYPESTORE
from ..model.msgtypes import CLOUD
from ..player.session import favour_what_is_due
from .closing import Closing
from .creation import create_node
from .message_types import message_class
from .middleware import start_ros
from .outlets import Outlets
from .parameters import to_parameters
from .player import KittiPlayer
from .run import spin_in_thread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from rclpy.subscription import Subscription

    from ..player.answers import Answers
    from ..player.program import Program
    from .qos import QosOverride

_TRANSFORMS = frozenset({'/tf', '/tf_static'})


class LivePlayer(KittiPlayer):
    """The player, with subscriptions to what a stack publishes.

    Args:
        answers: The answers of the stack.
        options: Those of KittiPlayer.
    """

    def __init__(self, answers: Answers, **options: Any) -> None:  # noqa: ANN401 - see above
        super().__init__(**options)
        self._answers = answers
        self._heard: dict[str, Subscription] = {}

    def _connect(self, program: Program, overrides: Mapping[str, QosOverride]) -> Outlets:
        return AnsweredOutlets(self, program, overrides, self._tell_time, self._answers)

    def tell_of(self, error: Exception) -> None:
        """End with the error of a callback: an answer may be missing."""
        self.finish(error)

    def types_of(self, topic: str) -> list[str]:
        """Return the types of a topic's publishers now, such as nav_msgs/msg/Odometry."""
        found = self.get_publishers_info_by_topic(topic)
        return sorted({each.topic_type for each in found})

    def others(self) -> list[str]:
        """Return the topics that other nodes publish now, without those that all nodes have."""
        own = {publisher.topic_name for publisher in self.publishers}
        names = [name for name, _ in self.get_topic_names_and_types() if name not in own]
        usual = {'/rosout', '/parameter_events'}
        return [name for name in names if name not in usual and self.count_publishers(name)]

    def hear(self, topic: str, msgtype: str, receive: Callable[[bytes], None]) -> None:
        """Subscribe to a topic, with the reliability and durability that its publishers offer.

        Args:
            topic: The topic.
            msgtype: Its type.
            receive: Called with each message as it was received, from the executor's thread.

        Raises:
            MissingDataError: The type is unknown, or its installed package is broken.
        """
        offered = [each.qos_profile for each in self.get_publishers_info_by_topic(topic)]
        profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
        if any(each.reliability is ReliabilityPolicy.BEST_EFFORT for each in offered):
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        lasting = DurabilityPolicy.TRANSIENT_LOCAL
        if offered and all(each.durability is lasting for each in offered):
            profile.durability = lasting
        kind = message_class(msgtype, TYPESTORE)
        self._heard[topic] = self.create_subscription(kind, topic, receive, profile, raw=True)

    def hears(self, topic: str) -> bool:
        """Whether a publisher of a topic is connected to the subscription."""
        return topic in self._heard and bool(self._heard[topic].handle.get_publisher_count())


class AnsweredOutlets(Outlets):
    """Outlets that note the frames they send, and wait for the answers to them.

    Args:
        node, program, overrides, tell_time: See Outlets.
        answers: The answers of the stack.
    """

    def __init__(
        self,
        node: LivePlayer,
        program: Program,
        overrides: Mapping[str, QosOverride],
        tell_time: Callable[[bytes], None],
        answers: Answers,
    ) -> None:
        super().__init__(node, program, overrides, tell_time)
        self._answers = answers
        self._frame = 0

    def may_begin(self, frame: int, seconds: float) -> bool:
        """Wait until the frames before are answered; see Transport."""
        self._frame = frame
        return self._answers.may_begin(seconds)

    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data, and note the frame if the stack gets it."""
        channel = self.channels[outlet]
        if channel.on_demand:
            stamp_ns, _ = peek_header(data)  # in a bag of others the time of a message differs
        if channel.on_demand or self._is_heard_without_large(outlet):
            self._answers.sent(self._frame, stamp_ns, scan=channel.msgtype == CLOUD)
        super().publish(outlet, data, stamp_ns)

    def _is_heard_without_large(self, outlet: int) -> bool:
        """Whether the stack hears a small topic, and no image or scan that would mark the frame."""
        channel = self.channels[outlet]
        if self._wanted or channel.latched or channel.topic in _TRANSFORMS:
            return False
        return self.has_subscriber(outlet)


class _NoRequest:
    """The stop request of a player that is closed by its context."""

    def set(self) -> None:
        """Do nothing."""

    def wait(self) -> None:
        """Do nothing."""

    def abandon(self) -> None:
        """Do nothing."""


@contextmanager
def open_live_player(
    source: Path, played: Mapping[str, object], wait_for: int, answers: Answers
) -> Iterator[LivePlayer]:
    """Start a player, paused; it is closed at the end of the context.

    Args:
        source: A KITTI folder or a bag.
        played: Options of play by name.
        wait_for: Number of nodes to wait for.
        answers: The answers of the stack.

    Raises:
        KittiRos2Error: The source cannot be played, or ROS cannot start.
    """
    favour_what_is_due()
    own = {'source': str(source), 'lossless': True, 'start_paused': True, 'wait_for': wait_for}
    context = start_ros([])
    with Closing(_NoRequest()) as closing:
        closing.callback(context.try_shutdown)
        parameters = to_parameters({**played, **own})
        player = create_node(lambda: LivePlayer(answers, overrides=parameters, context=context))
        player.get_logger().set_level(LoggingSeverity.FATAL)  # its session reports all losses
        closing.callback(player.destroy_node)
        player.start()
        closing.callback(player.stop)
        spin_in_thread(player, closing, lambda: None)
        yield player
