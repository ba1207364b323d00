# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The commands of a run: play, record, score."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..stacks.stack import Stack

_ALWAYS_RECORDED = ('/tf', '/tf_static')
_OF_TRUTH = {'layout', 'sequence'}
"""Options of a recording that choose its poses."""


@dataclass(frozen=True)
class RunCommands:
    """The commands of a run, in the order of their use; '' where there is nothing to do.

    Attributes:
        record: In a terminal of its own, before the run.
        run: Starts the stack, and plays the drive.
        score: After the run.
    """

    record: str
    run: str
    score: str


def play_words(stack: Stack, drive: str, source: Mapping[str, object]) -> list[str]:
    """Return the words of the command that plays a drive for a stack.

    Args:
        stack: Its name.
        drive: The path of the drive.
        source: Options of the recording, such as sequence and imu_from.
    """
    return ['kitti-ros2', 'play', drive, *_words(source), '--for', stack.name]


def commands_of(
    stack: Stack, drive: str, source: Mapping[str, object], folder: str = ''
) -> RunCommands:
    """Return the commands of a run.

    Args:
        stack: The stack.
        drive: The path of the drive.
        source: Options of the recording, such as sequence and imu_from.
        folder: The folder of its parameter and launch files; '' for none.
    """
    play = shlex.join(play_words(stack, drive, source))
    run = f'ros2 launch {shlex.quote(f"{folder}/{stack.name}.launch.py")}' if folder else play
    return RunCommands(_record(stack), run, _score(stack, drive, source))


def _record(stack: Stack) -> str:
    if not stack.result.topics and not stack.result.tf:
        return ''
    topics = [*stack.result.topics, *_ALWAYS_RECORDED]
    return shlex.join(['ros2', 'bag', 'record', '-o', _bag(stack), '--use-sim-time', *topics])


def _score(stack: Stack, drive: str, source: Mapping[str, object]) -> str:
    """Return the command that scores the trajectory; it names what the messages do not."""
    result = stack.result
    if not (result.odometry or result.file or result.tf):
        return ''
    truth = {name: value for name, value in source.items() if name in _OF_TRUTH}
    words = ['kitti-ros2', 'eval', 'odometry', drive, result.file or _bag(stack), *_words(truth)]
    words += ['--topic', result.odometry] if result.odometry else []
    words += ['--frame', result.frame] if result.frame else []
    words += ['--tf', *result.tf] if result.tf else []
    return shlex.join(words)


def _words(options: Mapping[str, object]) -> list[str]:
    pairs = ((f'--{name.replace("_", "-")}', str(value)) for name, value in options.items())
    return [word for pair in pairs for word in pair]


def _bag(stack: Stack) -> str:
    return f'{stack.name}_run'
