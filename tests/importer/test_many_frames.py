# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A plan costs as much as a bag has frames and topics, not as their product.

Bags of many robots have thousands of frames, and hostile ones of a few kB as well.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from counted_calls import calls_of
from surveyed import at, cloud, image, info, topic

from kitti_ros2.importer.guess import guess_plan, unused_notes
from kitti_ros2.importer.survey import Survey
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout

if TYPE_CHECKING:
    from kitti_ros2.importer.survey import TopicSurvey

UP = Transform.from_translation((0.0, 0.0, 1.0))
NOWHERE = Transform.from_translation((np.nan, 0.0, 0.0))
SENSORS = [
    cloud('/points', frame='velo'),
    image('/cam/image', frame='cam'),
    info('/cam/camera_info', 'cam'),
]
RIG = [('base', 'velo', UP), ('base', 'cam', UP)]


def odometry(number: int) -> TopicSurvey:
    vector = SimpleNamespace(x=0.0, y=0.0, z=0.0)
    twist = SimpleNamespace(twist=SimpleNamespace(linear=vector, angular=vector))
    look = SimpleNamespace(child_frame_id=f'f{number}', twist=twist, pose=at(0.0))
    return topic(f'/odom{number}', types.ODOMETRY, look, frame=f'o{number}')


def boxes_2d(number: int) -> TopicSurvey:
    return topic(f'/boxes{number}', types.DETECTIONS_2D, frame=f'f{number}')


def survey_of(kind: str, size: int) -> Survey:
    star = [*RIG, *(('base', f'f{number}', UP) for number in range(size))]
    static = {
        'star': star,
        'robots': [(f'n{number}/base_link', f'n{number}/x', UP) for number in range(size)],
        'robots of NaN': [
            (f'n{number}/base_link', f'n{number}/x', NOWHERE) for number in range(size)
        ],
        'trees': [(f'n{number}', f'm{number}', UP) for number in range(size)],
        'parents': [(f'n{number}', 'velo', UP) for number in range(size)],
        'chain': [(f'f{number}', f'f{number + 1}', UP) for number in range(size)],
        'circle': [(f'f{number}', f'f{(number + 1) % size}', UP) for number in range(size)],
    }.get(kind, star)
    more = {
        'odometry': [odometry(number) for number in range(size)],
        'clouds': [cloud(f'/points{number}', frame=f'f{number}') for number in range(size)],
        'boxes': [boxes_2d(number) for number in range(size)],
        'cameras': [
            each
            for number in range(size)
            for each in (
                image(f'/c{number}/image', frame=f'f{number}'),
                info(f'/c{number}/camera_info', f'f{number}'),
            )
        ],
        'infos': [info(f'/c{number}/camera_info', f'f{number}') for number in range(size)],
    }.get(kind, [])
    return Survey({each.name: each for each in [*SENSORS, *more]}, static, [])


def calls_for(survey: Survey) -> int:
    """Return how many functions a plan calls."""

    def plan() -> None:
        with suppress(KittiRos2Error):
            unused_notes(survey, guess_plan(survey, Layout.RAW, Path('bag.mcap')).plan)

    return calls_of(plan)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'kind',
    [
        'star',
        'robots',
        'robots of NaN',
        'trees',
        'parents',
        'chain',
        'circle',
        'odometry',
        'clouds',
        'boxes',
        'cameras',
        'infos',
    ],
)
def test_twice_the_frames_cost_twice(kind):
    few, many = calls_for(survey_of(kind, 200)), calls_for(survey_of(kind, 400))
    assert many < 2.3 * few
