# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Open what pictures are made of: a KITTI folder or a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..bags.locate import is_bag
from ..bags.reader import OpenBag, path_of
from ..importer.apply_plan import look
from ..kitti.layouts import open_recording
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
    """The frames of a KITTI folder, or of a bag.

    Raises:
        UsageError: There is no such path.
        KittiRos2Error: It cannot be read, or has nothing to look at.
    """
    if is_bag(path, options.layout):
        with OpenBag(path) as bag:  # the frames keep its files open until they are closed
            return open_bag_frames(bag, look([bag]))
    return RecordingFrames(open_recording(path, options))


def open_bag_frames(bag: BagSource, survey: Survey) -> FrameSource:
    """The frames of a bag: of our own under KITTI's numbers, of another one by position.

    Args:
        bag: Which.
        survey: What a pass over it found.

    Raises:
        BadBagError: It cannot be read.
        MissingDataError: It has nothing to look at.
    """
    recording = open_own_recording(bag, survey)
    if recording is None:
        return BagFrames(bag, survey)
    return RecordingFrames(recording, path_of(bag).name)


def open_own_recording(bag: BagSource, survey: Survey) -> BagRecording | None:
    """The recording in a bag of our own; None where frames have no numbers of KITTI's.

    Raises:
        BadBagError: It cannot be read.
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
