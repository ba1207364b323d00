# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Starts ROS with middleware settings for messages of megabytes."""

from __future__ import annotations

import errno
import os
import pwd
import re
import sys
import tempfile
import threading
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import rclpy
from rclpy.signals import SignalHandlerOptions

from ..model.errors import UsageError, one_line
from .ros_installation import fast_dds_version, middleware

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from typing_extensions import Self

    from .terminal import StopRequest


# Capture of what libraries of ROS write to stderr while they start: an error is one line.

TOO_MANY = 'too many open files; raise the limit (ulimit -n)'


def lacks_files(error: str) -> bool:
    """Return whether an error is that no more files can be opened."""
    return TOO_MANY in error or os.strerror(errno.EMFILE) in error


@contextmanager
def captured_stderr() -> Iterator[Callable[[], list[str]]]:
    """Capture what libraries write to stderr; write it at the end unless it was read."""
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        stderr_copy = os.dup(2)
        read = False

        def written() -> list[str]:
            nonlocal read
            read = True
            file.seek(0)
            return file.read().decode(errors='replace').splitlines()

        os.dup2(file.fileno(), 2)
        try:
            yield written
        finally:
            os.dup2(stderr_copy, 2)
            os.close(stderr_copy)
            if not read:
                sys.stderr.writelines(f'{line}\n' for line in written())


# The variable of the profiles by the version of Fast DDS; 3 warns of that of 2.
_PROFILE_VARIABLES = {2: 'FASTRTPS_DEFAULT_PROFILES_FILE', 3: 'FASTDDS_DEFAULT_PROFILES_FILE'}
# If one of these is set, the user has own settings.
_OWN_SETTINGS = (*_PROFILE_VARIABLES.values(), 'FASTDDS_BUILTIN_TRANSPORTS')
_OWN_PROFILE = 'DEFAULT_FASTRTPS_PROFILES.xml'

_FAST, _CYCLONE = 'rmw_fastrtps', 'rmw_cyclonedds'
_CYCLONE_VARIABLE = 'CYCLONEDDS_URI'

_CYCLONE_SETTINGS = (
    '<CycloneDDS><Domain><General>'
    '<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>60000B</FragmentSize>'
    '</General></Domain></CycloneDDS>'
)
"""A scan of 1.9 MB takes 32 datagrams instead of 1500, which fit the usual socket buffer better.

Only for one machine: a network splits each of them into IP fragments, all of which must arrive.
"""


def start_ros(ros_args: Sequence[str]) -> rclpy.Context:
    """Create a ROS context; the caller handles signals.

    Raises:
        UsageError: The middleware cannot be loaded, or the arguments are invalid.
    """
    _use_profile()
    _find_home()
    context = rclpy.Context()
    with captured_stderr() as written:
        try:
            rclpy.init(
                args=list(ros_args), context=context, signal_handler_options=SignalHandlerOptions.NO
            )
        except Exception as error:
            written()  # the error has what matters of it
            raise UsageError(f'ROS cannot start: {_reason(one_line(str(error)))}') from error
    return context


def _reason(error: str) -> str:
    if lacks_files(error):
        return TOO_MANY
    of_log = 'log directory' in error or 'logging directory' in error
    return error + '; set ROS_LOG_DIR to a folder that you may write to' * of_log


def _find_home() -> None:
    """Name the folder of ROS's log if HOME is not set: ROS would not start."""
    if any(os.environ.get(name) for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')):
        return
    with suppress(KeyError):  # the user has no account
        os.environ['ROS_HOME'] = f'{pwd.getpwuid(os.getuid()).pw_dir}/.ros'


def settings_variable() -> str:
    """Return the environment variable with the middleware's settings; empty if unknown."""
    variables = {_FAST: _PROFILE_VARIABLES[fast_dds_version()], _CYCLONE: _CYCLONE_VARIABLE}
    name = middleware()
    return next((variables[variable] for variable in variables if name.startswith(variable)), '')


def _use_profile() -> None:
    """Set the profile of Fast DDS if the user has none; prepend settings for Cyclone DDS."""
    own = any(os.environ.get(name) for name in _OWN_SETTINGS) or Path(_OWN_PROFILE).exists()
    if middleware().startswith(_FAST) and not own:
        version = fast_dds_version()
        profile = Path(__file__).with_name(f'fastdds{version}.xml')
        os.environ[_PROFILE_VARIABLES[version]] = str(profile)
    if middleware().startswith(_CYCLONE) and stays_on_this_machine(os.environ):
        os.environ[_CYCLONE_VARIABLE] = cyclone_settings(os.environ.get(_CYCLONE_VARIABLE, ''))


def stays_on_this_machine(environment: Mapping[str, str]) -> bool:
    """Return whether discovery is limited to this machine.

    By ROS_AUTOMATIC_DISCOVERY_RANGE without ROS_STATIC_PEERS, or the older ROS_LOCALHOST_ONLY.
    """
    if environment.get('ROS_LOCALHOST_ONLY') == '1':
        return True
    local = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'LOCALHOST'
    return local and not environment.get('ROS_STATIC_PEERS')


def cyclone_settings(user_settings: str) -> str:
    """Return CYCLONEDDS_URI with these settings first: in the list, later entries win."""
    return f'{_CYCLONE_SETTINGS},{user_settings}' if user_settings else _CYCLONE_SETTINGS


# Creates a node; if the middleware fails, its own message becomes the error.

T = TypeVar('T')

# Cyclone DDS: seconds, domain, thread. Fast DDS: time, category; and the function at the end.
_CYCLONE_LINE = re.compile(r'\d+\.\d+ \[\w*\]\s+[^:]*: ')
_FAST_LINE = re.compile(r'\d{4}-\d\d-\d\d [\d:.]+ \[\S+ \w+\] ')
_FAST_END = re.compile(r' -> Function \w+$')
_COLOUR = re.compile(r'\x1b\[[\d;]*m')


def create_node(create: Callable[[], T]) -> T:
    """Create a node; some middleware reads its settings then, and reports errors on stderr.

    Args:
        create: Creates the node.

    Raises:
        UsageError: The middleware fails; with its own message and the variable of its settings.
    """
    with captured_stderr() as written:
        try:
            return create()
        except RuntimeError as error:  # those of rclpy, and of the C++ below it
            raise UsageError(_refusal(written(), str(error))) from error
        except OSError as error:  # of a module that is imported late
            if error.errno != errno.EMFILE:
                raise
            raise UsageError(_refusal(written(), TOO_MANY)) from error


def _refusal(lines: Sequence[str], error: str) -> str:
    """Format one line: the middleware, its reason, and the variable of its settings."""
    if lacks_files(error):
        return f'{middleware()} cannot create the node: {TOO_MANY}'
    text = f'{middleware()} cannot create the node: {_last_message(lines) or one_line(error)}'
    variable = settings_variable()
    return f'{text}; check {variable}' if variable else text


def _last_message(lines: Sequence[str]) -> str:
    """Return the last message of the middleware, without time and thread; empty if none.

    Lines of rcl and rmw only report that it failed.
    """
    reason = ''
    for line in lines:
        plain = _FAST_END.sub('', _COLOUR.sub('', line))
        for beginning in (_CYCLONE_LINE, _FAST_LINE):
            if match := beginning.match(plain):
                reason = plain[match.end() :].strip()
    return reason


# Closes a node in bounded time, independent of its subscribers.
#
# A reliable writer of Cyclone DDS and its deletion block while a subscriber does not acknowledge:
# seconds for each topic.

EXIT_S = 1.8
"""Time for closing, of the 2 s for an exit; the interpreter needs the rest."""


class Closing:
    """A context manager that calls its callbacks at exit, last one first, in bounded time.

    Args:
        stop_request: Its abandon is called if closing takes too long.

    Attributes:
        seconds: Time limit of the callbacks.
    """

    def __init__(self, stop_request: StopRequest) -> None:
        self.seconds = EXIT_S
        self._stop_request = stop_request
        self._exit_stack = ExitStack()
        self._error: BaseException | None = None

    def callback(self, callback: Callable[..., object], *args: object) -> None:
        """Add a callback."""
        self._exit_stack.callback(callback, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, reason: type[BaseException] | None, *_: object) -> None:
        thread = threading.Thread(target=self._close, name='closing', daemon=True)
        thread.start()
        thread.join(self.seconds)
        if thread.is_alive():
            self._stop_request.abandon()
        if self._error is not None and reason is None:  # else it would hide the reason: Ctrl-C
            raise self._error

    def _close(self) -> None:
        try:
            self._exit_stack.close()
        except BaseException as error:  # noqa: BLE001 - the main thread raises it
            self._error = error
