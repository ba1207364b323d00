# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topic of the labels."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ..messages.source import LABEL_LINES
from ..messages.topics import own_topics, prediction_topics
from ..model import msgtypes as types
from .guess_cameras import main_camera
from .guess_names import is_truth
from .label_classes import default_classes, is_own, others_note, others_of
from .pixel_frames import PixelFrames
from .plan import LabelPlan
from .report import pass_over

if TYPE_CHECKING:
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

    Those with tracks go before others in a layout that has tracks. In a bag written by to-bag,
    markers have the classes of KITTI, and objects have not. Tracklets have no 2D boxes.
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
    if layout.traits.common_labels:
        kinds.sort(key=lambda kind: not any(each.has_tracks for each in kind))
    topics = next(filter(None, kinds), [])
    flat = _of_camera(survey, tree, cameras)
    topics = topics or ([] if layout.traits.tracklets else flat)
    if not topics or not cameras:
        notes.append(
            'missing: labels (no Detection3DArray, TrackedObjects or DetectedObjects, no cubes'
            ' in a MarkerArray)'
        )
        return None
    best = max(topics, key=partial(_rank, tracks=layout.traits.common_labels))
    notes += pass_over('labels', best, topics)
    boxes_2d = ''
    if flat and best not in flat:
        nearest = max(flat, key=lambda each: (is_truth(each.name), each.count))
        notes += pass_over('2D boxes of labels', nearest, flat)
        boxes_2d = nearest.name
    plan = LabelPlan(best.name, main_camera(cameras), boxes_2d=boxes_2d)
    if is_own(survey, best.name):
        return plan
    notes += others_note(best.name, others_of(best.classes), 'of those looked at are written')
    return replace(plan, classes=default_classes(best.classes))


def _rank(topic: TopicSurvey, *, tracks: bool) -> tuple[bool, bool, bool, int]:
    """Rank: called ground truth, with tracks where they are wanted, with classes, of most."""
    return (
        is_truth(topic.name),
        tracks and topic.has_tracks,
        any(topic.classes),
        topic.count,
    )


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
