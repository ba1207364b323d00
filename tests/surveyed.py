# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Topics as a survey has them, without a bag."""

from __future__ import annotations

from array import array
from types import SimpleNamespace

import numpy as np

from kitti_ros2.importer.survey import TopicSurvey
from kitti_ros2.model import bag_formats as types

K = np.array([[700.0, 0, 600], [0, 700, 180], [0, 0, 1]])


def topic(name, msgtype, *samples, frame='', count=5):
    stamps = [(index + 1) * 100_000_000 for index in range(count)]
    survey = TopicSurvey(name, msgtype, stamps, list(stamps), {frame: count}, list(samples))
    if msgtype == types.FIX:
        survey.positions = array('d', (49.0, 8.4, 110.0) * survey.count)
    return survey


def at(x):
    """A PoseWithCovariance at some x, metres."""
    return SimpleNamespace(pose=SimpleNamespace(position=SimpleNamespace(x=x, y=0.0, z=0.0)))


def image(name, encoding='bgr8', frame=''):
    return topic(name, types.IMAGE, SimpleNamespace(encoding=encoding), frame=frame)


def compressed(name, form='png', frame=''):
    return topic(name, types.COMPRESSED, SimpleNamespace(format=form), frame=frame)


def info(name, frame='', d=(), model='plumb_bob'):
    message = SimpleNamespace(
        width=0,
        height=0,
        k=K.ravel(),
        d=np.array(d, float),
        r=np.eye(3).ravel(),
        p=np.column_stack([K, np.zeros(3)]).ravel(),
        distortion_model=model,
    )
    return topic(name, types.CAMERA_INFO, message, frame=frame)


def cloud(name, *fields, frame='lidar', width=100, count=5):
    names = ('x', 'y', 'z', *fields)
    parts = [SimpleNamespace(name=name, offset=0, datatype=7, count=1) for name in names]
    sample = SimpleNamespace(fields=parts, width=width, height=1)
    # Too short to be read: without intensity.
    sample.__dict__.update(point_step=4, row_step=0, is_bigendian=False, data=np.zeros(0, np.uint8))
    return topic(name, types.CLOUD, sample, frame=frame, count=count)
