# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topic of the labels."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.detections import boxes_of_detections_2d
from ..messages.solid_boxes import boxes_in
from ..messages.source import LABEL_LINES
from ..messages.topics import own_topics, prediction_topics
from ..model import msgtypes as types
from ..model.class_names import OTHERS, kitti_class
from .guess_cameras import main_camera
from .guess_names import is_truth
from .label_classes import default_classes, is_own, others_note, others_of
from .pixel_frames import PixelFrames
from .plan import LabelPlan
from .report import pass_over

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.layouts import Layout
    from ..rig.tf_tree import FrameTree
    from .plan import CameraPlan
    from .survey import Survey
    from .topic_survey import TopicSurvey


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
    markers = [each for each in _of_labels(survey, types.MARKERS) if has_cubes(each)]
    kinds = [detections, *([markers, objects] if survey.calibrations else [objects, markers])]
    flat = _of_camera(survey, tree, cameras)
    solid = [each for kind in kinds for each in kind]
    topics = solid or ([] if layout.traits.tracklets else flat)
    if not topics or not cameras:
        notes.append(
            'missing: labels (no Detection3DArray, TrackedObjects or DetectedObjects, no cubes'
            ' in a MarkerArray)'
        )
        return None
    # Of equal topics the first kind is taken.
    order = {each.name: -place for place, kind in enumerate(kinds) for each in kind}
    best = max(topics, key=lambda each: _rank(each, order, tracks=layout.traits.common_labels))
    topics = [each for each in topics if each.msgtype == best.msgtype]
    notes += pass_over('labels', best, topics)
    boxes_2d = ''
    if flat and best not in flat:
        nearest = max(flat, key=lambda each: _rank(each, {}, tracks=False))
        notes += pass_over('2D boxes of labels', nearest, flat)
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
"""Of length, width and height of what drives or walks; a tram of KITTI is 35 m long."""


def _rank(
    topic: TopicSurvey, order: Mapping[str, int], *, tracks: bool
) -> tuple[bool, bool, bool, bool, bool, int, int, int]:
    """Rank: of sane sizes, ground truth, of known classes, with tracks and classes, of most."""
    sane, known, boxes = _plausible(topic)
    return (
        sane,
        is_truth(topic.name),
        known,
        tracks and topic.has_tracks,
        any(topic.classes),
        order.get(topic.name, 0),
        boxes,
        topic.count,
    )


def _plausible(topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Whether most boxes have a size of things on a road, and a class but Misc; how many."""
    sizes, names = [], []
    for look in topic.looks:
        if topic.msgtype == types.DETECTIONS_2D:
            names += [each.class_name for each in boxes_of_detections_2d(look)[0]]
            continue
        with suppress(ValueError):
            boxes = boxes_in(look)
            sizes += [each.size_lwh for each in boxes]
            names += [each.class_name for each in boxes]
    names = [*topic.classes.elements()] or names
    sane = sum(min(size) > _LEAST_M and bool((np.array(size) <= _MOST_M).all()) for size in sizes)
    known = sum(kitti_class(name) not in {None, OTHERS} for name in names)
    return bool(names) and 2 * sane >= len(sizes), 2 * known > len(names), len(names)


def _of_camera(
    survey: Survey, tree: FrameTree, cameras: dict[int, CameraPlan]
) -> list[TopicSurvey]:
    """Return the topics of 2D boxes in the pixels of the labels' camera."""
    if not cameras:
        return []
    frames = PixelFrames(survey, tree, cameras[main_camera(cameras)])
    found = _of_labels(survey, types.DETECTIONS_2D)
    return [each for each in found if each.frame in frames and each.name not in own_topics()]


def _of_labels(survey: Survey, msgtype: str) -> list[TopicSurvey]:
    """Return the topics of a type without those of predictions by to-bag."""
    found = survey.of_type(msgtype)
    return [each for each in found if each.name not in prediction_topics()]


def has_cubes(topic: TopicSurvey) -> bool:
    """Whether a MarkerArray that was looked at has a cube."""
    cube = 1  # visualization_msgs/Marker.CUBE
    return any(marker.type == cube for look in topic.looks for marker in look.markers)
