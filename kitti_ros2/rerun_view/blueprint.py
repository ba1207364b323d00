# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The initial layout of the viewer: space, two cameras with boxes, the map, curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import rerun.blueprint as rrb

from ..messages.topics import prediction_topics
from ..model.msgtypes import DETECTIONS_2D, DETECTIONS_3D, FIX, MARKERS
from .archetypes import VECTORS
from .entities import TIME, entity_path
from .program_survey import IMAGES

if TYPE_CHECKING:
    from .program_survey import ProgramSurvey

_MARKERS = (MARKERS, 'visualization_msgs/msg/Marker')
_FIX = (FIX,)
_MOST_CAMERAS = 2
# Behind and above the vehicle, whose x points forward and z up (REP 103).
_EYE_M = (-14.0, 0.0, 9.0)
_BACKGROUND_RGB = (13, 16, 17)
_LOOK_AT_M = (8.0, 0.0, 0.0)


def make_blueprint(survey: ProgramSurvey) -> rrb.Blueprint:
    """Make the layout for the topics of a program, without empty views."""
    cameras = chosen_cameras(survey)
    columns: list[rrb.Container | rrb.View] = [_space(survey, cameras)]
    views: list[rrb.Container | rrb.View] = [_camera(survey, image) for image in cameras]
    views += _tabs(survey)
    if views:
        columns.append(rrb.Vertical(contents=views))
    return rrb.Blueprint(
        rrb.Horizontal(contents=columns, column_shares=[3, 2][: len(columns)]),
        rrb.TimePanel(timeline=TIME, state='collapsed'),
        rrb.SelectionPanel(state='collapsed'),
        rrb.BlueprintPanel(state='collapsed'),
    )


def chosen_cameras(survey: ProgramSurvey) -> list[str]:
    """Choose at most two image topics, one per camera: with boxes first, then colour images."""
    cameras: dict[str, str] = {}
    for image in survey.of_type(*IMAGES):  # compressed images take a tenth of the memory
        camera = survey.info_of(image) or image.removesuffix('/compressed')
        if camera not in cameras or image.endswith('/compressed'):
            cameras[camera] = image
    boxed = _boxed_images(survey)

    def rank(image: str) -> tuple[bool, bool]:
        return image not in boxed, not ('color' in image or 'rgb' in image)

    return sorted(cameras.values(), key=rank)[:_MOST_CAMERAS]


def _boxed_images(survey: ProgramSurvey) -> set[str]:
    frames = [survey.frames.get(topic) for topic in survey.of_type(DETECTIONS_2D)]
    return {image for frame in frames if frame for image in survey.images_in(frame)}


def _space(survey: ProgramSurvey, cameras: list[str]) -> rrb.View:
    """Make the 3D view from behind the vehicle, with one camera: more would hide each other.

    Detections and markers often are the same boxes: then only the detections are shown, which have
    classes and ids. Of predictions the markers are shown, whose colours are right and wrong.
    """
    hidden = [image for image in survey.of_type(*IMAGES) if image not in cameras[:1]]
    hidden += [topic for topic in survey.of_type(DETECTIONS_3D) if topic in prediction_topics()]
    if survey.of_type(DETECTIONS_3D):
        markers = survey.of_type(*_MARKERS)
        hidden += [topic for topic in markers if topic not in prediction_topics()]
    vehicle = survey.vehicle()
    return rrb.Spatial3DView(
        origin='/',
        name='space',
        contents=['+ /**', *(f'- /{entity_path(topic)}/**' for topic in hidden)],
        spatial_information=rrb.SpatialInformation(target_frame=vehicle or 'tf#/'),
        background=rrb.Background(color=_BACKGROUND_RGB),
        eye_controls=rrb.EyeControls3D(
            position=_EYE_M, look_target=_LOOK_AT_M, eye_up=(0.0, 0.0, 1.0)
        ),
    )


def _camera(survey: ProgramSurvey, image: str) -> rrb.View:
    """Make the view of an image with its boxes; 3D boxes are projected."""
    solid = survey.of_type(DETECTIONS_3D) or survey.of_type(*_MARKERS)
    origin = entity_path(image)
    return rrb.Spatial2DView(
        origin=f'/{origin}',
        name=image,
        contents=['+ $origin/**', *(f'+ /{entity_path(topic)}/**' for topic in solid)],
    )


def _tabs(survey: ProgramSurvey) -> list[rrb.Container | rrb.View]:
    tabs: list[rrb.Container | rrb.View] = [
        rrb.TimeSeriesView(origin=f'/{entity_path(topic, name)}', name=f'{topic} {name}')
        for topic, msgtype in survey.topics.items()
        for name in VECTORS.get(msgtype, ())
    ]
    tabs += [
        rrb.MapView(origin=f'/{entity_path(topic)}', name=topic) for topic in survey.of_type(*_FIX)
    ]
    return [rrb.Tabs(contents=tabs)] if tabs else []
