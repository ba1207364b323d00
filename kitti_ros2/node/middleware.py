# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Starts ROS, with the middleware's settings for megabytes at a time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import rclpy
from rclpy.signals import SignalHandlerOptions

from ..model.errors import UsageError
from ..model.text import one_line
from .installed import middleware

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_PROFILE = Path(__file__).with_name('fastdds.xml')
_PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
# Whoever sets one of these has settings of his own.
_OWN_SETTINGS = (_PROFILE_VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
_OWN_PROFILE = 'DEFAULT_FASTRTPS_PROFILES.xml'

_FAST, _CYCLONE = 'rmw_fastrtps', 'rmw_cyclonedds'
_CYCLONE_VARIABLE = 'CYCLONEDDS_URI'

_CYCLONE_SETTINGS = (
    '<CycloneDDS><Domain><General>'
    '<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>60000B</FragmentSize>'
    '</General></Domain></CycloneDDS>'
)
"""A scan of 1.9 MB in 32 datagrams instead of 1500, which fit the usual socket buffer better.

Only where no network is between: there each of them would be cut into IP fragments, all of which
must arrive.
"""


def start_ros(ros_args: Sequence[str]) -> rclpy.Context:
    """A context of its own; signals are the caller's.

    Raises:
        UsageError: The middleware cannot be loaded, or the arguments cannot be meant.
    """
    _use_profile()
    context = rclpy.Context()
    try:
        rclpy.init(
            args=list(ros_args), context=context, signal_handler_options=SignalHandlerOptions.NO
        )
    except Exception as error:
        raise UsageError(f'ROS cannot start: {one_line(str(error))}') from error
    return context


def settings_variable() -> str:
    """The environment variable with the middleware's settings; empty where none is known."""
    variables = {_FAST: _PROFILE_VARIABLE, _CYCLONE: _CYCLONE_VARIABLE}
    name = middleware()
    return next((variables[each] for each in variables if name.startswith(each)), '')


def _use_profile() -> None:
    """Give Fast DDS our settings where it has no others, Cyclone DDS ours before the others."""
    own = any(os.environ.get(name) for name in _OWN_SETTINGS) or Path(_OWN_PROFILE).exists()
    if middleware().startswith(_FAST) and not own:
        os.environ[_PROFILE_VARIABLE] = str(_PROFILE)
    if middleware().startswith(_CYCLONE) and stays_on_this_machine(os.environ):
        os.environ[_CYCLONE_VARIABLE] = cyclone_settings(os.environ.get(_CYCLONE_VARIABLE, ''))


def stays_on_this_machine(environment: Mapping[str, str]) -> bool:
    """Whether nodes of other machines are not discovered.

    By ROS_AUTOMATIC_DISCOVERY_RANGE without ROS_STATIC_PEERS, or the older ROS_LOCALHOST_ONLY.
    """
    if environment.get('ROS_LOCALHOST_ONLY') == '1':
        return True
    local = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'LOCALHOST'
    return local and not environment.get('ROS_STATIC_PEERS')


def cyclone_settings(given: str) -> str:
    """CYCLONEDDS_URI with our settings first: it is a list, and later entries win."""
    return f'{_CYCLONE_SETTINGS},{given}' if given else _CYCLONE_SETTINGS
