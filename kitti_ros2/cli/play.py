# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 play."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..node.installed import check_installed
from ..settings import PLAY_OPTIONS, make_play_settings
from .ending import end_by_signal
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_freed_memory, keep_imports

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

_ROS_ARGS = '--ros-args'


def split_ros_args(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Our words, and what ROS is to read: from each --ros-args to the next -- or the end."""
    ours: list[str] = []
    theirs: list[str] = []
    reading = False
    for word in words:
        if word == _ROS_ARGS:
            reading = True
        (theirs if reading else ours).append(word)
        if word == '--':
            reading = False
    return ours, theirs


def run_play(
    src: Path | None,
    given: Mapping[str, object],
    config: Path | None,
    ros_args: Sequence[str],
    *,
    keyboard: bool,
) -> int:
    """Play a recording or a bag as a ROS 2 node.

    Args:
        src: KITTI folder or bag; None where the parameter `source` says it.
        given: Parameters by name, None where the command line does not give them.
        config: YAML file with options, under the command line's.
        ros_args: For ROS.
        keyboard: Whether the keys of a terminal control it.

    Returns:
        The exit code: also 0 after Ctrl-C.
    """
    ending = end_by_signal()
    chosen = {name: value for name, value in given.items() if value is not None}
    if config:
        from .config_file import load_config

        chosen = load_config(config, PLAY_OPTIONS) | chosen
    make_play_settings(chosen)
    if src is not None:
        chosen['source'] = str(src)
    check_installed()
    from ..node.run import run_player

    keep_imports()
    keep_freed_memory()
    failures = run_player(chosen, ros_args, ending, keyboard=keyboard)
    return EXIT_LOSSES if failures else EXIT_OK
