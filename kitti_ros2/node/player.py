# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The node kitti_player: parameters and services around the session that plays."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from ..model.errors import KittiRos2Error, UsageError, describe_error
from ..options.selection import Bound
from ..options.table import make_play_settings
from ..player.session import Session
from ..player.source import CLOCK, describe, open_program, publishes_clock, reserved_by_node
from ..player.state import encode_state
from .callbacks import contained, describe_unexpected
from .controls import create_services
from .outlets import Outlets
from .parameters import declare, given
from .qos import load_overrides

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.parameter import Parameter

    from ..options.settings import PlaySettings
    from ..player.playback import Playback
    from ..player.program import Program
    from .qos import QosOverride

NODE_NAME = 'kitti_player'
_STATE_EVERY_NS = 200_000_000
_WARN_EVERY_S = 1.0
_LIVE = ('rate', 'loop', 'step')
_OF_SOURCE = ('source', 'layout', 'sequence', 'predictions', 'iou', 'imu_from', 'imu_stamps')


class _AnnouncedLogger:
    """An rclpy logger that calls a function before each use.

    It only looks methods up: rclpy throttles each calling line of code by itself.
    """

    def __init__(self, logger: Any, before: Callable[[], None]) -> None:  # noqa: ANN401 - of rclpy
        self._logger = logger
        self._before = before

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any method of the logger
        self._before()
        return getattr(self._logger, name)


class KittiPlayer(Node):  # type: ignore[misc] # rclpy has no types
    """Plays one source after another; the constructor only declares parameters.

    Args:
        overrides: Parameter values with precedence over all others.
        before_log: Called before each line of the log.
        context: The rclpy context.

    Attributes:
        ended: Set when the session has ended or was stopped by a control.
        on_ended: Called then, from the session's thread.
        error: The error that ended the session, if any.

    Raises:
        UsageError: A parameter's value has another type, or is out of range.
    """

    def __init__(
        self,
        overrides: Sequence[Parameter] = (),
        before_log: Callable[[], None] = lambda: None,
        **options: Any,  # noqa: ANN401 - those of Node
    ) -> None:
        self._before_log = before_log
        super().__init__(
            NODE_NAME,
            parameter_overrides=list(overrides),
            enable_logger_service=True,
            **options,
        )
        self.ended = threading.Event()
        self.on_ended: Callable[[], None] = lambda: None
        self.error: BaseException | None = None
        self._session: Session | None = None
        self._prepared: Session | None = None
        self._tell_time: Callable[[bytes], None] = lambda _: None
        self._state_ns = 0
        self._state_lock = threading.Lock()
        self._values = declare(self)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._state_publisher = self.create_publisher(DiagnosticArray, '~/state', latched)

    def get_logger(self) -> Any:  # noqa: ANN401 - rclpy has no types
        """Return the logger, which calls before_log first."""
        return _AnnouncedLogger(super().get_logger(), self._before_log)

    def create_service(self, srv_type: Any, srv_name: str, callback: Any, **options: Any) -> Any:  # noqa: ANN401 - those of Node
        """Create a service, also those of Node, that answers requests which raise an error."""
        handler = contained(srv_type, callback, self._warn)
        return super().create_service(srv_type, srv_name, handler, **options)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text, throttle_duration_sec=_WARN_EVERY_S)

    # Start and stop.

    def start(self) -> None:
        """Open the source and play it.

        Raises:
            KittiRos2Error: The source cannot be opened, or a parameter is invalid.
            OSError: The same.
        """
        settings = make_play_settings(given(self._values))
        program = self._open(str(self._values['source']), settings)
        if publishes_clock(settings):
            self._tell_time = self.create_publisher(Clock, CLOCK, 10).publish
        create_services(self, self)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._play(self._prepare(program, settings))

    def stop(self) -> None:
        """Stop the session."""
        session, self._session = self._session, None
        if session is not None:
            self._say_who_was_missing(session)
            session.stop()

    def tell_of(self, error: Exception) -> None:
        """Report the error of a callback, which concerns nothing else."""
        self._warn(f'a callback failed: {describe_unexpected(error)}')

    def finish(self, error: BaseException | None) -> None:
        """Report the end, and the error that led to it, if any."""
        self.error = error
        self.ended.set()
        self.on_ended()

    @property
    def session(self) -> Session:
        """The current session."""
        if self._session is None:
            raise UsageError('no session is running')
        return self._session

    @property
    def playback(self) -> Playback:
        """The controls of the session."""
        return self.session.playback

    def set_rate(self, rate: float) -> None:
        """Set the rate, and the parameter.

        Raises:
            UsageError: The rate is out of range.
        """
        parameter = self.get_parameter('rate')
        changed = type(parameter)('rate', value=float(rate))
        result = self.set_parameters([changed])[0]
        if not result.successful:
            raise UsageError(result.reason)

    def tell_state(self) -> None:
        """Publish the state."""
        session = self._session
        if session is None:
            return
        with self._state_lock:
            self._state_ns = time.monotonic_ns()
            self._state_publisher.publish(
                encode_state(
                    self.get_fully_qualified_name(),
                    session.program.name,
                    session.playback.state(),
                    session.counts,
                )
            )

    # Sources.

    def _open(self, source: str, settings: PlaySettings) -> Program:
        if not source:
            raise UsageError(
                'SRC is missing (a KITTI folder or a bag); usage: kitti-ros2 play SRC, or set the'
                ' parameter source'
            )
        name = self.get_fully_qualified_name()
        return open_program(source, settings, reserved_by_node(name, settings))

    def _say_who_was_missing(self, session: Session) -> None:
        text = session.reception.describe()
        if text and session.playback.options.lossless:
            self.get_logger().warning(text)
        elif text:
            self.get_logger().info(text)

    def _prepare(self, program: Program, settings: PlaySettings) -> Session:
        """Make the session of a source, without its topics: they come when it is played.

        Raises:
            UsageError: The file of QoS overrides cannot be read.
        """
        path = settings.qos_overrides_path
        overrides = {} if path is None else load_overrides(path)
        return Session(
            program,
            settings,
            lambda program: self._connect(program, overrides),
            lambda text: self.get_logger().error(text),
            self._tell_state_sometimes,
            lambda text: self.get_logger().info(text),
        )

    def _play(self, session: Session) -> None:
        self.stop()
        self._session = session
        self.get_logger().info(describe(session.program))
        for note in session.program.notes():
            self.get_logger().warning(note)
        self.tell_state()
        session.start(lambda error: self._end(session, error))

    def _connect(self, program: Program, overrides: Mapping[str, QosOverride]) -> Outlets:
        return Outlets(self, program, overrides, self._tell_time)

    def _end(self, session: Session, error: BaseException | None) -> None:
        """Handle the end of a session."""
        if session is not self._session:
            return  # another source has replaced it
        self.tell_state()
        self.finish(error)

    def _tell_state_sometimes(self) -> None:
        if time.monotonic_ns() - self._state_ns > _STATE_EVERY_NS:
            self.tell_state()

    # Parameters.

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Reject invalid values; a source is opened here, so that a bad one is rejected as well."""
        changes = self._changes(parameters)
        if not changes:
            return SetParametersResult(successful=True)
        unused, self._prepared = self._prepared, None
        if unused is not None:  # of a change that was accepted here and not made
            unused.stop()
        try:
            settings = make_play_settings(given({**self._values, **changes}))
            if changes.get('position', '') != '':
                self._seek(str(changes['position']))
            if any(name in changes for name in _OF_SOURCE):
                source = str(changes.get('source', self._values['source']))
                self._prepared = self._prepare(self._open(source, settings), settings)
        except (KittiRos2Error, OSError) as error:
            return SetParametersResult(
                successful=False, reason=' '.join(describe_error(error).split())
            )
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        changes = self._changes(parameters)
        if not changes:
            return
        self._values.update(changes)
        prepared, self._prepared = self._prepared, None
        if prepared is not None:
            try:
                self._play(prepared)
            except Exception as error:  # noqa: BLE001 - one would end the executor's thread
                self._end(prepared, error)
        elif any(name in changes for name in _LIVE):
            options = make_play_settings(given(self._values)).playback
            self.playback.change(rate=options.rate, loop=options.loop, step=options.step)
        if changes.get('burst'):
            self.playback.burst(int(changes['burst']))
        if prepared is None:  # else _play has published it
            self.tell_state()

    def _changes(self, parameters: list[Parameter]) -> dict[str, Any]:
        """Return values by name, without the parameters of publishers (qos_overrides)."""
        return {each.name: each.value for each in parameters if each.name in self._values}

    def _seek(self, text: str) -> None:
        bound = Bound.parse(text)
        if bound.frame is not None:
            self.playback.seek_frame(bound.frame)
        elif bound.offset_ns is not None:
            self.playback.seek_offset(bound.offset_ns)
        elif bound.stamp_ns is not None:
            self.playback.seek(bound.stamp_ns)
