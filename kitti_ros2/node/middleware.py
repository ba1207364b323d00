# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Starts ROS with middleware settings for messages of megabytes."""

from __future__ import annotations

import os
import pwd
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import rclpy
from rclpy.signals import SignalHandlerOptions

from ..model.errors import UsageError
from ..model.text import one_line
from .held_stderr import TOO_MANY, held_stderr, lacks_files
from .installed import middleware

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_PROFILE = Path(__file__).with_name('fastdds.xml')
_PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
# If one of these is set, the user has own settings.
_OWN_SETTINGS = (_PROFILE_VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
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
    with held_stderr() as written:
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
    variables = {_FAST: _PROFILE_VARIABLE, _CYCLONE: _CYCLONE_VARIABLE}
    name = middleware()
    return next((variables[each] for each in variables if name.startswith(each)), '')


def _use_profile() -> None:
    """Set the profile of Fast DDS if the user has none; prepend settings for Cyclone DDS."""
    own = any(os.environ.get(name) for name in _OWN_SETTINGS) or Path(_OWN_PROFILE).exists()
    if middleware().startswith(_FAST) and not own:
        os.environ[_PROFILE_VARIABLE] = str(_PROFILE)
    if middleware().startswith(_CYCLONE) and stays_on_this_machine(os.environ):
        os.environ[_CYCLONE_VARIABLE] = cyclone_settings(os.environ.get(_CYCLONE_VARIABLE, ''))


def stays_on_this_machine(environment: Mapping[str, str]) -> bool:
    """Whether discovery is limited to this machine.

    By ROS_AUTOMATIC_DISCOVERY_RANGE without ROS_STATIC_PEERS, or the older ROS_LOCALHOST_ONLY.
    """
    if environment.get('ROS_LOCALHOST_ONLY') == '1':
        return True
    local = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'LOCALHOST'
    return local and not environment.get('ROS_STATIC_PEERS')


def cyclone_settings(given: str) -> str:
    """Return CYCLONEDDS_URI with these settings first: in the list, later entries win."""
    return f'{_CYCLONE_SETTINGS},{given}' if given else _CYCLONE_SETTINGS
