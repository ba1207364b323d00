# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages with 3D boxes, or with label lines -> KITTI's labels."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.tracklet_file import FULLY_OCCLUDED
from ..messages.detections import ABSURD, UNPLACED, boxes_of_detections_2d, has_scores
from ..messages.solid_boxes import box_count, cuboids_in
from ..messages.source import LABEL_LINES, decode_text
from ..model import msgtypes as types
from ..model.boxes import UNKNOWN_OCCLUSION, VISIBLE
from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.losses import Loss
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..rig.heading import find_body
from .frames_at import BoxTimes, FramesAt, MovingBase, StaticFrames, stamp_of_boxes
from .join_boxes import join_boxes, rectified_boxes
from .label_classes import LabelClasses, is_own
from .labels import (
    OUT_OF_VIEW,
    ImageOf,
    Standing,
    TrackIds,
    boxes_of_lines,
    leans,
    make_boxes,
    own_number,
)
from .pixel_frames import PixelFrames
from .planned_topics import topic_of
from .repeated_boxes import join_cuboids, join_image_boxes

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from ..model.boxes import Box, Cuboid
    from ..rig.tf_tree import FrameTree
    from .calibration_source import Calibrations
    from .convert_images import ImageConversion
    from .plan import Plan
    from .survey import Survey

OTHER_CAMERA = 'in the pixels of another camera'
LEANING = 'that lean by more than 45 degrees from the axis that labels turn about'
_LOST = {ABSURD: ' (NaN, a size of 0 or less, or beyond 100 km)', UNPLACED: '', LEANING: ''}
"""Reasons for which boxes are lost, with what is added to each; the others are by the plan."""

_FLAT = 'without a 3D box, which tracklets have no place for,'
_SAME_PLACE_M = 0.001
_REPORTED_LEAN_RAD, _MOST_LEAN_RAD = np.radians((3, 45))


class BoxConversion:
    """Converts the messages of a plan's labels, in order: tracks are numbered as they appear.

    Attributes:
        left_out: Number of boxes without a label so far, by reason.
        standing: What the boxes are upright in.
    """

    def __init__(
        self,
        plan: Plan,
        survey: Survey,
        tree: FrameTree,
        calibrations: Calibrations,
        images: ImageConversion,
        base: MovingBase | None,
    ) -> None:
        """Check the options of labels.

        Args:
            plan: Names the topic.
            survey: Of its bag.
            tree: The static transforms.
            calibrations: Of all frames.
            images: Knows the sizes of images.
            base: The frame that boxes are brought to; None without scans and cameras.

        Raises:
            UsageError: The plan names a missing topic, or its labels cannot be made.
        """
        self._plan = plan
        self._tree = tree
        self._calibrations = calibrations
        self._images = images
        self._base = base or MovingBase('', Transform.identity())
        self.left_out: Counter[str] = Counter()
        self._flat_absurd = 0
        self._max_lean = 0.0
        self.standing = self._find_standing()
        self._tracks = TrackIds()
        labels = plan.labels
        self._only_flat = (
            labels is not None and topic_of(survey, labels.topic).msgtype == types.DETECTIONS_2D
        )
        self._scores = self._check(survey, placed=base is not None)
        self._pixel_frames: Container[str] = ()
        if labels is not None and labels.camera in plan.cameras:
            self._pixel_frames = PixelFrames(survey, tree, plan.cameras[labels.camera])
        own = labels is not None and is_own(survey, labels.topic)
        self._classes = None if labels is None else LabelClasses(labels, own=own)
        self._tracklets = survey.tracklets if own else {}
        self._occlusions: Counter[int] = Counter()
        self._unset = 0

    def _check(self, survey: Survey, *, placed: bool) -> bool:
        """Check the options of labels; return whether they have scores."""
        plan = self._plan.labels
        if plan is None:
            return False
        if not placed and plan.topic != LABEL_LINES:
            raise UsageError('labels need a scan or a camera_info: their boxes are given in frames')
        # 3 was the default of earlier plans.
        if plan.topic == LABEL_LINES and plan.occluded not in {VISIBLE, UNKNOWN_OCCLUSION}:
            raise UsageError(
                f'labels.occluded is for boxes; the label lines of {plan.topic} have their own:'
                f' leave it at {VISIBLE}'
            )
        calibration = self._calibrations.first
        if calibration is None:
            raise UsageError('labels need a calibration: set calibration of the plan, or --calib')
        if plan.camera not in calibration.cameras:
            raise UsageError(
                f'labels.camera is {plan.camera}, of which there is no calibration; expected'
                f' {", ".join(map(str, sorted(calibration.cameras)))}'
            )
        if plan.boxes_2d:
            found = topic_of(survey, plan.boxes_2d)
            if found.msgtype != types.DETECTIONS_2D or self._only_flat or plan.topic == LABEL_LINES:
                raise UsageError(
                    f'labels.boxes_2d: {plan.boxes_2d} is a {found.msgtype}; expected a'
                    f' Detection2DArray beside a topic with 3D boxes'
                )
        return any(has_scores(look) for look in topic_of(survey, plan.topic).looks)

    def _find_standing(self) -> Standing:
        """Return what boxes are upright in, by the robot's body where the tree has it.

        Those that become tracklets are placed in a camera that is level in velo_link.
        """
        body = find_body(self._tree, [self._base.frame])
        axes = None if body is None else body.axes_of(self._tree, self._base.frame)
        up = None if axes is None else self._base.velo_T_frame.rotation @ axes[2]
        labels = self._plan.labels
        lines = labels is not None and labels.topic == LABEL_LINES
        in_scans = self._plan.layout.traits.tracklets and not lines
        return Standing(NOMINAL_CAM0_T_VELO if in_scans else None, up)

    @cached_property
    def _to_velo(self) -> StaticFrames:
        """velo_T_frame of every frame connected to the scans' (or to the camera's) frame."""
        return StaticFrames(self._tree, self._base)

    def boxes(
        self,
        messages: Sequence[Any],
        stamp_ns: int,
        times: BoxTimes,
        flat: Sequence[Any] = (),
    ) -> list[Box]:
        """Make the labels of a frame.

        Args:
            messages: With 3D boxes, or label lines.
            stamp_ns: The stamp of the frame.
            times: When boxes in frames that move are placed.
            flat: Detection2DArrays with the 2D boxes, none for projections.

        Raises:
            ValueError: They cannot be read.
        """
        plan, calibration = self._plan.labels, self._calibrations.at(stamp_ns)
        if plan is None or calibration is None:
            return []
        if plan.topic == LABEL_LINES:
            return self._lines(decode_text(messages[0]).text)
        size = self._images.size(plan.camera) or calibration.cameras[plan.camera].size
        if size is None:
            raise ValueError(f'the size of camera {plan.camera} is not known')
        if self._only_flat:
            flat = messages
        cuboids, left_out = self.all_cuboids(messages, times)
        if self._classes is not None:
            find = self._classes.find
            cuboids = [replace(each, class_name=find(each.class_name)) for each in cuboids]
        cuboids = self._with_levels(cuboids, messages)
        lean = leans(cuboids, calibration, self.standing)
        cuboids = [cuboids[place] for place in np.flatnonzero(lean <= _MOST_LEAN_RAD)]
        self.left_out[LEANING] += len(lean) - len(cuboids)
        self._max_lean = max([self._max_lean, *lean[lean <= _MOST_LEAN_RAD]])
        boxes, unseen = make_boxes(
            cuboids,
            calibration,
            ImageOf(plan.camera, size),
            self._tracks,
            out_of_view=plan.out_of_view,
            occluded=plan.occluded,
            standing=self.standing,
        )
        self.left_out.update(left_out)
        self.left_out[OUT_OF_VIEW] += unseen
        boxes = self._joined(boxes, flat, size) if flat else boxes
        self._occlusions.update(each.occluded for each in boxes)
        return boxes

    def _with_levels(self, cuboids: list[Cuboid], messages: Sequence[Any]) -> list[Cuboid]:
        """Give boxes that to-bag made of tracklets their occlusion and level of truncation.

        Labels of the object layout have the part outside of the image in place of a level.
        """
        if not self._tracklets:
            return cuboids
        levels = not self._plan.layout.traits.frame_set
        known = self._tracklets.get(stamp_of_boxes(messages[0]), {})
        found = []
        for each in cuboids:
            own = _tracklet_of(each, known)
            if own is None:
                found.append(each)
                continue
            self._unset += own.occluded is None
            truncation = own.truncation if levels else None
            found.append(replace(each, occluded=own.occluded, truncation=truncation))
        return found

    def all_cuboids(
        self, messages: Sequence[Any], times: BoxTimes | None = None
    ) -> tuple[list[Cuboid], list[str]]:
        """Decode the messages of a moment as cuboids does, each box once.

        Raises:
            ValueError: None of them can be read.
        """
        found, left_out, faults = [], list[str](), []
        for message in messages:
            try:
                cuboids, reasons = self.cuboids(message, times)
            except ValueError as error:
                faults.append((error, message))
                continue
            found.append(cuboids)
            left_out += reasons
        if faults and not found:
            raise faults[0][0]
        left_out += [UNPLACED] * sum(box_count(message) for _, message in faults)
        made, repeated = join_cuboids(found)
        return made, left_out + repeated

    def _joined(self, boxes: list[Box], flat: Sequence[Any], size: tuple[int, int]) -> list[Box]:
        """Give labels the 2D boxes of a detector; those without a 3D box become labels, too."""
        plan = self._plan.labels
        if plan is None:
            return boxes
        decoded = [boxes_of_detections_2d(each) for each in flat]
        found, left_out = join_image_boxes([made for made, _ in decoded])
        left_out += [reason for _, reasons in decoded for reason in reasons]
        self._flat_absurd += left_out.count(ABSURD)
        self.left_out.update(each for each in left_out if each != ABSURD)
        model = self._images.model(plan.camera)
        here = [
            each
            for each in found
            if model is None or not each.frame or each.frame in self._pixel_frames
        ]
        if self._classes is not None:
            find = self._classes.find
            here = [each._replace(class_name=find(each.class_name)) for each in here]
        self.left_out[OTHER_CAMERA] += len(found) - len(here)
        if model is not None and self._plan.cameras[plan.camera].rectify:
            here = rectified_boxes(here, model)
        made, unseen = join_boxes(
            boxes, here, size, self._tracks, occluded=plan.occluded, scores=self._scores
        )
        self.left_out[OUT_OF_VIEW] += unseen
        if self._plan.layout.traits.tracklets:
            solid = [box for box in made if box.size_hwl[0] > 0]
            self.left_out[_FLAT] += len(made) - len(solid)
            return solid
        return made

    def _lines(self, text: str) -> list[Box]:
        boxes = boxes_of_lines(text, self._tracks)
        if self._classes is None or not self._plan.labels or not self._plan.labels.classes:
            return boxes
        find = self._classes.find
        return [replace(each, class_name=find(each.class_name)) for each in boxes]

    def cuboids(
        self,
        message: Any,  # noqa: ANN401 - as boxes
        times: BoxTimes | None = None,
    ) -> tuple[list[Cuboid], list[str]]:
        """Decode a message with 3D boxes to boxes in velo_link; also why others were skipped.

        Args:
            message: The boxes.
            times: When it and the scan that it belongs to are placed; None for its own stamp.

        Raises:
            ValueError: They cannot be read.
        """
        if self._only_flat:
            return [], []
        frames = FramesAt(self._to_velo, self._base, times or BoxTimes(stamp_of_boxes(message)))
        return cuboids_in(message, frames, scores=self._scores)

    def notes(self) -> list[str]:
        """Return non-fatal remarks on the boxes so far."""
        found = [
            f'{count} boxes {reason} were left out of the labels'
            for reason, count in self.left_out.items()
            if count and reason not in _LOST
        ]
        if self._tracks.unnamed and self._plan.layout.traits.common_labels:
            found.append(f'{self._tracks.unnamed} boxes have no id: each is a track of its own')
        if self._tracks.repeated and self._plan.layout.traits.common_labels:
            found.append(
                f'{self._tracks.repeated} boxes have the id of another one of their message: each'
                f' is a track of its own'
            )
        if self._max_lean > _REPORTED_LEAN_RAD:
            axis = "the camera's y" if self.standing.frame_T_velo is None else "the scans' z"
            found.append(
                f'boxes lean by up to {np.degrees(self._max_lean):.0f} degrees from {axis} axis,'
                f' about which alone labels turn: their heading was kept'
            )
        found += self._occlusion_notes()
        return found if self._classes is None else [*found, *self._classes.notes()]

    def _occlusion_notes(self) -> list[str]:
        """Return remarks on labels that evaluations leave out, and on levels of tracklets."""
        plan = self._plan.labels
        if plan is None or self._plan.layout.traits.tracklets:
            return []
        found = []
        if self._tracklets and self._occlusions[FULLY_OCCLUDED]:
            found.append(
                f'{plan.topic}: {self._occlusions[FULLY_OCCLUDED]} boxes are fully occluded in the'
                f' tracklets; labels have no such level, and contain 2, largely'
            )
        if self._unset:
            found.append(
                f'{plan.topic}: {self._unset} boxes have no occlusion in the tracklets; labels'
                f' contain {plan.occluded}, as labels.occluded of the plan says'
            )
        unknown = self._occlusions[UNKNOWN_OCCLUSION]
        if unknown:
            found.append(
                f'{plan.topic}: {unknown} labels contain occlusion 3, unknown, as labels.occluded'
                f' of the plan says: evaluations leave them out; 0 has them counted'
            )
        return found

    def losses(self) -> tuple[Loss, ...]:
        """Return the boxes so far that a label cannot represent."""
        plan = self._plan.labels
        if plan is None:
            return ()
        counts = Counter({(plan.topic, reason): self.left_out[reason] for reason in _LOST})
        counts[plan.boxes_2d or plan.topic, ABSURD] += self._flat_absurd
        return tuple(
            Loss(topic, count, f'{topic}: boxes {reason}{_LOST[reason]}')
            for (topic, reason), count in counts.items()
            if count
        )


def _tracklet_of(cuboid: Cuboid, known: Mapping[int, Cuboid]) -> Cuboid | None:
    """Return the tracklet of a box among those of its frame; DetectedObjects have no track."""
    track_id = own_number(cuboid.identity)
    if track_id is not None:
        return known.get(track_id)
    place = cuboid.velo_T_box.translation
    return next(
        (
            each
            for each in known.values()
            if np.linalg.norm(each.velo_T_box.translation - place) < _SAME_PLACE_M
        ),
        None,
    )
