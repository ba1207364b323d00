# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labels of a bag, drawn on its camera images.

Cameras and labels are detected as for a conversion (see guess). An image has the labels nearest to
it in time, at most half of their period away. In a bag written by to-bag, whose labels belong to
frames, they are also at most half of the images' period away.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.reader import Decoder, open_messages
from ..bags.single_messages import MessagesByIndex
from ..drawing.annotate import annotate
from ..drawing.labelled_objects import colour_pixels, objects_of
from ..kitti.label_file import labels_of_text
from ..messages.naming import LABEL_LINES
from ..messages.source_texts import decode_text
from ..model.errors import KittiRos2Error, LossTally, UsageError, describe_error
from ..model.samples import FrameLabels, default_tolerance_ns
from ..model.streams import Layout
from .bag_poses import read_moving
from .bag_scans import without_unreadable_scans
from .box_labels import own_number
from .guess import guess_plan
from .plan import NONE, SOURCE, TF
from .sensor_rig import SensorRig
from .survey import survey_sensors, topic_of
from .tf_frames import BoxTimes, stamp_of_boxes

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import OpenBag
    from ..drawing.labelled_objects import Pixels as Picture
    from ..messages.images import Pixels
    from ..model.samples import Int64Array
    from .plan import Plan
    from .survey import Survey

_OPTION_HINT = re.compile(r' \([^()]*--calib\)')
"""The part of an error about options of the conversion."""

_CACHED = 4  # of the labels that were decoded last: several cameras show the same


class LabelledImages:
    """Draws the labels of a bag on its images; for one thread at a time.

    Args:
        bag: The bag; its files are open until close.

    Attributes:
        topics: By image topic the KITTI index of its camera.
        notes: Notes for the user, a line each.

    Raises:
        UsageError: The bag has no camera images, no labels, or not the calibration they need.
        BadBagError: It cannot be read.
    """

    def __init__(self, bag: OpenBag) -> None:
        survey = survey_sensors(bag)
        plan, labels = _plan(bag.path, survey)
        self._plan, self._sensors = _make_sensors(bag, plan, labels, survey)
        self.topics: Mapping[str, int] = {
            camera.topic: index
            for index, camera in self._plan.cameras.items()
            if survey.topics[camera.topic].keys is None
        }
        if not self.topics:
            raise _no_images(bag.path, 'its images are video, which is played as it is')
        self._labels = _Labels(bag, survey, labels)
        if plan.calibration == SOURCE:
            self._labels.limit_to_frame(bag.index.by_topic(), self.topics)
        # Changes of a calibration written by to-bag are applied.
        self.notes = self._sensors.calibrations.notes if self._plan.calibration == TF else ()
        self._objects = lru_cache(_CACHED)(self._read_objects)

    def draw(
        self,
        topic: str,
        image: Any,  # noqa: ANN401 - of the bag's types
        pixels: Pixels,
        stamp_ns: int,
        log_ns: int,
    ) -> Picture:
        """Draw labels on a copy of an image; returns (H, W, 3) uint8 BGR.

        Args:
            topic: The topic of the image.
            image: The Image or CompressedImage.
            pixels: The same decoded.
            stamp_ns: The stamp of its header, nanoseconds since 1970.
            log_ns: Log time, nanoseconds since 1970.

        Raises:
            ValueError: The labels cannot be read, or the image cannot be rectified.
        """
        camera = self.topics[topic]
        if self._plan.cameras[camera].rectify:
            pixels = self._sensors.images.pixels(camera, image)
        picture = np.array(colour_pixels(pixels))
        index = self._labels.index_at(stamp_ns, log_ns)
        calibration = self._sensors.calibrations.at(log_ns)
        labels = FrameLabels() if index is None else self._objects(index, stamp_ns)
        annotate(picture, objects_of(labels, calibration), calibration, camera)
        return picture

    def close(self) -> None:
        """Close the files."""
        self._labels.close()

    def _read_objects(self, index: int, image_ns: int) -> FrameLabels:
        message = self._labels.read(index)
        if self._labels.topic == LABEL_LINES:
            return labels_of_text(decode_text(message))
        own_ns = stamp_of_boxes(message)
        times = BoxTimes(own_ns, own_ns if self._labels.by_log else image_ns)
        cuboids, _ = self._sensors.labels.cuboids(message, times)
        return FrameLabels(
            cuboids=[replace(cuboid, track_id=own_number(cuboid.identity)) for cuboid in cuboids]
        )


class _Labels:
    """Finds and reads the message of the labels' topic nearest to an image."""

    def __init__(self, bag: OpenBag, survey: Survey, topic: str) -> None:
        labels = topic_of(survey, topic)
        self.topic = topic
        self._log_ns: Int64Array = np.array(labels.log_ns, dtype=np.int64)
        stamps, why_not_headers = labels.stamps()
        self.by_log = why_not_headers is not None or len(labels.header_ns) != labels.count
        order = np.argsort(stamps, kind='stable')
        self._order, self._stamps = order, stamps[order]
        self._tolerance_ns = default_tolerance_ns(stamps)
        self._messages = open_messages(bag, {topic})
        self._by_index = MessagesByIndex(self._messages, self._log_ns)

    def limit_to_frame(self, stamps: Mapping[str, Int64Array], images: Collection[str]) -> None:
        """Match labels to one image of each camera only, as in KITTI's frames."""
        periods = (default_tolerance_ns(stamps[topic]) for topic in images)
        self._tolerance_ns = min(self._tolerance_ns, *periods)

    def close(self) -> None:
        """Close the files."""
        self._messages.close()

    def index_at(self, stamp_ns: int, log_ns: int) -> int | None:
        """Return the index of the message of an image, None where none is near."""
        at = log_ns if self.by_log else stamp_ns
        after = int(np.searchsorted(self._stamps, at))
        near = [index for index in (after - 1, after) if 0 <= index < len(self._stamps)]
        best = min(near, key=lambda index: abs(int(self._stamps[index]) - at))
        if abs(int(self._stamps[best]) - at) > self._tolerance_ns:
            return None
        return int(self._order[best])

    def read(self, index: int) -> Any:  # noqa: ANN401 - of the bag's types
        """Read and decode a message.

        Raises:
            ValueError: It cannot be read.
        """
        try:
            message = self._by_index.read(index)
        except (KittiRos2Error, OSError) as error:
            raise ValueError(describe_error(error)) from None
        if message is None:
            raise ValueError(f'a message of {self.topic} is missing')
        return Decoder(self._messages.typestore)(message)


def _plan(path: Path, survey: Survey) -> tuple[Plan, str]:
    """Make the plan of a bag, of layout raw: a known distortion of images is kept.

    Returns:
        The plan, and the topic of the labels.
    """
    try:
        plan = without_unreadable_scans(guess_plan(survey, Layout.RAW, path).plan, survey)
    except KittiRos2Error as error:
        raise UsageError(f'no annotated images can be made: {error}') from None
    missing = []
    if not plan.cameras:
        missing.append('camera images')
    if plan.labels is None:
        missing.append(
            'labels (a Detection3DArray, TrackedObjects or DetectedObjects, cubes in a MarkerArray,'
            f' or {LABEL_LINES})'
        )
    if plan.calibration == NONE:
        missing.append('calibration (camera_info)')
    if missing or plan.labels is None:
        raise _no_images(path, f'the bag has no {" and no ".join(missing)}')
    labels = replace(plan.labels, out_of_view=True)
    plan = replace(plan, labels=labels, imu='', fix='', velocity='', imu_frame='')
    return plan, labels.topic


def _make_sensors(bag: OpenBag, plan: Plan, labels: str, survey: Survey) -> tuple[Plan, SensorRig]:
    """Make the rig of a plan; label lines have 2D boxes, which need no calibration."""
    try:
        sensors = SensorRig(plan, survey, read_moving([bag], plan, survey, LossTally()))
        if labels != LABEL_LINES:
            _try_labels(sensors, topic_of(survey, labels).samples)
    except (KittiRos2Error, ValueError) as error:
        if labels != LABEL_LINES:
            raise _no_images(bag.path, _OPTION_HINT.sub('', str(error))) from None
        plan = replace(plan, calibration=NONE, labels=None)
        return plan, SensorRig(plan, survey)
    return plan, sensors


def _try_labels(sensors: SensorRig, messages: Sequence[Any]) -> None:
    """Require that one of the sampled messages can be read, where any has boxes.

    Raises:
        ValueError: None can be: their frames are not joined, or not known at their stamps.
    """
    errors = []
    for message in messages:
        try:
            sensors.labels.cuboids(message)
        except ValueError as error:
            errors.append(error)
    if errors and len(errors) == len(messages):
        raise errors[0]


def _no_images(path: Path, reason: str) -> UsageError:
    return UsageError(f'{path}: no annotated images can be made: {reason}')
