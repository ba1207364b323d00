# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Results that are recorded in a bag -> label boxes by frame number of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..bags.reader import open_messages, opened
from ..importer.report import LossTally, damage
from ..model.errors import KittiRos2Error
from .class_map import CLASSES, ClassMap
from .frame_stamps import frames_of
from .result_boxes import ResultBoxes
from .result_frames import ResultFrames
from .result_messages import choose_topic, read_messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from ..bags.reader import BagSource
    from ..kitti.recording import KittiRecording
    from ..model.boxes import Box
    from ..model.losses import Loss
    from ..own_bags.recording import BagRecording


@dataclass(frozen=True)
class BagResults:
    """The results in a bag.

    Attributes:
        topic: Their topic.
        boxes: By number of each frame with a message that can be used, ascending; see result_boxes.
        unanswered: The frames without a message, ascending; they are also a loss.
        losses: What could not be used.
        notes: Remarks.
    """

    topic: str
    boxes: Mapping[int, Sequence[Box]]
    unanswered: tuple[int, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def read_bag_results(
    bag: BagSource,
    topic: str | None,
    recording: KittiRecording | BagRecording,
    class_map: Mapping[str, str],
    *,
    classes: Iterable[str] = CLASSES,
    tolerance_ns: int | None = None,
    camera: int = 2,
) -> BagResults:
    """Read the results on a topic of a bag.

    Args:
        bag: The bag.
        topic: A topic of Detection3DArray, Detection2DArray or MarkerArray; None is the only one
            besides those of the recording itself.
        recording: The ground truth, with the stamps and the calibration of the frames.
        class_map: KITTI's class of classes of the results, see ClassMap.
        classes: Classes that stand for themselves in any case.
        tolerance_ns: The largest distance between the stamps of a message and of its frame; None is
            half the time between frames.
        camera: KITTI index of the camera whose pixels the 2D boxes are.

    Raises:
        BadBagError: The bag cannot be read, or not one message belongs to a frame.
        UsageError: There is no such topic, it has no boxes, or several topics have.
    """
    frames, tally = frames_of(recording, tolerance_ns), LossTally()
    known = ClassMap(class_map, classes)
    boxes: dict[int, Sequence[Box]] = {}
    with opened(bag) as source:
        with open_messages(source) as messages:
            types = dict(messages.channels)
        name = choose_topic(source, types, topic)
        found = read_messages(source, types, name, frames)
        tree = ResultFrames(source, types, recording.cameras, frames.tolerance_ns, tally)
        converter = ResultBoxes(recording, types[name], tree, known, camera)
        for number, result in found.by_frame.items():
            try:
                boxes[number] = converter.convert(result)
            except (ValueError, KittiRos2Error) as error:
                tally.lose(name, result.log_ns, str(error))
        damaged = damage({**found.damage, **tree.damage}, source.path.name)
    losses = (*tally.losses(), *known.losses(name), *converter.losses(name))
    return BagResults(
        name,
        boxes,
        found.unanswered,
        (*damaged, *found.losses, *losses),
        (*found.notes, *converter.notes(name)),
    )
