# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labels of a bag: their topic, the messages of a frame, and their conversion to KITTI's."""

from __future__ import annotations

from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.tracklet_file import FULLY_OCCLUDED
from ..messages.detections import (
    ABSURD,
    UNPLACED,
    box_count,
    boxes_in,
    boxes_of_detections_2d,
    cuboids_in,
    has_scores,
)
from ..messages.naming import LABEL_LINES
from ..messages.source_texts import decode_text
from ..messages.tf_tree import find_body
from ..messages.topics import own_topics, prediction_topics
from ..model import bag_formats as types
from ..model.boxes import UNKNOWN_OCCLUSION, VISIBLE
from ..model.classes import OTHERS, kitti_class
from ..model.errors import Loss, UsageError
from ..model.geometry import NOMINAL_CAM0_T_VELO, Transform
from .bag_cameras import main_camera
from .box_labels import (
    OUT_OF_VIEW,
    ImageOf,
    LabelClasses,
    TrackIds,
    UprightFrame,
    boxes_of_lines,
    default_classes,
    is_own,
    join_boxes,
    join_cuboids,
    join_image_boxes,
    lean_angles,
    make_boxes,
    others_note,
    others_of,
    own_number,
    rectified_boxes,
)
from .plan import LabelPlan
from .survey import topic_of, unchosen_notes
from .tf_frames import BoxTimes, FramesAt, MovingBase, StaticFrames, is_truth, stamp_of_boxes

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from ..messages.tf_tree import FrameTree
    from ..model.boxes import Box, Cuboid
    from ..model.streams import Layout
    from .bag_calibration import Calibrations, PlannedRig
    from .bag_cameras import ImageConversion
    from .kitti_frames import Frames
    from .plan import CameraPlan
    from .survey import Survey, TopicSurvey


# The frames that boxes in the pixels of a camera may name.

_SAME_POSITION_M = 1e-3
_CAMERA_TYPES = (types.IMAGE, types.COMPRESSED, types.CAMERA_INFO)


class PixelFrames:
    """The frames of a camera's images, and those at the same position; to be tested with `in`.

    A driver's camera_frame and camera_optical_frame are of one camera, turned (REP 103). Frames of
    other cameras are left out: those of one device may be at one position. Boxes
    without a frame are of the only camera.
    """

    def __init__(self, survey: Survey, tree: FrameTree, camera: CameraPlan) -> None:
        """Take the frames of a camera in the tree of its bag.

        Raises:
            UsageError: The bag has no messages of the camera.
        """
        names = {topic_of(survey, name).frame_id for name in (camera.topic, camera.info) if name}
        self._named = {*names, camera.frame} - {''}
        camera_frames = {topic.frame_id for kind in _CAMERA_TYPES for topic in survey.of_type(kind)}
        self._others = camera_frames - self._named - {''}
        self._tree = tree

    def __contains__(self, name: object) -> bool:
        if name in self._named or not name:
            return bool(name) or not self._others
        if not isinstance(name, str) or name in self._others or name not in self._tree.frames:
            return False
        return any(
            _is_same_position(self._tree, own, name) for own in self._named & self._tree.frames
        )

    @cached_property
    def every(self) -> list[str]:
        """All of them that have a name, sorted."""
        return sorted(self._named | {name for name in self._tree.frames if name in self})


def _is_same_position(tree: FrameTree, first: str, second: str) -> bool:
    pose = tree.find(first, second)
    return pose is not None and bool(np.linalg.norm(pose.translation) < _SAME_POSITION_M)


# Choice of the topic of the labels.


def guess_labels(
    survey: Survey,
    tree: FrameTree,
    cameras: dict[int, CameraPlan],
    notes: list[str],
    layout: Layout,
) -> LabelPlan | None:
    """Choose labels: detections, objects of Autoware, markers, then 2D boxes.

    Boxes of sane sizes and known classes go before others, and those with tracks in a layout that
    has tracks. In a bag written by to-bag, markers have the classes of KITTI, and objects have not.
    Tracklets have no 2D boxes.
    """
    own = survey.topics.get(LABEL_LINES)
    if own is not None and own.count and survey.calibrations:
        return LabelPlan(own.name, main_camera(cameras)) if cameras else None
    detections = _of_labels(survey, types.DETECTIONS_3D)
    objects = _of_labels(survey, types.TRACKED_OBJECTS) or _of_labels(
        survey, types.DETECTED_OBJECTS
    )
    markers = [label for label in _of_labels(survey, types.MARKERS) if has_cubes(label)]
    kinds = [detections, *([markers, objects] if survey.calibrations else [objects, markers])]
    flat = _of_camera(survey, tree, cameras)
    solid = [topic for kind in kinds for topic in kind]
    topics = solid or ([] if layout.traits.tracklets else flat)
    if not topics or not cameras:
        notes.append(
            'missing: labels (no Detection3DArray, TrackedObjects or DetectedObjects, no cubes'
            ' in a MarkerArray)'
        )
        return None
    # The first kind goes before equal topics of others.
    order = {topic.name: -rank for rank, kind in enumerate(kinds) for topic in kind}
    best = max(topics, key=lambda topic: _rank(topic, order, tracks=layout.traits.common_labels))
    topics = [topic for topic in topics if topic.msgtype == best.msgtype]
    notes += unchosen_notes('labels', best, topics)
    boxes_2d = ''
    if flat and best not in flat:
        nearest = max(flat, key=lambda topic: _rank(topic, {}, tracks=False))
        notes += unchosen_notes('2D boxes of labels', nearest, flat)
        boxes_2d = nearest.name
    sane, _, boxes = _plausible(best)
    if boxes and not sane:
        notes.append(
            f'labels: most boxes of {best.name} are smaller than {_LEAST_M} m, or larger than what'
            f' drives or walks; are they metres, and objects?'
        )
    plan = LabelPlan(best.name, main_camera(cameras), boxes_2d=boxes_2d)
    if is_own(survey, best.name):
        return plan
    notes += others_note(best.name, others_of(best.classes), 'of those looked at are written')
    return replace(plan, classes=default_classes(best.classes))


_LEAST_M, _MOST_M = 0.05, (45.0, 8.0, 8.0)
"""Length, width and height of what drives or walks; a tram of KITTI is 35 m long."""


def _rank(
    topic: TopicSurvey, order: Mapping[str, int], *, tracks: bool
) -> tuple[bool, bool, bool, bool, bool, int, int, int]:
    """Rank: of sane sizes, ground truth, of known classes, with tracks and classes, of most."""
    sane, has_known_classes, boxes = _plausible(topic)
    return (
        sane,
        is_truth(topic.name),
        has_known_classes,
        tracks and topic.has_tracks,
        any(topic.classes),
        order.get(topic.name, 0),
        boxes,
        topic.count,
    )


def _plausible(topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Return whether most boxes have a size of things on a road, and a class but Misc; how many."""
    sizes, names = [], []
    for message in topic.samples:
        if topic.msgtype == types.DETECTIONS_2D:
            names += [box.class_name for box in boxes_of_detections_2d(message)[0]]
            continue
        with suppress(ValueError):
            boxes = boxes_in(message)
            sizes += [box.size_lwh for box in boxes]
            names += [box.class_name for box in boxes]
    names = [*topic.classes.elements()] or names
    sane = sum(min(size) > _LEAST_M and bool((np.array(size) <= _MOST_M).all()) for size in sizes)
    classed = sum(kitti_class(name) not in {None, OTHERS} for name in names)
    return bool(names) and 2 * sane >= len(sizes), 2 * classed > len(names), len(names)


def _of_camera(
    survey: Survey, tree: FrameTree, cameras: dict[int, CameraPlan]
) -> list[TopicSurvey]:
    """Return the topics of 2D boxes in the pixels of the labels' camera."""
    if not cameras:
        return []
    names = PixelFrames(survey, tree, cameras[main_camera(cameras)])
    topics = _of_labels(survey, types.DETECTIONS_2D)
    return [topic for topic in topics if topic.frame_id in names and topic.name not in own_topics()]


def _of_labels(survey: Survey, msgtype: str) -> list[TopicSurvey]:
    """Return the topics of a type without those of predictions by to-bag."""
    topics = survey.of_type(msgtype)
    return [topic for topic in topics if topic.name not in prediction_topics()]


def has_cubes(topic: TopicSurvey) -> bool:
    """Return whether a sampled MarkerArray has a cube."""
    cube = 1  # visualization_msgs/Marker.CUBE
    return any(marker.type == cube for message in topic.samples for marker in message.markers)


# The messages of a frame's labels, collected: arrays of one stamp, 2D boxes beside 3D boxes.


class LabelMessages:
    """Collects the messages of each frame's labels until all of them were read.

    Args:
        plan: Names the topics, None without labels.
        frames: The frames, and the messages of their labels.
        first: The number of the first frame.
    """

    def __init__(self, plan: LabelPlan | None, frames: Frames, first: int) -> None:
        self._due: dict[tuple[str, int], list[int]] = defaultdict(list)
        self._left: dict[int, int] = {}
        self._solid: dict[int, list[Any]] = defaultdict(list)
        self._flat: dict[int, list[Any]] = defaultdict(list)
        self._flat_topic = '' if plan is None else plan.boxes_2d
        if plan is None:
            return
        for number, indices in enumerate(frames.label_indices, first):
            for index in indices:
                self._due[plan.topic, index].append(number)
            self._left[number] = len(indices)
        for number, indices in enumerate(frames.indices_2d, first):
            # Boxes in the image alone do not make a frame's labels where the others are missing.
            if self._left.get(number):
                for index in indices:
                    self._due[plan.boxes_2d, index].append(number)
                self._left[number] += len(indices)

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return {topic for topic, _ in self._due}

    def frames_of(self, topic: str, index: int) -> Sequence[int]:
        """Return the numbers of the frames that a message belongs to."""
        return self._due.get((topic, index), ())

    def take(
        self,
        topic: str,
        index: int,
        message: Any,  # noqa: ANN401 - of the bag's types
    ) -> list[tuple[int, list[Any], list[Any]]]:
        """Enter a message, None for one that cannot be decoded.

        Returns:
            The frames that are complete by it: number, messages with boxes, and those with boxes in
            the image. A frame of which no message could be decoded is left out.
        """
        complete = []
        for number in self.frames_of(topic, index):
            self._left[number] -= 1
            if message is not None and topic == self._flat_topic:
                self._flat[number].append(message)
            elif message is not None:
                self._solid[number].append(message)
            if not self._left[number]:
                solid, flat = self._solid.pop(number, []), self._flat.pop(number, [])
                if solid:
                    complete.append((number, solid, flat))
        return complete

    def rest(self) -> list[tuple[int, list[Any], list[Any]]]:
        """Return the frames of which some messages were read, as take does."""
        incomplete = [
            (number, solid, self._flat.get(number, []))
            for number, solid in sorted(self._solid.items())
        ]
        self._solid.clear()
        return incomplete


def merge_markers(messages: Sequence[Any]) -> Sequence[Any]:
    """Return messages of one stamp; MarkerArrays become one with all markers, in their order.

    These have no frame of their own, and one may delete the markers of another.
    """
    if len(messages) == 1 or not hasattr(messages[0], 'markers'):
        return messages
    return [_Markers([marker for message in messages for marker in message.markers])]


class _Markers:
    """A MarkerArray."""

    def __init__(self, markers: list[Any]) -> None:
        self.markers = markers


# Messages with 3D boxes, or with label lines -> KITTI's labels.

OTHER_CAMERA = 'in the pixels of another camera'
LEANING = 'that lean by more than 45 degrees from the axis that labels turn about'
_LOST = {ABSURD: ' (NaN, a size of 0 or less, or beyond 100 km)', UNPLACED: '', LEANING: ''}
"""Reasons for which boxes are lost, with what is added to each; the others are by the plan."""

_FLAT = 'without a 3D box, which tracklets have no place for,'
_REPORTED_LEAN_RAD, _MOST_LEAN_RAD = np.radians((3, 45))


class BoxConversion:
    """Converts the messages of a plan's labels, in order: tracks are numbered as they appear.

    Attributes:
        left_out: Number of boxes without a label so far, by reason.
        upright: The frame in which the boxes are upright.
    """

    def __init__(
        self,
        rig: PlannedRig,
        calibrations: Calibrations,
        images: ImageConversion,
        base: MovingBase | None,
    ) -> None:
        """Check the options of labels.

        Args:
            rig: The rig of the plan.
            calibrations: The calibrations of all frames.
            images: Knows the sizes of images.
            base: The frame that boxes are brought to; None without scans and cameras.

        Raises:
            UsageError: The plan names a missing topic, or its labels cannot be made.
        """
        plan, survey = rig.plan, rig.survey
        self._plan = plan
        self._tree = rig.tree
        self._calibrations = calibrations
        self._images = images
        self._base = base or MovingBase('', Transform.identity())
        self.left_out: Counter[str] = Counter()
        self._flat_absurd = 0
        self._max_lean = 0.0
        self.upright = self._find_upright()
        self._tracks = TrackIds()
        labels = plan.labels
        self._only_flat = (
            labels is not None and topic_of(survey, labels.topic).msgtype == types.DETECTIONS_2D
        )
        self._scores = self._check(survey, placed=base is not None)
        self._pixel_frames: Container[str] = ()
        if labels is not None and labels.camera in plan.cameras:
            self._pixel_frames = PixelFrames(survey, rig.tree, plan.cameras[labels.camera])
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
            topic = topic_of(survey, plan.boxes_2d)
            if topic.msgtype != types.DETECTIONS_2D or self._only_flat or plan.topic == LABEL_LINES:
                raise UsageError(
                    f'labels.boxes_2d: {plan.boxes_2d} is a {topic.msgtype}; expected a'
                    f' Detection2DArray beside a topic with 3D boxes'
                )
        return any(has_scores(message) for message in topic_of(survey, plan.topic).samples)

    def _find_upright(self) -> UprightFrame:
        """Return the frame in which boxes are upright, by the robot's body where the tree has it.

        Those that become tracklets are placed in a camera that is level in velo_link.
        """
        body = find_body(self._tree, [self._base.frame])
        axes = None if body is None else body.axes_of(self._tree, self._base.frame)
        up = None if axes is None else self._base.velo_T_frame.rotation @ axes[2]
        labels = self._plan.labels
        lines = labels is not None and labels.topic == LABEL_LINES
        in_scans = self._plan.layout.traits.tracklets and not lines
        return UprightFrame(NOMINAL_CAM0_T_VELO if in_scans else None, up)

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
            cuboids = [replace(cuboid, class_name=find(cuboid.class_name)) for cuboid in cuboids]
        cuboids = self._with_levels(cuboids, messages)
        lean = lean_angles(cuboids, calibration, self.upright)
        cuboids = [cuboids[index] for index in np.flatnonzero(lean <= _MOST_LEAN_RAD)]
        self.left_out[LEANING] += len(lean) - len(cuboids)
        self._max_lean = max([self._max_lean, *lean[lean <= _MOST_LEAN_RAD]])
        boxes, unseen = make_boxes(
            cuboids,
            calibration,
            ImageOf(plan.camera, size),
            self._tracks,
            out_of_view=plan.out_of_view,
            occluded=plan.occluded,
            upright=self.upright,
        )
        self.left_out.update(left_out)
        self.left_out[OUT_OF_VIEW] += unseen
        boxes = self._joined(boxes, flat, size) if flat else boxes
        self._occlusions.update(box.occluded for box in boxes)
        return boxes

    def _with_levels(self, cuboids: list[Cuboid], messages: Sequence[Any]) -> list[Cuboid]:
        """Give boxes that to-bag made of tracklets their occlusion and level of truncation.

        Labels of the object layout have the part outside of the image in place of a level.
        """
        if not self._tracklets:
            return cuboids
        levels = not self._plan.layout.traits.frame_set
        tracklets = self._tracklets.get(stamp_of_boxes(messages[0]), {})
        completed = []
        for cuboid in cuboids:
            own = _tracklet_of(cuboid, tracklets)
            if own is None:
                completed.append(cuboid)
                continue
            self._unset += own.occluded is None
            truncation = own.truncation if levels else None
            completed.append(replace(cuboid, occluded=own.occluded, truncation=truncation))
        return completed

    def all_cuboids(
        self, messages: Sequence[Any], times: BoxTimes | None = None
    ) -> tuple[list[Cuboid], list[str]]:
        """Decode the messages of a stamp as cuboids does, each box once.

        Raises:
            ValueError: None of them can be read.
        """
        decoded, left_out, faults = [], list[str](), []
        for message in messages:
            try:
                cuboids, reasons = self.cuboids(message, times)
            except ValueError as error:
                faults.append((error, message))
                continue
            decoded.append(cuboids)
            left_out += reasons
        if faults and not decoded:
            raise faults[0][0]
        left_out += [UNPLACED] * sum(box_count(message) for _, message in faults)
        cuboids_once, repeated = join_cuboids(decoded)
        return cuboids_once, left_out + repeated

    def _joined(self, boxes: list[Box], flat: Sequence[Any], size: tuple[int, int]) -> list[Box]:
        """Give labels the 2D boxes of a detector; those without a 3D box become labels, too."""
        plan = self._plan.labels
        if plan is None:
            return boxes
        decoded = [boxes_of_detections_2d(message) for message in flat]
        image_boxes, left_out = join_image_boxes([message_boxes for message_boxes, _ in decoded])
        left_out += [reason for _, reasons in decoded for reason in reasons]
        self._flat_absurd += left_out.count(ABSURD)
        self.left_out.update(reason for reason in left_out if reason != ABSURD)
        model = self._images.model(plan.camera)
        own_boxes = [
            box
            for box in image_boxes
            if model is None or not box.frame or box.frame in self._pixel_frames
        ]
        if self._classes is not None:
            find = self._classes.find
            own_boxes = [box._replace(class_name=find(box.class_name)) for box in own_boxes]
        self.left_out[OTHER_CAMERA] += len(image_boxes) - len(own_boxes)
        if model is not None and self._plan.cameras[plan.camera].rectify:
            own_boxes = rectified_boxes(own_boxes, model)
        labels, unseen = join_boxes(
            boxes, own_boxes, size, self._tracks, occluded=plan.occluded, scores=self._scores
        )
        self.left_out[OUT_OF_VIEW] += unseen
        if self._plan.layout.traits.tracklets:
            solid = [box for box in labels if box.size_hwl[0] > 0]
            self.left_out[_FLAT] += len(labels) - len(solid)
            return solid
        return labels

    def _lines(self, text: str) -> list[Box]:
        boxes = boxes_of_lines(text, self._tracks)
        if self._classes is None or not self._plan.labels or not self._plan.labels.classes:
            return boxes
        find = self._classes.find
        return [replace(box, class_name=find(box.class_name)) for box in boxes]

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
        lookup = FramesAt(self._to_velo, self._base, times or BoxTimes(stamp_of_boxes(message)))
        return cuboids_in(message, lookup, scores=self._scores)

    def notes(self) -> list[str]:
        """Return notes on the boxes so far."""
        notes = [
            f'{count} boxes {reason} were left out of the labels'
            for reason, count in self.left_out.items()
            if count and reason not in _LOST
        ]
        if self._tracks.unnamed and self._plan.layout.traits.common_labels:
            notes.append(f'{self._tracks.unnamed} boxes have no id: each is a track of its own')
        if self._tracks.repeated and self._plan.layout.traits.common_labels:
            notes.append(
                f'{self._tracks.repeated} boxes have the id of another one of their message: each'
                f' is a track of its own'
            )
        if self._max_lean > _REPORTED_LEAN_RAD:
            axis = "the camera's y" if self.upright.frame_T_velo is None else "the scans' z"
            notes.append(
                f'boxes lean by up to {np.degrees(self._max_lean):.0f} degrees from {axis} axis,'
                f' about which alone labels turn: their heading was kept'
            )
        notes += self._occlusion_notes()
        return notes if self._classes is None else [*notes, *self._classes.notes()]

    def _occlusion_notes(self) -> list[str]:
        """Return notes on labels that evaluations leave out, and on levels of tracklets."""
        plan = self._plan.labels
        if plan is None or self._plan.layout.traits.tracklets:
            return []
        notes = []
        if self._tracklets and self._occlusions[FULLY_OCCLUDED]:
            notes.append(
                f'{plan.topic}: {self._occlusions[FULLY_OCCLUDED]} boxes are fully occluded in the'
                f' tracklets; labels have no such level, and contain 2, largely'
            )
        if self._unset:
            notes.append(
                f'{plan.topic}: {self._unset} boxes have no occlusion in the tracklets; labels'
                f' contain {plan.occluded}, as labels.occluded of the plan says'
            )
        unknown = self._occlusions[UNKNOWN_OCCLUSION]
        if unknown:
            notes.append(
                f'{plan.topic}: {unknown} labels contain occlusion 3, unknown, as labels.occluded'
                f' of the plan says: evaluations leave them out; 0 has them counted'
            )
        return notes

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


def _tracklet_of(cuboid: Cuboid, tracklets: Mapping[int, Cuboid]) -> Cuboid | None:
    """Return the tracklet of a box among those of its frame; DetectedObjects have no track."""
    track_id = own_number(cuboid.identity)
    if track_id is not None:
        return tracklets.get(track_id)
    position = cuboid.velo_T_box.translation
    return next(
        (
            tracklet
            for tracklet in tracklets.values()
            if np.linalg.norm(tracklet.velo_T_box.translation - position) < _SAME_POSITION_M
        ),
        None,
    )
