# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the node until it ends or a stop is requested: init, threads, shutdown."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from rclpy.logging import LoggingSeverity

from ..player.session import LAST_WAIT_S, favour_what_is_due
from ..player.status import StatusLine, Terminal
from ..player.to_the_end import play_to_the_end
from .callbacks import Executor
from .closing import Closing
from .creation import create_node
from .middleware import start_ros
from .parameters import to_parameters
from .player import KittiPlayer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ..player.to_the_end import StopRequest


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
    context = start_ros(ros_args)
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
        executor.run(stop, player.tell_of)
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
