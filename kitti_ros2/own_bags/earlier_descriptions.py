# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions that do not list the files of their bag: these follow from its topics.

A stream without any topic in the bag was not selected. A text file is expected where the bag has a
topic that to-bag makes from that file alone.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..kitti import names
from ..messages.source import SWEEP
from ..messages.topics import own_topics
from ..model.layouts import Layout
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Collection

    from .description import RecordingDescription


def without_absent_streams(
    description: RecordingDescription, topics: Collection[str]
) -> RecordingDescription:
    """Remove the files of streams without a topic in the bag from a description."""
    present = _streams(topics)
    folders = {
        stream: folder if stream in present else replace(folder, carried=())
        for stream, folder in description.folders.items()
    }
    return replace(description, folders=folders)


def implied_texts(
    description: RecordingDescription, topics: Collection[str], found: Collection[PurePosixPath]
) -> tuple[PurePosixPath, ...]:
    """Return the text files of a recording that follow from the topics of its bag.

    Args:
        description: Of the recording.
        topics: Of the bag.
        found: The text files in the bag.
    """
    rules = {
        Layout.RAW: _of_raw,
        Layout.ODOMETRY: _of_odometry,
        Layout.TRACKING: _of_tracking,
    }
    rule = rules.get(description.layout)
    return () if rule is None else tuple(rule(description, topics, found))


def _streams(topics: Collection[str]) -> set[Stream]:
    return {row.stream for name, row in own_topics().items() if name in topics}


def _of_raw(
    description: RecordingDescription, topics: Collection[str], found: Collection[PurePosixPath]
) -> list[PurePosixPath]:
    drive, streams = PurePosixPath(description.name), _streams(topics)
    carrying = [folder for folder in description.folders.values() if folder.carried]
    expected = [folder.path.parent / names.TIMESTAMPS for folder in carrying]
    if SWEEP in topics:
        scans = drive / names.RAW_SCANS
        expected += [scans / names.TIMESTAMPS_START, scans / names.TIMESTAMPS_END]
    elif not set(expected).intersection(found):
        expected.clear()  # a drive without time stamps
    if Stream.LABELS in streams:
        expected.append(drive / names.RAW_TRACKLETS)
    if Stream.CALIBRATION in streams:
        files = names.RAW_CALIB
        first = next((path for path in found if path.name in files), PurePosixPath(files[0]))
        expected += [first.parent / file for file in files]
    return expected


def _of_odometry(
    description: RecordingDescription, topics: Collection[str], found: Collection[PurePosixPath]
) -> list[PurePosixPath]:
    streams = _streams(topics)
    expected = []
    sequence = next((folder.path.parent for folder in description.folders.values()), None)
    if sequence is not None and Stream.CALIBRATION in streams:
        expected.append(sequence / names.ODOMETRY_CALIB)
    if Stream.POSE in streams:
        common = PurePosixPath(names.POSES) / f'{description.name}{names.TXT}'
        beside = f'{names.POSES}{names.TXT}'
        expected.append(next((path for path in found if path.name == beside), common))
    return expected


def _of_tracking(
    description: RecordingDescription,
    topics: Collection[str],
    found: Collection[PurePosixPath],  # noqa: ARG001 - one form for all
) -> list[PurePosixPath]:
    split = next((folder.path.parents[1] for folder in description.folders.values()), None)
    if split is None or Stream.CALIBRATION not in _streams(topics):
        return []
    return [split / names.CALIB / f'{description.name}{names.TXT}']
