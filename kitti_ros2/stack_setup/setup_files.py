# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the parameter files and the launch file of a stack for a drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..bags.open_folder import open_folder
from ..files.remote import as_path
from ..files.replacing import keep_all, keep_all_but_files
from ..files.staging import Staging, staged_file
from ..kitti.extract_oxts import add_extract
from ..model.errors import MissingDataError
from ..model.streams import Stream
from ..stacks.stack_names import IMU
from .commands import commands_of, play_words
from .drive_facts import facts_of
from .launch_text import WRITTEN, launch_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.recording import ReadableRecording
    from ..options.settings import Settings
    from ..stacks.rig_facts import RigFacts
    from ..stacks.stack import Stack
    from .commands import RunCommands

_OWN_FILES = keep_all_but_files('parameter file', [WRITTEN.encode(), b'%YAML:1.0', b'{'])


@dataclass(frozen=True)
class Setup:
    """What was written.

    Attributes:
        files: The parameter files, and the launch file last.
        commands: The commands of a run.
        notes: Facts that are not in the files of the drive.
    """

    files: tuple[Path, ...]
    commands: RunCommands
    notes: tuple[str, ...]


def write_setup(
    stack: Stack,
    drive: Path,
    folder: Path,
    settings: Settings,
    source: Mapping[str, object],
    *,
    overwrite: bool,
) -> Setup:
    """Write the files of a stack for a drive into a folder.

    Args:
        stack: The stack.
        drive: The KITTI folder.
        folder: The folder; created if it does not exist.
        settings: How to read the drive, and its 100 Hz packets.
        source: The options of these that are given, for the player.
        overwrite: Whether files of the same names, as written here, may be replaced.

    Raises:
        KittiRos2Error, OSError: The drive cannot be read, or a file exists; none is written.
    """
    recording = open_folder(drive, settings.read)
    add_extract(recording, settings.imu)
    facts, notes = facts_of(recording)
    notes += tuple(_imu_notes(stack, recording, facts.imu_hz))
    play = play_words(stack, str(drive.resolve()), _absolute(source))
    texts = _parameter_texts(stack, facts, drive)
    texts[f'{stack.name}.launch.py'] = launch_text(stack, play, [*texts])
    refusal = _OWN_FILES if overwrite else keep_all
    for name in texts:
        Staging(folder / name, refusal).discard()  # refuses before the first is written
    for name, text in texts.items():
        with staged_file(folder / name, refusal) as path:
            path.write_text(text, 'utf-8')
    commands = commands_of(stack, str(drive), source, str(folder))
    return Setup(tuple(folder / name for name in texts), commands, notes)


def _imu_notes(stack: Stack, recording: ReadableRecording, rate_hz: float) -> list[str]:
    topic = stack.topics.get(IMU, IMU)
    if {Stream.OXTS, Stream.OXTS_EXTRACT} & recording.streams.keys():
        return stack.notes_of_imu(topic, rate_hz)
    missing = f'{stack.name} reads {topic}: {recording.name} has no packets of the GPS/IMU unit'
    return [missing] if stack.imu_hz else []


def _absolute(source: Mapping[str, object]) -> dict[str, object]:
    return {
        name: str(as_path(str(value)).resolve()) if name == 'imu_from' else value
        for name, value in source.items()
    }


def _parameter_texts(stack: Stack, facts: RigFacts, drive: Path) -> dict[str, str]:
    if stack.settings_files is None:
        return {}
    try:
        texts = stack.settings_files(facts)
    except KeyError as missing:
        raise MissingDataError(
            f'{drive}: no calibration of camera {missing}, which {stack.name} needs'
        ) from None
    return {
        name: f'{WRITTEN}: {stack.title}, {stack.version}.\n{text}'
        if name.endswith('.yaml') and not text.startswith('%')
        else text
        for name, text in texts.items()
    }
