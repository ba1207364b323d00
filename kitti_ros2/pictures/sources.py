# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens the source of pictures: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..bags.open_source import open_source
from ..bags.reader import OpenBag
from ..importer.survey import look
from ..own_bags.numbering import number_bag
from ..own_bags.recording import BagRecording
from .bag_frames import BagFrames
from .recording_frames import RecordingFrames

if TYPE_CHECKING:
    from pathlib import Path

    from ..importer.survey import Survey
    from ..options.read import ReadOptions
    from ..own_bags.blueprint import Blueprint
    from .frame import FrameSource


def open_frames(path: Path, options: ReadOptions) -> FrameSource:
    """Open the frames of a KITTI folder or a bag.

    Raises:
        UsageError: The path does not exist.
        KittiRos2Error: The source cannot be read, or contains nothing to draw.
    """
    source = open_source(path, options)
    if not isinstance(source, OpenBag):
        return RecordingFrames(source)
    with source as bag:  # the frames keep its files open until they are closed
        survey = look([bag])
        return open_bag_frames(bag, survey, open_own_recording(bag, survey))


def open_bag_frames(
    bag: OpenBag, survey: Survey, own: BagRecording | None
) -> RecordingFrames | BagFrames:
    """Open the frames of a bag: with KITTI's numbers if written by to-bag, else by position.

    Args:
        bag: The bag.
        survey: The survey of the bag.
        own: Its recording, if to-bag wrote it.

    Raises:
        BadBagError: The bag cannot be read.
        MissingDataError: The bag contains nothing to draw.
    """
    return BagFrames(bag, survey) if own is None else RecordingFrames(own, bag.path.name)


def open_own_recording(
    bag: OpenBag, survey: Survey, blueprint: Blueprint | None = None
) -> BagRecording | None:
    """Open the recording in a bag written by to-bag; None if frames have no KITTI numbers.

    Args:
        bag: The bag.
        survey: The survey of the bag.
        blueprint: The layout of the recording, if already read.

    Raises:
        BadBagError: The bag cannot be read.
    """
    log_ns = {
        name: np.array(each.log_ns, np.int64) for name, each in survey.topics.items() if each.count
    }
    numbered = number_bag(bag, log_ns, blueprint=blueprint)
    if numbered is None:
        return None
    recording = BagRecording(bag, numbered, survey)
    if recording.streams:
        return recording
    recording.close()
    return None
