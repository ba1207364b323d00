# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: surveys of bags of any program, the plans made of them, and plans as users edit them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import foreign
import numpy as np
import yaml

from kitti_ros2.importer.apply_plan import adapt, convert, guess
from kitti_ros2.importer.guess import unused_notes
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.survey import survey_bags, survey_sensors
from kitti_ros2.kitti.store import decode_text
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

from .bag_targets import RECORD_WORDS
from .inputs import found
from .message_inputs import Messages
from .own_bag_inputs import own_bags
from .target import YAML_WORDS, Target, place, stored
from .yaml_targets import BOMBS

from bags.bag_samples import jazzy  # isort: skip
from stored_messages import Stored, make_mcap, messages_of  # isort: skip

if TYPE_CHECKING:
    from kitti_ros2.importer.survey import Survey

PATH = Path('folder/plan.yaml')
_IMAGE = '/cam/left/image_raw'
_PICTURE = '/cam/right/image_rect/compressed'
_DAMAGED = ('/sensors/ouster/points', _IMAGE, '/perception/objects')


def _survey(data: bytes) -> None:
    """Make the plan of each layout, with the options that change it."""
    path = stored('survey.mcap', data)
    survey_sensors(path)
    survey = survey_bags([path])
    for topic in survey.topics.values():
        [*topic.stamp_notes()]
        _ = topic.has_own_stamps, topic.frame_id
    options = [ImportOptions(layout=layout) for layout in (*Layout, None)]
    options += [ImportOptions(layout=Layout.OBJECT, all_cameras=True)]
    options += [ImportOptions(layout=Layout.OBJECT, calib=Path('calib'), name='a')]
    for each in options:
        with suppress(KittiRos2Error):
            guess([path], survey, each)


def _surveyed() -> list[bytes]:
    return [*own_bags(), *(make_mcap(messages) for messages in _robots())]


def _robots() -> list[list[Stored]]:
    """What another robot records: all, and parts of it that make poorer plans."""
    every = [each for each in messages_of(_bag()[0]) if each[0] != _IMAGE]
    parts = (('points',), ('odom',), ('camera_info', 'compressed'), ('compressed',), ('objects',))
    few = [[each for each in every if any(word in each[0] for word in part)] for part in parts]
    cut = [(*each[:3], each[3][:9] if at % 2 else each[3]) for at, each in enumerate(every)]
    none = [(*each[:3], each[3][:9]) for each in every]
    objects = [each for each in every if 'objects' in each[0]]
    again = [(topic, kind, stamp_ns + n, data) for topic, kind, stamp_ns, data in objects
             for n in range(40)]  # fmt: skip
    clouds = Messages(jazzy()).of(types.CLOUD)[3:]
    points = [(f'/points_{at % 5}', types.CLOUD, 10**18 + at, data)
              for at, data in enumerate(clouds)]  # fmt: skip
    return [every, *few, cut, none, again, points, []]


@cache
def _bag() -> tuple[Path, Survey]:
    """A short bag of another program, and its survey."""
    path = place('foreign.mcap')
    if not path.exists():
        foreign.write_foreign(path, foreign.make_truth()[:2])
    return path, survey_bags([path])


@cache
def _damaged_bag() -> tuple[Path, Survey]:
    """The same, with messages that cannot be decoded behind the first ones."""
    path = place('damaged.mcap')

    def change(topic: str, number: int, message: Any) -> Any:
        if number and topic == _PICTURE:
            return replace(message, data=np.zeros(9, np.uint8))
        return (b'\0\1\0\0',) if number and topic in _DAMAGED else message

    foreign.write_foreign(path, foreign.make_truth()[:2], change=change)
    return path, survey_bags([path])


def _plan(data: bytes) -> None:
    plan = parse_plan(decode_text(data, PATH), PATH)
    format_plan(plan)
    for options in _OPTIONS:
        with suppress(KittiRos2Error):
            adapt(plan, options)


_OPTIONS = (
    *(ImportOptions(layout=layout) for layout in (Layout.RAW, Layout.OBJECT)),
    ImportOptions(name='a', calib=Path('calib'), origin='49,8,100'),
    *(ImportOptions(append=True), ImportOptions(all_cameras=True)),
)


def _plan_applied(data: bytes) -> None:
    plan = parse_plan(decode_text(data, PATH), PATH)
    path, survey = _bag()
    options = ImportOptions(overwrite=True, fsync=False)
    plan = adapt(plan, options)
    unused_notes(survey, plan)
    out = place('planned')
    rmtree(out, ignore_errors=True)
    convert([path], plan, survey, out, options)
    with suppress(KittiRos2Error):
        convert([path], plan, survey, out, replace(options, overwrite=False, append=True))
    path, survey = _damaged_bag()
    convert([path], plan, survey, out, options)


@cache
def _plans() -> list[bytes]:
    path, survey = _bag()
    options = [ImportOptions(layout=layout) for layout in Layout if layout.traits.from_others]
    options.append(ImportOptions(layout=Layout.OBJECT, all_cameras=True))
    made = [guess([path], survey, each) for each in options]
    return [format_plan(each.plan, each.notes).encode() for each in made]


_LABELS = {'topic': '/perception/objects'}
_SCAN = {'topic': '/sensors/ouster/points', 'frame': 'os_sensor'}
_SETS = {'CAM_A': {'topic': '/cam/left/image_raw'}, 'CAM_B': {'topic': '/cam/left/image_raw'}}
_EDITS: tuple[dict[str, Any], ...] = (
    *({'labels': {**_LABELS, 'classes': classes}} for classes in (
        {'car': 'Van', 7: 'cyclist'}, ['car'], {'a': 1}, {'car': 'Cart'}, {'a': 'b c'},
        {1.5: 'Car'},
    )),
    {'labels': {**_LABELS, 'keep_classes': True, 'classes': {'car': 'forklift'}}},
    *({'labels': {**_LABELS, 'occluded': value}} for value in (0, 7, 'x')),
    *({'scan': {**_SCAN, **values}} for values in (
        {'from': 'clouds'}, {'from': 'depth'}, {'model': 'VLP-61'}, {'minimum_range_m': -1},
        {'minimum_range_m': 2.5}, {'intensity_scale': 0}, {'offset_s': 1e12}, {'forward': '-x'},
        {'forward': 'camera'}, {'intensity_scale': 10**400}, {'offset_s': 0.05}, {'other': 1},
    )),
    *({'tolerance_s': value} for value in (-1, 0, '.inf', 1e9, 10**400, 'x', True)),
    *({'origin': value} for value in ('49,8,100', '99,8', 'x')),
    *({'cameras': value} for value in ({9: {}}, [1], {2: {'topic': 1}}, {2: {}}, {})),
    {'cameras': {2: {'topic': '/none'}}, 'labels': {'topic': '/none'}},
    *({'camera_sets': value} for value in ([1], {'a b': {}}, {'a': {}, 'A': {}}, _SETS)),
    *({'camera_sets': _SETS, 'cameras': {}, 'calibration': value} for value in ('tf', 'none')),
    *({'layout': 'kitti'}, {'incomplete': 'keep'}, {'stamps': 'log'}, {'stamps': 3}, {'name': 7}),
    *({'reference': 'image_2'}, {'reference': 'pose'}, {'scan': None}, {'imu_frame': 'x'}),
    *({'calibration': 'none'}, {'calibration': '/nowhere'}, {'calibration': 'source'}),
)  # fmt: skip
"""Changes of a plan: right ones, and mistakes of each kind."""


def _plan_inputs() -> list[bytes]:
    texts = [yaml.safe_load(_plans()[at]) for at in (1, 0)]  # of layouts object and raw
    edited = [yaml.safe_dump(texts[0] | edit).encode() for edit in _EDITS]
    edited += [yaml.safe_dump(texts[1] | {'stamps': 'log', 'imu_offset_s': 0.5}).encode()]
    return [*_plans(), *edited, *BOMBS, *found('bombs/plan_*.yaml')]


TARGETS = (
    Target('survey', _survey, _surveyed,
           ('importer/survey.py', 'importer/guess.py', 'importer/apply_plan.py'),
           RECORD_WORDS, short=5),
    Target('plan', _plan, _plan_inputs,
           ('importer/plan.py', 'importer/apply_plan.py'),
           YAML_WORDS, is_text=True, short=90, long=100_000),
    Target('plan_applied', _plan_applied, _plan_inputs,
           ('importer/apply_plan.py', 'importer/set_builder.py'),
           YAML_WORDS, is_text=True, short=15),
)  # fmt: skip
"""All of them."""
