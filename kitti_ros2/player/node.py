# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The node kitti_player: parameters and services around the session that plays."""

from __future__ import annotations

import re
import threading
import time
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from ..model.errors import KittiRos2Error, UsageError, describe_error, one_line
from ..model.streams import from_sec_nanosec
from ..options.declare import option, options_of, parse_integer, parse_text
from ..options.read import Bound
from ..options.table import PLAY, make_play_settings
from .bag_program import CLOCK, describe, open_program, publishes_clock, reserved_by_node
from .outlets import Outlets, load_overrides
from .session import Session, encode_state, where

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from types import ModuleType

    from ..options.declare import Option
    from ..options.table import PlaySettings
    from .outlets import QosOverride
    from .playback import Playback
    from .program import Program
    from .terminal import Controlled


# The player's services: those of rosbag2 if rosbag2_interfaces is installed, else std_srvs.
#
# Intended differences from rosbag2 (rosbag2_transport/player.cpp, 0.26):
#
# - play_next plays whole frames (parameter step; 0 is one sample), rosbag2 one message. Both answer
#   false while not paused, and at the end.
# - burst plays whole samples, so possibly a few messages more than requested, rosbag2 exact
#   numbers. For both 0 means all that remain, and both play nothing while not paused.
# - seek past the last stamp fails: success is false, and the position stays. rosbag2 always answers
#   true; nothing remains then, so that its playback ends or loops. Before the first stamp both go
#   to the beginning.

Act: TypeAlias = 'Callable[[Any, Any], object]'
"""A handler of a request, which fills in the response."""

_PACKAGE = 'rosbag2_interfaces'


def create_services(node: Node, player: Controlled) -> None:
    """Create ~/pause and the other services, with the installed types."""
    types = _rosbag2_types()
    services = rosbag2_services(player, types) if types else plain_services(player)
    for name, (kind, act) in services.items():
        node.create_service(kind, f'~/{name}', _handler(player, act))


def _rosbag2_types() -> ModuleType | None:
    try:
        return import_module(f'{_PACKAGE}.srv')
    except ImportError:
        return None


def _handler(player: Controlled, act: Act) -> Callable[[Any, Any], Any]:
    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        act(request, response)
        player.publish_state()
        return response

    return handle


def plain_services(player: Controlled) -> dict[str, tuple[Any, Act]]:
    """Return type and handler by name: Triggers, which describe their result in words."""

    def control(name: str) -> Act:
        def act(_: Any, response: Any) -> None:  # noqa: ANN401
            getattr(player.playback, name)()
            response.success, response.message = True, where(player.playback)

        return act

    def play_next(_: Any, response: Any) -> None:  # noqa: ANN401
        response.success, response.message = _play_next(player.playback)

    def stop(_: Any, response: Any) -> None:  # noqa: ANN401
        player.playback.stop()
        response.success, response.message = True, 'stopped'

    acts = {name: control(name) for name in ('pause', 'resume', 'toggle_paused')}
    acts |= {'play_next': play_next, 'stop': stop}
    return {name: (Trigger, act) for name, act in acts.items()}


def _play_next(playback: Playback) -> tuple[bool, str]:
    if playback.play_next():
        return True, where(playback)
    state = playback.state()
    if not state.paused:
        return False, 'time runs; pause first'
    return False, 'there is nothing left to play' if state.finished else 'it took too long'


def rosbag2_services(player: Controlled, types: ModuleType) -> dict[str, tuple[Any, Act]]:
    """Return type and handler by name, as in rosbag2; see the module's docstring."""

    def is_paused(_: Any, response: Any) -> None:  # noqa: ANN401
        response.paused = player.playback.state().paused

    def get_rate(_: Any, response: Any) -> None:  # noqa: ANN401
        response.rate = player.playback.state().rate

    def set_rate(request: Any, response: Any) -> None:  # noqa: ANN401
        response.success = _succeeds(lambda: player.set_rate(request.rate))

    def play_next(_: Any, response: Any) -> None:  # noqa: ANN401
        response.success = player.playback.play_next()

    def burst(request: Any, response: Any) -> None:  # noqa: ANN401
        response.actually_burst = player.playback.burst(request.num_messages)

    def seek(request: Any, response: Any) -> None:  # noqa: ANN401
        stamp_ns = from_sec_nanosec(request.time.sec, request.time.nanosec)
        response.success = _succeeds(lambda: player.playback.seek(stamp_ns))

    acts: dict[str, Act] = {
        'Pause': lambda *_: player.playback.pause(),
        'Resume': lambda *_: player.playback.resume(),
        'TogglePaused': lambda *_: player.playback.toggle_paused(),
        'IsPaused': is_paused,
        'GetRate': get_rate,
        'SetRate': set_rate,
        'PlayNext': play_next,
        'Burst': burst,
        'Seek': seek,
        'Stop': lambda *_: player.playback.stop(),
    }
    return {_snake(name): (getattr(types, name), act) for name, act in acts.items()}


def _snake(name: str) -> str:
    """Convert TogglePaused to toggle_paused."""
    return ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')


def _succeeds(act: Callable[[], None]) -> bool:
    try:
        act()
    except UsageError:
        return False
    return True


# Callbacks of a node whose errors do not end the thread that runs them.
#
# Any node of the domain may call its services, with any request. rclpy raises the error of a
# callback in the thread of the executor: a parameter of an unknown type is such an error.

Handler: TypeAlias = 'Callable[[Any, Any], Any]'
"""A callback of a service: request and response in, response out."""


def contained(kind: Any, handler: Handler, report: Callable[[str], object]) -> Handler:  # noqa: ANN401
    """Return a callback of a service that answers where the given one raises an error.

    The answer is a refusal of the parameters; of other services the response without content.

    Args:
        kind: The type of the service.
        handler: Its callback.
        report: Called with an error that the answer does not contain.
    """
    if kind is SetParameters:
        return _each_parameter(handler)

    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        try:
            return handler(request, response)
        except Exception as error:  # noqa: BLE001 - see the docstring of the module
            refused = kind.Response()
            if kind is SetParametersAtomically:
                refused.result = _refusal(error)
            else:
                report(f'a request was not understood: {describe_unexpected(error)}')
            return refused

    return handle


def _each_parameter(handler: Handler) -> Handler:
    """Return a callback that sets each parameter alone, as set_parameters promises."""

    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        results = []
        for parameter in request.parameters:
            alone = SetParameters.Request(parameters=[parameter])
            try:
                results += handler(alone, SetParameters.Response()).results
            except Exception as error:  # noqa: BLE001 - see the docstring of the module
                results.append(_refusal(error))
        response.results = results
        return response

    return handle


def _refusal(error: Exception) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=describe_unexpected(error))


def describe_unexpected(error: Exception) -> str:
    """Return the type and the text of an error, in one line."""
    return one_line(f'{type(error).__name__}: {error}')


class Executor(SingleThreadedExecutor):  # type: ignore[misc] # rclpy has no types
    """An executor that separates errors of callbacks from those of waiting for the next one."""

    _waiting = False

    def wait_for_ready_callbacks(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 - of rclpy
        """Wait as rclpy does."""
        self._waiting = True
        callbacks = super().wait_for_ready_callbacks(*args, **options)
        self._waiting = False
        return callbacks

    def run(self, stop: threading.Event, report: Callable[[Exception], object]) -> None:
        """Run callbacks until stopped, or ROS shuts down.

        Args:
            stop: Set to stop it.
            report: Called with the error of a callback; the others go on.

        Raises:
            Exception: There is no waiting for callbacks any more.
        """
        while not stop.is_set():
            try:
                self.spin_once()
            except ExternalShutdownException:
                return
            except Exception as error:
                if not self.context.ok():
                    return
                if self._waiting:
                    raise
                report(error)


# ROS parameters of the player, from the declared options.

Value: TypeAlias = 'str | float | bool | list[str]'


@dataclass(frozen=True)
class _Commands:
    """Parameters that are no setting of a playback."""

    source: str = option(
        '', 'KITTI folder or bag; may be replaced by another at any time', parse_text, live=True
    )
    position: str = option(
        '',
        "set it to seek: a frame (12), seconds ('3.5s') or a time stamp",
        parse_text,
        live=True,
        any_type=True,
    )
    burst: int = option(
        0,
        'set it, while paused, to play so many messages at once',
        parse_integer,
        live=True,
        bounds=(0, 2**31),
    )


def _parameter(declared: Option) -> Option:
    """Return an option as a parameter, with a default of ROS's types."""
    default, meaning = declared.plain(declared.default), declared.meaning
    if declared.choices:
        meaning += f': {" or ".join(declared.choices)}'
    if declared.unset:
        default = [''] if isinstance(default, tuple) else ''
        meaning += f'; empty: {declared.unset}'
    return replace(declared, default=default, meaning=meaning)


PARAMETERS = (*options_of(_Commands), *map(_parameter, PLAY))
"""All parameters; the defaults '' and [''] stand for "not given"."""
COMMANDS = frozenset(command.name for command in options_of(_Commands))


def descriptor(parameter: Option) -> ParameterDescriptor:
    """Return the description that ROS shows."""
    described = ParameterDescriptor(
        name=parameter.name,
        description=parameter.meaning,
        read_only=not parameter.live,
        # ROS refuses rate:=2 where 2.0 is declared; the settings check what was given.
        dynamic_typing=parameter.any_type or isinstance(parameter.default, float),
    )
    if parameter.bounds and isinstance(parameter.default, float):
        low, high = parameter.bounds
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif parameter.bounds:
        low, high = map(int, parameter.bounds)
        described.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return described


def declare(node: Node) -> dict[str, Value]:
    """Declare all parameters and return their values by name.

    Raises:
        UsageError: A value that was given has another type, or is out of range.
    """
    values = {}
    for parameter in PARAMETERS:
        try:
            declared = node.declare_parameter(
                parameter.name, parameter.default, descriptor(parameter)
            )
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise UsageError(f'parameter {parameter.name}: {error}') from None
        values[parameter.name] = declared.value
    return values


def given(values: dict[str, Value]) -> dict[str, object]:
    """Return the settings among parameter values, by name; defaults are not given.

    So a stack may choose them.
    """
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    return {
        name: value
        for name, value in values.items()
        if name not in COMMANDS
        and (value not in ('', [''], [], defaults[name]) or _is_other_kind(value, defaults[name]))
    }


def _is_other_kind(value: Value, default: object) -> bool:
    """Return whether true stands for a number: it equals 1, and loop:=true is not loop:=1."""
    return isinstance(value, bool) and not isinstance(default, bool)


def to_parameters(values: Mapping[str, Any]) -> list[Parameter]:
    """Return ROS parameters of the declared types from values by name."""
    parameters = {parameter.name: parameter for parameter in PARAMETERS}
    return [
        Parameter(name, value=_converted(value, parameters[name])) for name, value in values.items()
    ]


_NUMBER = re.compile(r'([-+]?)(0*)(\.?\d[\w.+-]*)')


def read_decimally(ros_args: Sequence[str]) -> list[str]:
    """Return arguments of ROS in which our parameters mean what the command line means by them.

    ROS takes start:=0010 for an octal number, 8, and epoch:=2011 for an integer, which is no text.

    Args:
        ros_args: Arguments from --ros-args on.
    """
    parameters = {parameter.name: parameter for parameter in PARAMETERS}
    before = ['', *ros_args]
    return [
        _decimal(word, parameters) if last in {'-p', '--param'} else word
        for last, word in zip(before, ros_args, strict=False)
    ]


def _decimal(word: str, parameters: Mapping[str, Option]) -> str:
    target, _, value = word.partition(':=')
    parameter = parameters.get(target.rpartition(':')[2])  # after the name of a node, if any
    number = _NUMBER.fullmatch(value)
    if parameter is None or number is None:
        return word
    sign, zeros, digits = number.groups()
    if isinstance(parameter.default, str):
        return f'{target}:="{value}"' if zeros or not parameter.any_type else word
    return f'{target}:={sign}{digits}'


def _converted(value: Any, parameter: Option) -> Any:  # noqa: ANN401 - any value of YAML
    """Return a value from a command line or YAML in the declared type."""
    kind = type(parameter.default)
    if parameter.any_type or isinstance(value, kind):
        return value
    if kind in {int, float, list}:
        return kind(parameter.plain(parameter.parse(parameter.name, value)))
    return ','.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


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
        self._publish_time: Callable[[bytes], None] = lambda _: None
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
            self._publish_time = self.create_publisher(Clock, CLOCK, 10).publish
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

    def report_error(self, error: Exception) -> None:
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

    def publish_state(self) -> None:
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
            self._publish_state_sometimes,
            lambda text: self.get_logger().info(text),
        )

    def _play(self, session: Session) -> None:
        self.stop()
        self._session = session
        self.get_logger().info(describe(session.program))
        for note in session.program.notes():
            self.get_logger().warning(note)
        self.publish_state()
        session.start(lambda error: self._end(session, error))

    def _connect(self, program: Program, overrides: Mapping[str, QosOverride]) -> Outlets:
        return Outlets(self, program, overrides, self._publish_time)

    def _end(self, session: Session, error: BaseException | None) -> None:
        """Handle the end of a session."""
        if session is not self._session:
            return  # another source has replaced it
        self.publish_state()
        self.finish(error)

    def _publish_state_sometimes(self) -> None:
        if time.monotonic_ns() - self._state_ns > _STATE_EVERY_NS:
            self.publish_state()

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
            self.publish_state()

    def _changes(self, parameters: list[Parameter]) -> dict[str, Any]:
        """Return values by name, without the parameters of publishers (qos_overrides)."""
        return {
            parameter.name: parameter.value
            for parameter in parameters
            if parameter.name in self._values
        }

    def _seek(self, text: str) -> None:
        bound = Bound.parse(text)
        if bound.frame is not None:
            self.playback.seek_frame(bound.frame)
        elif bound.offset_ns is not None:
            self.playback.seek_offset(bound.offset_ns)
        elif bound.stamp_ns is not None:
            self.playback.seek(bound.stamp_ns)
