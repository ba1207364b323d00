# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""vision_msgs/Detection3DArray and Detection2DArray -> boxes with class, id and colour.

vision_msgs before version 4 has other names for some fields; both are supported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from ..drawing.palette import PREDICTION_COLOR, rgb_of
from ..messages.topics import prediction_topics
from ..model.boxes import DONT_CARE
from ..model.msgtypes import DETECTIONS_3D
from .entities import Converter, EntityUpdate, entity_path, image_frame
from .program_survey import frame_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from ..model.geometry import Float64Array

_DONT_CARE_RGB = (120, 120, 120)


class Box3DConverter(Converter):
    """The boxes of a Detection3DArray topic."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update, also without boxes: it removes those of the last message."""
        boxes = [each.bbox for each in message.detections]
        names = [_class_and_score(each) for each in message.detections]
        components = rr.Boxes3D(
            centers=rows_of(each.center.position for each in boxes),
            sizes=rows_of(each.size for each in boxes),
            quaternions=unit_quaternions(each.center.orientation for each in boxes),
            colors=_class_colors(self.topic, names),
            labels=_labels(message.detections, names),
            fill_mode=rr.components.FillMode.MajorWireframe,
        )
        yield EntityUpdate(self.path, [components], _frame_of(message))


class Box2DConverter(Converter):
    """The boxes of a Detection2DArray topic, over the images of their camera."""

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield one update for each of those images, or a single one if there is none."""
        survey = self.context.survey
        boxes = [each.bbox for each in message.detections]
        centers = [getattr(each.center, 'position', each.center) for each in boxes]
        names = [_class_and_score(each) for each in message.detections]
        components = rr.Boxes2D(
            centers=rows_of(centers, ('x', 'y')),
            sizes=rows_of(boxes, ('size_x', 'size_y')),
            colors=_class_colors(self.topic, names),
            labels=_labels(message.detections, names),
            # With 3D boxes the same objects already have labels.
            show_labels=not survey.of_type(DETECTIONS_3D),
        )
        frame = _frame_of(message)
        images = survey.images_in(frame)
        for image in images:
            path = entity_path(image, *self.topic.strip('/').split('/'))
            yield EntityUpdate(path, [components], image_frame(image))
        if not images:
            yield EntityUpdate(self.path, [components], frame)


def rows_of(messages: Iterable[Any], fields: Sequence[str] = ('x', 'y', 'z')) -> Float64Array:
    """Return (N, len(fields)) numbers of N messages with these fields."""
    rows = [[getattr(each, name) for name in fields] for each in messages]
    return np.array(rows, np.float64).reshape(-1, len(fields))


def unit_quaternions(turns: Iterable[Any]) -> list[rr.Quaternion]:
    """Normalise geometry_msgs/Quaternion; zeros become the identity."""
    rows = rows_of(turns, ('x', 'y', 'z', 'w'))
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.where(lengths > 0, rows / np.where(lengths > 0, lengths, 1), (0.0, 0.0, 0.0, 1.0))
    return [rr.Quaternion(xyzw=row) for row in rows]


def _frame_of(message: Any) -> str:  # noqa: ANN401 - a rosbags class
    """Return the frame of an array, or if it is empty that of the first detection."""
    headers = [message.header, *(each.header for each in message.detections[:1])]
    return next((name for each in headers if (name := frame_name(each.frame_id))), '')


def _class_and_score(detection: Any) -> tuple[str, float]:  # noqa: ANN401 - a rosbags class
    """Return those of the best hypothesis, the first of equals; ('', 1) without any."""
    hypotheses = [getattr(each, 'hypothesis', each) for each in detection.results]
    if not hypotheses:
        return '', 1.0
    best = max(hypotheses, key=lambda each: each.score)
    return str(best.class_id if hasattr(best, 'class_id') else best.id), float(best.score)


def _labels(detections: list[Any], names: list[tuple[str, float]]) -> list[str]:
    labels = []
    for detection, (class_name, score) in zip(detections, names, strict=True):
        words = [class_name, getattr(detection, 'id', ''), '' if score == 1.0 else f'{score:.2f}']
        labels.append(' '.join(word for word in words if word))
    return labels


def _class_colors(topic: str, names: list[tuple[str, float]]) -> list[tuple[int, int, int]]:
    """Return the colours of classes, or of predictions: red, green, blue, 0..255."""
    if topic in prediction_topics():
        return [PREDICTION_COLOR] * len(names)
    return [
        _DONT_CARE_RGB if class_name == DONT_CARE else rgb_of(class_name) for class_name, _ in names
    ]
