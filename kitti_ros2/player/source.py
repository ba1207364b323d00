# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens the source of a player: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..bags.open_source import open_source
from ..bags.reader import OpenBag
from ..files.remote import as_path
from ..files.workers import worker_count
from ..kitti.extract_oxts import add_extract
from ..kitti.predictions import add_predictions
from ..model.errors import UsageError
from ..model.msgtypes import ANNOTATIONS, DIAGNOSTICS
from ..model.streams import Stream
from ..options.playback import Stamps
from ..options.settings import PlaySettings
from .bag_images import BagImages
from .bag_program import BagProgram
from .program import RecordingProgram

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from ..options.settings import Settings
    from .program import Program

CLOCK = '/clock'
STATE = '/kitti_player/state'

_MOST_WORKERS = 4


def open_program(
    source: str | Path,
    settings: PlaySettings | Settings,
    reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
) -> Program:
    """Open a source.

    Args:
        source: Path of a KITTI folder or a bag; ~ is the home directory.
        settings: Read settings; an explicit layout means a KITTI folder.
        reserved: See BagProgram.

    Raises:
        KittiRos2Error: The source is missing or unreadable, or the selection matches nothing.
        OSError: The same.
    """
    path = as_path(source).expanduser()
    opened = open_source(path, settings.read)
    if isinstance(opened, OpenBag):
        with opened as bag:  # the program keeps its files open until it is closed
            if settings.predictions.path is not None:
                raise UsageError(
                    f'{path}: predictions are for KITTI folders, and this is a bag; to-bag takes'
                    f' them when it makes the bag'
                )
            made = any(msgtype == ANNOTATIONS for _, msgtype in bag.index.stamps)
            if settings.messages.annotations and not made:
                raise UsageError(
                    f'{path}: annotations are made of KITTI folders, and this is a bag; to-bag'
                    f' --annotations makes a bag with them'
                )
            if settings.imu.path is not None:
                raise UsageError(
                    f'{path}: --imu-from is for raw drives, and this is a bag; to-bag takes it when'
                    f' it makes the bag'
                )
            if settings.messages.stack is not None:
                raise UsageError(
                    f'{path}: a bag is played as it is, and --for is for KITTI folders; to-bag'
                    f' --for makes a bag for a stack'
                )
            playing = isinstance(settings, PlaySettings)
            images = BagImages(bag, settings.messages) if playing else None
            return BagProgram(bag, settings.selection, reserved, images)
    if settings.messages.annotated and Stream.LABELS not in opened.streams:
        raise UsageError(f'{path}: no annotated images can be made: the recording has no labels')
    add_predictions(opened, settings.predictions.path)
    add_extract(opened, settings.imu)
    workers = worker_count(_MOST_WORKERS)
    return RecordingProgram(opened, settings.messages, settings.selection, workers)


def publishes_clock(settings: PlaySettings) -> bool:
    """Whether a node with these settings publishes the recording's time on /clock."""
    return settings.playback.clock_hz > 0 and settings.stamps is Stamps.ORIGINAL


def reserved_by_viewers(topic: str, msgtype: str) -> str:
    """Return why a bag's topic is skipped when serving viewers: the player publishes its state."""
    recorded = topic.endswith(STATE) and msgtype == DIAGNOSTICS
    return 'the player publishes its own' if recorded or topic == STATE else ''


def reserved_by_node(name: str, settings: PlaySettings) -> Callable[[str, str], str]:
    """Return a function that gives the reason why a node skips a bag's topic.

    Two clocks or two states would contradict each other.

    Args:
        name: The node's name with its namespace.
        settings: The node's settings.
    """

    def reserved(topic: str, msgtype: str) -> str:
        if topic == CLOCK and publishes_clock(settings):
            return 'the player publishes its own; --clock 0 plays those of the bag'
        if topic == CLOCK and settings.stamps is Stamps.NOW:
            return "they contain the recording's time, but the stamps are the current time"
        if topic == f'{name}/state':
            return 'the player publishes its own'
        return reserved_by_viewers(topic, msgtype)

    return reserved


def describe(program: Program) -> str:
    """Describe a program in one line."""
    frames, stamps = program.frames, program.stamps_ns
    return (
        f'{program.name}: frames {frames.min()} to {frames.max()},'
        f' {(stamps[-1] - stamps[0]) / 1e9:.1f} s, {len(program.channels)} topics'
    )
