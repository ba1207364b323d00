# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the node until it ends or a stop is requested: init, threads, shutdown."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rclpy.logging import LoggingSeverity
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ..messages.cdr import peek_header
from ..messages.ros_types import TYPESTORE
from ..model.bag_formats import CLOUD
from .message_types import message_class
from .middleware import Closing, create_node, start_ros
from .node import Executor, KittiPlayer, read_decimally, to_parameters
from .outlets import Outlets
from .session import LAST_WAIT_S, favour_what_is_due
from .terminal import StatusLine, Terminal, play_to_the_end

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from rclpy.subscription import Subscription

    from .outlets import QosOverride
    from .playback import Answers
    from .program import Program
    from .terminal import StopRequest


def run_player(
    values: Mapping[str, Any],
    ros_args: Sequence[str],
    stop_request: StopRequest,
    *,
    keyboard: bool,
    quiet: bool = False,
) -> int:
    """Play until everything is played, or a stop is requested, or ROS shuts down.

    Args:
        values: Parameters by name; they have precedence over ros_args.
        ros_args: Arguments from --ros-args on.
        stop_request: The request to stop.
        keyboard: Whether the keys of a terminal control it.
        quiet: Whether to log only warnings and errors, without a status line.

    Returns:
        The number of losses if everything was played: messages that could not be made, data missing
        from the start, and topics whose last messages did not arrive in lossless mode; 0 if a stop
        was requested.

    Raises:
        KittiRos2Error: The source cannot be played, or a parameter is invalid.
    """
    favour_what_is_due()
    context = start_ros(read_decimally(ros_args))
    with Closing(stop_request) as closing:
        closing.callback(context.try_shutdown)
        status = StatusLine(show=not quiet)
        node = create_node(
            lambda: KittiPlayer(to_parameters(values), before_log=status.hide, context=context)
        )
        if quiet:
            node.get_logger().set_level(LoggingSeverity.WARN)
        node.on_ended = stop_request.set
        closing.callback(node.destroy_node)
        node.start()
        closing.callback(node.stop)
        spin_in_thread(node, closing, stop_request.set)
        terminal = Terminal(
            lambda text: node.get_logger().info(text),
            lambda text: node.get_logger().warning(text),
            status,
            keyboard=keyboard,
            quiet=quiet,
        )
        losses = play_to_the_end(node, stop_request, terminal)
        if node.session.late:
            closing.seconds -= LAST_WAIT_S
        return losses


def spin_in_thread(player: KittiPlayer, closing: Closing, ended: Callable[[], None]) -> None:
    """Run the callbacks of a player in a thread, until it is closed or ROS shuts down.

    Args:
        player: The player.
        closing: Ends the thread.
        ended: Called when it has ended.
    """
    executor = Executor(context=player.context)
    executor.add_node(player)
    stop = threading.Event()
    thread = threading.Thread(target=_spin, args=(executor, player, stop, ended), name='executor')
    thread.start()
    closing.callback(_end_spin, executor, stop, thread)


def _spin(
    executor: Executor, player: KittiPlayer, stop: threading.Event, ended: Callable[[], None]
) -> None:
    try:
        executor.run(stop, player.report_error)
    except Exception as error:  # noqa: BLE001 - the main thread raises it
        player.finish(error)
    finally:
        ended()


def _end_spin(executor: Executor, stop: threading.Event, thread: threading.Thread) -> None:
    # Shutting down a spinning executor destroys the wait set it is about to use; and it spins
    # until it has a task.
    stop.set()
    executor.create_task(lambda: None)
    thread.join()
    executor.shutdown()


# The player of a stack under test: it sends a frame when the one before is answered.

_TRANSFORMS = frozenset({'/tf', '/tf_static'})


class LivePlayer(KittiPlayer):
    """The player, with subscriptions to what a stack publishes.

    Args:
        answers: The answers of the stack.
        options: Arguments of KittiPlayer.
    """

    def __init__(self, answers: Answers, **options: Any) -> None:  # noqa: ANN401 - see above
        super().__init__(**options)
        self._answers = answers
        self._heard: dict[str, Subscription] = {}

    def _connect(self, program: Program, overrides: Mapping[str, QosOverride]) -> Outlets:
        return AnsweredOutlets(self, program, overrides, self._publish_time, self._answers)

    def report_error(self, error: Exception) -> None:
        """End with the error of a callback: an answer may be missing."""
        self.finish(error)

    def types_of(self, topic: str) -> list[str]:
        """Return the types of a topic's publishers now, such as nav_msgs/msg/Odometry."""
        publishers_info = self.get_publishers_info_by_topic(topic)
        return sorted({info.topic_type for info in publishers_info})

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
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
        if any(qos.reliability is ReliabilityPolicy.BEST_EFFORT for qos in offered):
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        lasting = DurabilityPolicy.TRANSIENT_LOCAL
        if offered and all(qos.durability is lasting for qos in offered):
            profile.durability = lasting
        kind = message_class(msgtype, TYPESTORE)
        self._heard[topic] = self.create_subscription(kind, topic, receive, profile, raw=True)

    def hears(self, topic: str) -> bool:
        """Return whether a publisher of a topic is connected to the subscription."""
        return topic in self._heard and bool(self._heard[topic].handle.get_publisher_count())


class AnsweredOutlets(Outlets):
    """Outlets that note the frames they send, and wait for the answers to them.

    Args:
        node, program, overrides, publish_time: See Outlets.
        answers: The answers of the stack.
    """

    def __init__(
        self,
        node: LivePlayer,
        program: Program,
        overrides: Mapping[str, QosOverride],
        publish_time: Callable[[bytes], None],
        answers: Answers,
    ) -> None:
        super().__init__(node, program, overrides, publish_time)
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
        """Return whether the stack has a small topic, and no image or scan that marks the frame."""
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
