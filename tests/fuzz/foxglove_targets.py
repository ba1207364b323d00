# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: messages in schemas of Foxglove."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path

from kitti_ros2.bags.foxglove_channels import FoxgloveChannel, translator
from kitti_ros2.bags.pieces import StoredChannel
from kitti_ros2.messages.foxglove_messages import TRANSLATIONS
from kitti_ros2.messages.ros_types import TYPESTORE

from .target import Target


def _foxglove(data: bytes) -> None:
    name, _, text = data.partition(b'\n')
    schema = name.decode('latin-1')
    if schema not in TRANSLATIONS:
        return
    channel = StoredChannel('/t', f'foxglove.{schema}', 'json')
    made = FoxgloveChannel('/t', TRANSLATIONS[schema].msgtype, 'cdr', original=channel)
    with suppress(ValueError):
        translator(made, lambda: TYPESTORE)(text, 1)


def _foxglove_inputs() -> list[bytes]:
    # Where pytest finds it only if tests of that folder run, too.
    sys.path.append(str(Path(__file__).resolve().parents[1] / 'robots'))
    import foxglove_robot as robot  # noqa: PLC0415 - as above

    records = robot.records(robot.make_world()[:1])
    found = {schema: values for _, _, schema, values in records}
    made = []
    for schema, values in found.items():
        text = json.dumps(robot._plain(values))
        if len(text) < 20_000:
            made.append(f'{schema}\n{text}'.encode())
    return made


TARGETS = (
    Target('foxglove', _foxglove, _foxglove_inputs,
           ('messages/foxglove_fields.py', 'messages/foxglove_messages.py',
            'messages/foxglove_clouds.py', 'messages/foxglove_scene.py'),
           (b'null', b'[]', b'{}', b'"', b'"AAAA"'), is_text=True),
)  # fmt: skip
"""All of them."""
