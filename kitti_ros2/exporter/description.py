# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The description of a recording in its bag: what the messages hold of its files."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

from ..messages.source import GREY, promise
from ..model.errors import KittiRos2Error, RemoteError
from ..model.msgtypes import IMAGE
from ..model.streams import Stream
from ..options.messages import ColorEncoding

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..messages.topics import Topic
    from ..model.recording import ReadableRecording
    from ..model.samples import Description, Image
    from ..options.messages import MessageOptions
    from .schedule import Schedule


def describe(
    recording: ReadableRecording,
    schedule: Schedule,
    table: Sequence[Topic],
    options: MessageOptions,
) -> Description:
    """Describe the recording, and which of its files are in the messages.

    Unreadable samples are included, since the description is sent first.

    Args:
        recording: The recording.
        schedule: The selected samples.
        table: The rows that have messages.
        options: Of the messages.
    """
    carried = {row.stream: schedule.numbers_of(row.stream) for row in table if row.restores}
    numbered = Stream.CALIBRATION in recording.streams
    calibrations: list[str] = []
    if Stream.CALIBRATION in carried and not numbered:
        calibrations = [file.name for file in recording.calibration(0).files]
    described = promise(recording.describe(), carried, calibrations)
    grey: list[str] = []
    if options.color_encoding is ColorEncoding.MONO8:
        raw = {row.stream for row in table if row.msgtype == IMAGE and row.restores}
        grey = sorted(stream.value for stream in raw if _is_colour(recording, schedule, stream))
    return replace(described, values={**described.values, GREY: grey}) if grey else described


def _is_colour(recording: ReadableRecording, schedule: Schedule, stream: Stream) -> bool:
    """Whether the first readable image of a stream has colours."""
    for number in schedule.numbers_of(stream):
        try:
            image = cast('Image', recording.read(stream, number))
        except RemoteError:
            raise
        except (KittiRos2Error, OSError):
            continue
        return image.channels > 1
    return False
