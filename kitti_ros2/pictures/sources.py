# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens the source of pictures: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..bags.open_source import open_source
from ..bags.reader import OpenBag, path_of
from ..importer.apply_plan import look
from ..own_bags.numbering import number_bag
from ..own_bags.recording import BagRecording
from .bag_frames import BagFrames
from .recording_frames import RecordingFrames

if TYPE_CHECKING:
    from pathlib import Path

    from ..bags.reader import BagSource
    from ..importer.survey import Survey
    from ..options.read import ReadOptions
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
        return open_bag_frames(bag, look([bag]))


def open_bag_frames(bag: BagSource, survey: Survey) -> FrameSource:
    """Open the frames of a bag: with KITTI's numbers if written by to-bag, else by position.

    Args:
        bag: The bag.
        survey: The survey of the bag.

    Raises:
        BadBagError: The bag cannot be read.
        MissingDataError: The bag contains nothing to draw.
    """
    recording = open_own_recording(bag, survey)
    if recording is None:
        return BagFrames(bag, survey)
    return RecordingFrames(recording, path_of(bag).name)


def open_own_recording(bag: BagSource, survey: Survey) -> BagRecording | None:
    """Open the recording in a bag written by to-bag; None if frames have no KITTI numbers.

    Raises:
        BadBagError: The bag cannot be read.
    """
    log_ns = {
        name: np.array(each.log_ns, np.int64) for name, each in survey.topics.items() if each.count
    }
    numbered = number_bag(bag, log_ns)
    if numbered is None:
        return None
    recording = BagRecording(bag, numbered, survey)
    if recording.streams:
        return recording
    recording.close()
    return None
