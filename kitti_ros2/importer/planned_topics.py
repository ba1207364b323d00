# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that a plan names, in the survey of its bags."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..messages.camera_info import camera_model
from ..messages.pixels import size_of
from ..model.errors import UsageError
from ..model.msgtypes import CAMERA_INFO
from ..model.spelling import did_you_mean

if TYPE_CHECKING:
    from ..messages.camera_info import CameraModel
    from .survey import Survey
    from .topic_survey import TopicSurvey


def topic_of(survey: Survey, name: str) -> TopicSurvey:
    """Return the survey of a topic that a plan names.

    Raises:
        UsageError: The bag has no such topic, or it has no messages.
    """
    topic = survey.topics.get(name)
    if topic is None or not topic.count:
        topics = sorted(each.name for each in survey.topics.values() if each.count)
        known = did_you_mean(name, topics) or f'; it has {", ".join(topics)}'
        raise UsageError(
            f'the plan names {name or "an empty topic"}, of which the bag has no message{known}'
        )
    return topic


def camera_of(survey: Survey, name: str) -> CameraModel:
    """Return the camera of the CameraInfo topic that a plan names.

    Raises:
        UsageError: The bag has no such topic, or it has no messages.
        ValueError: It is of another type, or its first message is no valid calibration.
    """
    info = topic_of(survey, name)
    if info.msgtype != CAMERA_INFO or not info.looks:
        reason = info.failure or f'it is a {info.msgtype}'
        raise ValueError(f'no CameraInfo ({reason})')
    return camera_model(info.looks[0])


def image_size(images: TopicSurvey) -> tuple[int, int] | None:
    """Return (width, height) of the first image of a topic whose size is known; None without."""
    return next(filter(None, map(size_of, images.looks)), None)


def of_images(model: CameraModel, images: TopicSurvey) -> CameraModel:
    """Return a camera with the size of its images where its own has width and height swapped.

    The principal point of P tells that it is the size that is wrong, not the image that is turned:
    it is nearer to the middle of the images.
    """
    size = image_size(images)
    if size is None or size == model.size or size != model.size[::-1]:
        return model
    aside, aside_own = (
        float(np.linalg.norm(model.p[:2, 2] - np.array(each) / 2)) for each in (size, model.size)
    )
    return replace(model, size=size) if aside < aside_own else model
