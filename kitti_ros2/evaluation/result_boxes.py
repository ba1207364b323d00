# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with results -> boxes in the form of KITTI's result files.

Locations are in the rectified camera 0, the 2D box is the projection clipped to the image,
truncation and occlusion are -1. Boxes without 3D have size -1, location -1000 and angles -10, as in
the readme.txt of the object devkit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..importer.labels import ImageOf, TrackIds, make_boxes
from ..kitti.image_size import image_size
from ..messages.detections import boxes_of_detections_2d
from ..messages.solid_boxes import cuboids_in, frames_in
from ..model.boxes import Box, clip_bounds
from ..model.errors import KittiRos2Error, MissingDataError
from ..model.losses import Loss
from ..model.msgtypes import DETECTIONS_2D, MARKERS
from ..model.samples import Image
from ..model.streams import IMAGE_STREAMS
from ..own_bags.recording import BagRecording

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..kitti.recording import KittiRecording
    from ..messages.detections import ImageBox
    from ..model.boxes import Cuboid
    from ..model.samples import Calibration
    from .class_map import ClassMap
    from .result_frames import ResultFrames
    from .result_messages import ResultMessage

NOMINAL_SIZE = (1242, 375)
"""Width and height of most of KITTI's images, for a recording without images."""

_UNKNOWN = -1
_SURE = 1.0
_LEFT = {3: 2, 1: 0}
"""Images of a right camera name the optical frame of the left one."""


class ResultBoxes:
    """Converts the messages of a topic.

    Args:
        recording: Has the calibration of the frames and the size of the images.
        msgtype: Type of the messages.
        frames: Finds the frames of boxes.
        classes: Maps their classes.
        camera: KITTI index of the camera whose pixels the 2D boxes are.
    """

    def __init__(
        self,
        recording: KittiRecording | BagRecording,
        msgtype: str,
        frames: ResultFrames,
        classes: ClassMap,
        camera: int,
    ) -> None:
        self._recording = recording
        self._msgtype = msgtype
        self._frames = frames
        self._classes = classes
        self._camera = camera
        self._tracks = TrackIds()
        self._counts: Counter[str] = Counter()
        self._unusable: Counter[str] = Counter()
        self._nominal = ''
        self._find_size = lru_cache(maxsize=32)(self._image_size)

    def convert(self, result: ResultMessage) -> list[Box]:
        """Return the boxes of a frame.

        Raises:
            MissingDataError: The calibration is missing, or no transform joins a frame of boxes.
            ValueError: The same, or the message is invalid.
        """
        boxes = self._in_image(result) if self._msgtype == DETECTIONS_2D else self._solid(result)
        return [replace(each, frame=result.number) for each in boxes]

    def losses(self, topic: str) -> tuple[Loss, ...]:
        """Return the boxes so far that could not be used."""
        return tuple(
            Loss(topic, count, f'{topic}: boxes {reason}')
            for reason, count in self._unusable.items()
        )

    def notes(self, topic: str) -> tuple[str, ...]:
        """Return remarks on the boxes so far."""
        found = [f'{topic}: {count} boxes {what}' for what, count in self._counts.items()]
        if self._nominal:
            width, height = NOMINAL_SIZE
            found.append(f'{self._nominal}; 2D boxes are clipped to {width}x{height}')
        if self._frames.completed:
            names = ', '.join(sorted(self._frames.completed))
            found.append(
                f"{topic}: the bag's transforms do not join {names} to velo_link; those that the"
                f' player publishes by default are used'
            )
        return tuple(found)

    def _solid(self, result: ResultMessage) -> list[Box]:
        calibration = self._checked(self._recording.calibration(result.number))
        boxes, unseen = make_boxes(
            self._classified(self._cuboids(result, calibration)),
            calibration,
            ImageOf(self._camera, self._size(result.number)),
            self._tracks,
            occluded=_UNKNOWN,
        )
        if unseen:
            self._counts[f'out of view of camera {self._camera} are not scored'] += unseen
        return [replace(each, truncated=float(_UNKNOWN)) for each in boxes]

    def _checked(self, calibration: Calibration) -> Calibration:
        """Return the calibration.

        Raises:
            MissingDataError: A part that boxes need is missing.
        """
        needed = calibration.r0_rect, calibration.cam0_T_velo, calibration.cameras.get(self._camera)
        if any(part is None for part in needed):
            lacking = f'no calibration of camera {self._camera} and the scanner'
            raise MissingDataError(next(iter(calibration.missing.values()), lacking))
        return calibration

    def _cuboids(self, result: ResultMessage, calibration: Calibration) -> list[Cuboid]:
        """Decode the boxes of a message to velo_link."""
        names = frames_in(result.message)
        stamps_ns = result.stamp_ns, result.scan_ns
        to_velo = {name: self._frames.velo_t(name, calibration, *stamps_ns) for name in names}
        cuboids, left_out = cuboids_in(result.message, to_velo, scores=True)
        self._unusable.update(left_out)
        return cuboids

    def _classified(self, cuboids: Sequence[Cuboid]) -> list[Cuboid]:
        """Return the boxes with KITTI's classes, without those that are left out."""
        kept = []
        for each in cuboids:
            namespace = each.identity.rpartition('/')[0] if self._msgtype == MARKERS else ''
            class_name = self._classes.find(each.class_name, namespace)
            if class_name:
                score = self._score(each.score)
                kept.append(replace(each, class_name=class_name, score=score))
        return kept

    def _score(self, score: float | None) -> float:
        if score is None:
            self._counts[f'have no score; {_SURE:g} is used'] += 1
        return _SURE if score is None else score

    def _in_image(self, result: ResultMessage) -> list[Box]:
        found, left_out = boxes_of_detections_2d(result.message)
        self._unusable.update(left_out)
        bounds = np.array([each.box_2d for each in found]).reshape(-1, 4)
        cut, _ = clip_bounds(bounds, self._size(result.number))
        boxes = []
        for each, four in zip(found, cut, strict=True):
            class_name = self._classes.find(each.class_name)
            if not class_name or not self._is_of_camera(each):
                continue
            if not np.isfinite(four).all():
                self._counts['out of the image are not scored'] += 1
                continue
            left, top, right, bottom = map(float, four)
            boxes.append(
                Box(
                    class_name=class_name,
                    truncated=float(_UNKNOWN),
                    occluded=_UNKNOWN,
                    alpha=-10.0,
                    box_2d=(left, top, right, bottom),
                    size_hwl=(-1.0, -1.0, -1.0),
                    location=(-1000.0, -1000.0, -1000.0),
                    rotation_y=-10.0,
                    score=self._score(each.score),
                    track_id=self._tracks.number(each.identity),
                )
            )
        return boxes

    def _is_of_camera(self, box: ImageBox) -> bool:
        """Whether a 2D box may be in pixels of the camera: its frame is not another camera's."""
        found = self._frames.camera_of(box.frame)
        if found in {None, self._camera, _LEFT.get(self._camera)}:
            return True
        self._unusable[f'in pixels of {box.frame}; those of camera {self._camera} are scored'] += 1
        return False

    def _size(self, number: int) -> tuple[int, int]:
        varies = self._recording.layout.traits.calibration_per_frame
        return self._find_size(number if varies else 0)

    def _image_size(self, number: int) -> tuple[int, int]:
        try:
            if isinstance(self._recording, BagRecording):
                return _size_in_bag(self._recording, self._camera, number)
            return image_size(self._recording, self._camera, number)
        except KittiRos2Error as error:
            self._nominal = self._nominal or str(error)
            return NOMINAL_SIZE


def _size_in_bag(recording: BagRecording, camera: int, number: int) -> tuple[int, int]:
    """Return (width, height) of the images of a camera; see kitti.image_size.

    Raises:
        KittiRos2Error: The size is not known.
    """
    varies = recording.layout.traits.calibration_per_frame
    seen_by = recording.calibration(number).cameras.get(camera)
    if not varies and seen_by is not None and seen_by.size is not None:
        return seen_by.size
    index = recording.streams.get(IMAGE_STREAMS[camera])
    numbers = [] if index is None else index.numbers.tolist()
    wanted = number if varies else next(iter(numbers), number)
    image = recording.read(IMAGE_STREAMS[camera], wanted) if wanted in numbers else None
    if isinstance(image, Image):
        return image.width, image.height
    raise MissingDataError(f'{recording.root}: no image of camera {camera} with a known size')
