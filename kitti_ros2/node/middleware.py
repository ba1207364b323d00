# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Starts ROS, with the middleware's settings for megabytes at a time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import rclpy
from rclpy.signals import SignalHandlerOptions

from ..errors import UsageError
from .installed import middleware

if TYPE_CHECKING:
    from collections.abc import Sequence

_PROFILE = Path(__file__).with_name('fastdds.xml')
_PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
# Whoever sets one of these has settings of his own.
_OWN_SETTINGS = (_PROFILE_VARIABLE, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
_OWN_PROFILE = 'DEFAULT_FASTRTPS_PROFILES.xml'


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
        raise UsageError(f'ROS cannot start: {" ".join(str(error).split())}') from error
    return context


def _use_profile() -> None:
    """Give Fast DDS our profile, where it is the middleware and has no other."""
    own = any(os.environ.get(name) for name in _OWN_SETTINGS) or Path(_OWN_PROFILE).exists()
    if middleware().startswith('rmw_fastrtps') and not own:
        os.environ[_PROFILE_VARIABLE] = str(_PROFILE)
