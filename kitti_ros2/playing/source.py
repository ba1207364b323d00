# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a player is given, opened: a KITTI folder or a bag."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..bag_program import BagProgram
from ..bags.locate import is_bag
from ..kitti.layouts import open_recording
from ..program import RecordingProgram

if TYPE_CHECKING:
    from ..program import Program
    from ..settings import PlaySettings, Settings

_MOST_WORKERS = 4


def open_program(source: str | Path, settings: PlaySettings | Settings) -> Program:
    """Open what is to be played.

    Args:
        source: Path of a KITTI folder or a bag; ~ is the home directory.
        settings: How it is read; a layout that is given makes it a KITTI folder.

    Raises:
        KittiRos2Error: There is nothing, or it cannot be read, or the selection takes nothing.
        OSError: The same.
    """
    path = Path(source).expanduser()
    if is_bag(path, settings.read.layout):
        return BagProgram(path, settings.selection)
    workers = min(_MOST_WORKERS, len(os.sched_getaffinity(0)))
    recording = open_recording(path, settings.read)
    return RecordingProgram(recording, settings.messages, settings.selection, workers)


def describe(program: Program) -> str:
    """What is played, in a line."""
    frames, stamps = program.frames, program.stamps_ns
    return (
        f'{program.name}: frames {frames[0]} to {frames[-1]},'
        f' {(stamps[-1] - stamps[0]) / 1e9:.1f} s, {len(program.outlets)} topics'
    )
