# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a player is given, opened: a KITTI folder or a bag."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..bags.locate import is_bag
from ..files.workers import worker_count
from ..kitti.layouts import open_recording
from ..messages.diagnostics import DIAGNOSTICS
from ..model.errors import UsageError
from ..model.streams import Stream
from ..options.playback import Stamps
from ..options.table import PlaySettings
from .bag_images import BagImages
from .bag_program import BagProgram
from .program import RecordingProgram

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..options.table import Settings
    from .program import Program

CLOCK = '/clock'
STATE = '/kitti_player/state'

_MOST_WORKERS = 4


def open_program(
    source: str | Path,
    settings: PlaySettings | Settings,
    reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
) -> Program:
    """Open what is to be played.

    Args:
        source: Path of a KITTI folder or a bag; ~ is the home directory.
        settings: How it is read; a layout that is given makes it a KITTI folder.
        reserved: As BagProgram has it.

    Raises:
        KittiRos2Error: There is nothing, or it cannot be read, or the selection takes nothing.
        OSError: The same.
    """
    path = Path(source).expanduser()
    if is_bag(path, settings.read.layout):
        images = BagImages(path, settings.messages) if isinstance(settings, PlaySettings) else None
        return BagProgram(path, settings.selection, reserved, images)
    workers = worker_count(_MOST_WORKERS)
    recording = open_recording(path, settings.read)
    if settings.messages.annotated and Stream.LABELS not in recording.streams:
        raise UsageError(f'{path}: no annotated images can be made: the recording has no labels')
    return RecordingProgram(recording, settings.messages, settings.selection, workers)


def publishes_clock(settings: PlaySettings) -> bool:
    """Whether a node with these settings publishes the recording's time on /clock."""
    return settings.playback.clock_hz > 0 and settings.stamps is Stamps.ORIGINAL


def reserved_by_viewers(topic: str, msgtype: str) -> str:
    """Why a bag's topic is left out where viewers are served: the state is the player's own."""
    recorded = topic.endswith(STATE) and msgtype == DIAGNOSTICS
    return 'the player publishes its own' if recorded or topic == STATE else ''


def reserved_by_node(name: str, settings: PlaySettings) -> Callable[[str, str], str]:
    """Why a bag's topic is left out by a node: two clocks or two states contradict each other.

    Args:
        name: The node's, with its namespace.
        settings: Of the node.
    """

    def reserved(topic: str, msgtype: str) -> str:
        if topic == CLOCK and publishes_clock(settings):
            return 'the player publishes its own; --clock 0 plays those of the bag'
        if topic == CLOCK and settings.stamps is Stamps.NOW:
            return 'they tell the time of the recording, and stamps are those of the moment'
        if topic == f'{name}/state':
            return 'the player publishes its own'
        return reserved_by_viewers(topic, msgtype)

    return reserved


def describe(program: Program) -> str:
    """What is played, in a line."""
    frames, stamps = program.frames, program.stamps_ns
    return (
        f'{program.name}: frames {frames[0]} to {frames[-1]},'
        f' {(stamps[-1] - stamps[0]) / 1e9:.1f} s, {len(program.outlets)} topics'
    )
