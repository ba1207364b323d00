# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: messages in schemas of Foxglove, in JSON, and bags of them in each encoding."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from kitti_ros2.bags.container_file import StoredChannel
from kitti_ros2.bags.stored_messages import (
    TranslatedChannel,
    ros_channel,
    stored_channel,
    translator,
)
from kitti_ros2.messages.foxglove import TRANSLATIONS
from kitti_ros2.messages.ros_types import TYPESTORE

from .bag_targets import COMMON, RECORD_WORDS, reader
from .target import Target, place

_MODULES = (
    'messages/foxglove.py',
    'messages/foxglove_fields.py',
    'messages/foxglove_scene.py',
    'bags/stored_messages.py',
)


def _foxglove(data: bytes) -> None:
    name, _, text = data.partition(b'\n')
    schema = name.decode('latin-1')
    if schema not in TRANSLATIONS:
        return
    channel = StoredChannel('/t', f'foxglove.{schema}', 'json')
    for for_copy in (False, True):
        made = ros_channel(channel, for_copy=for_copy)
        assert isinstance(made, TranslatedChannel)
        assert stored_channel(made) is channel
        with suppress(ValueError):
            translator(made, lambda: TYPESTORE, [].append)(text, 1)


_TIME = {'sec': 1, 'nsec': 2}
_HEAD = {'timestamp': _TIME, 'frame_id': 'a'}
_XYZ = {'x': 1.0, 'y': 2.0, 'z': 3.0}
_POSE = {'position': _XYZ, 'orientation': {'x': 0, 'y': 0, 'z': 0, 'w': 1}}
_COLOR = {'r': 1.0, 'g': 0.5, 'b': 0.0, 'a': 0.5}
_LINE = {'type': 0, 'pose': _POSE, 'thickness': 1.0, 'points': [_XYZ, _XYZ], 'color': _COLOR,
         'colors': [_COLOR], 'indices': [0, 1]}  # fmt: skip
_FIELDS = [{'name': name, 'offset': 4 * at, 'type': 7} for at, name in enumerate('xyzi')]
_OTHERS: tuple[tuple[str, dict[str, Any]], ...] = (
    ('RawImage', {**_HEAD, 'width': 2, 'height': 2, 'encoding': 'mono8', 'step': 2,
                  'data': b'1234'}),
    ('PointCloud', {**_HEAD, 'pose': _POSE, 'point_stride': 16, 'fields': _FIELDS,
                    'data': bytes(32)}),
    ('PosesInFrame', {**_HEAD, 'poses': [_POSE, _POSE]}),
    ('PoseInFrame', {**_HEAD, 'pose': _POSE}),
    ('Odometry', {**_HEAD, 'body_frame_id': 'b', 'pose': _POSE, 'linear_velocity': _XYZ,
                  'angular_velocity': _XYZ, 'pose_covariance': [0.0] * 36}),
    ('LaserScan', {**_HEAD, 'start_angle': -1.0, 'end_angle': 1, 'ranges': [1.0, 2.5],
                   'intensities': [1, 2]}),
    ('SceneUpdate', {'deletions': [{'timestamp': _TIME, 'type': 0, 'id': 'a'},
                                   {'timestamp': _TIME, 'type': 1}],
                     'entities': [{**_HEAD, 'id': 'a', 'lines': [_LINE, {**_LINE, 'type': 2}],
                                   'lifetime': _TIME},
                                  {**_HEAD, 'id': 'b',
                                   'cubes': [{'pose': _POSE, 'size': _XYZ, 'color': _COLOR}]}]}),
)  # fmt: skip
"""What the robot of the tests does not write."""


_TURNED = {**_POSE, 'orientation': {'x': 0, 'y': 0, 'z': 1, 'w': 0}}
_NO_POSE = {'position': _XYZ, 'orientation': {'x': 0, 'y': 0, 'z': 0, 'w': 0}}
_WHOLE = [{'name': name, 'offset': 4 * at, 'type': 5} for at, name in enumerate('xyzi')]
_MISTAKES: tuple[tuple[str, dict[str, Any]], ...] = (
    ('RawImage', {**_HEAD, 'width': 2, 'height': 2, 'encoding': 'mono8', 'step': 200, 'data': b''}),
    *(('RawImage', {**_HEAD, **values}) for values in (
        {'width': -1}, {'height': 1.5}, {'encoding': 7}, {'step': 'a'}, {'data': '%%%'}, {})),
    ('CompressedImage', {**_HEAD, 'data': b'abc', 'format': 'png'}),
    *(('CameraCalibration', {**_HEAD, 'width': 4, 'height': 3, **values}) for values in (
        {}, {'K': [1.0] * 9, 'P': [1.0] * 12, 'R': [1.0] * 9, 'D': [0.1] * 5},
        {'K': [1.0] * 8}, {'K': [[1.0]]}, {'K': ['a']}, {'K': 5})),
    *(('PointCloud', {**_HEAD, 'pose': _TURNED, 'point_stride': 16, 'data': bytes(32), **values})
      for values in ({'fields': _FIELDS}, {'fields': _WHOLE}, {'fields': _WHOLE[:2]},
                     {'fields': 7}, {'fields': [7]})),
    ('PoseInFrame', {**_HEAD, 'pose': _NO_POSE}),
    ('PosesInFrame', {**_HEAD, 'poses': {}}),
    ('LaserScan', {**_HEAD, 'pose': _TURNED, 'ranges': [1.0]}),
    ('SceneUpdate', {'entities': [{**_HEAD, 'lines': [{**_LINE, 'indices': [0, 9]}]}]}),
)  # fmt: skip
"""Values that a message of ROS has no place for, or that are of another type."""


def _robot() -> Any:
    # Where pytest finds it only if tests of that folder run, too.
    sys.path.append(str(Path(__file__).resolve().parents[2] / 'robots'))
    import foxglove_robot as robot  # noqa: PLC0415 - as above

    return robot


def _records() -> list[tuple[str, int, str, dict[str, Any]]]:
    """(topic, log time, schema, fields), without the large messages of the robot."""
    robot = _robot()
    made = robot.records(robot.make_world()[:1])
    found = [each for each in made if len(str(each[3])) < 10_000]
    others = [(f'/{number}', 1, *each) for number, each in enumerate(_OTHERS)]
    return [*found, *others]


def _texts() -> list[bytes]:
    plain = _robot()._plain
    found = {schema: values for _, _, schema, values in _records()}
    found |= dict(_OTHERS)
    every = [*found.items(), *_MISTAKES]
    texts = [f'{schema}\n{json.dumps(plain(values))}'.encode() for schema, values in every]
    return [*texts, b'PoseInFrame\n' + b'[' * 100_000, b'PoseInFrame\n7', b'PoseInFrame\n']


def _bags() -> list[bytes]:
    robot, records = _robot(), _records()
    plain = [each for each in records if each[2] != 'Odometry']
    made = []
    for name, write in (('json', robot.write_json), ('protobuf', robot.write_protobuf)):
        path = place(f'foxglove/{name}.mcap')
        write(path, records if name == 'json' else plain)
        made.append(path.read_bytes())
    folder = place('foxglove/ros')
    if not folder.exists():
        robot.write_foxglove_msgs(folder, [each for each in plain if each[0][1].isalpha()])
    broken = made[1].replace(b'protobuf', b'flatbuff')
    return [*made, broken, *(path.read_bytes() for path in folder.glob('*.mcap'))]


TARGETS = (
    Target('foxglove', _foxglove, _texts, _MODULES, (b'null', b'[]', b'{}', b'"', b'"AAAA"'),
           is_text=True, long=100_000),
    Target('mcap_foxglove', reader('foxglove.mcap'), _bags, (*_MODULES, *COMMON), RECORD_WORDS,
           short=40),
)  # fmt: skip
"""All of them."""
