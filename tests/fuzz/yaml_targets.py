# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: YAML files, which are plans and calibrations of scanners; options are in their own."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import foreign

from kitti_ros2.importer.apply_plan import adapt, convert, guess
from kitti_ros2.importer.passed_over import passed_over
from kitti_ros2.importer.plan_text import format_plan, parse_plan
from kitti_ros2.importer.survey import look
from kitti_ros2.kitti.store import decode_text
from kitti_ros2.messages.velodyne_models import parse_lasers
from kitti_ros2.model.layouts import Layout
from kitti_ros2.model.text import shown
from kitti_ros2.model.yaml_text import YamlTextError, load_yaml
from kitti_ros2.options.importing import ImportOptions

from .inputs import found
from .target import YAML_WORDS, Target, place

if TYPE_CHECKING:
    from kitti_ros2.importer.survey import Survey

PATH = Path('folder/file.yaml')
BOMBS = (
    b'a: &a [x, x, x, x]\nb: &b [*a, *a, *a, *a]\nc: &c [*b, *b, *b, *b]\nimages: [*c, *c, *c]\n',
    b'start: ' + b'9' * 5000 + b'\n',
    b'images: ' + b'[' * 5000 + b'\n',
    b'a: &a\n  b: *a\n',
    b'images: raw\nimages: both\n',
    b'split_size: .nan\n1: 2\nstart: 2011-99-99\n',
    b'{[1]: 2}\n',
    b'images: !!binary aaa\n',
    b'a: &a ' + b'[' * 60 + b']' * 60 + b'\nb: ' + b'[' * 60 + b'*a' + b']' * 60,
)
_TEXT = 'model/yaml_text.py'


def _yaml(data: bytes) -> None:
    for kept in ((), ('int', 'timestamp')):
        with suppress(YamlTextError):
            shown(load_yaml(data, kept))


@cache
def _bag() -> tuple[Path, Survey]:
    """A short bag of another program, and its survey."""
    path = place('foreign.mcap')
    if not path.exists():
        foreign.write_foreign(path, foreign.make_truth()[:2])
    return path, look([path])


def _plan(data: bytes) -> None:
    plan = parse_plan(decode_text(data, PATH), PATH)
    format_plan(plan)


def _plan_applied(data: bytes) -> None:
    plan = parse_plan(decode_text(data, PATH), PATH)
    path, survey = _bag()
    options = ImportOptions(overwrite=True)
    plan = adapt(plan, options)
    passed_over(survey, plan)
    convert([path], plan, survey, place('planned'), options)


@cache
def _plans() -> list[bytes]:
    path, survey = _bag()
    made = []
    for layout in Layout:
        options = ImportOptions(layout=layout)
        found_plan = guess([path], survey, options)
        made.append(format_plan(found_plan.plan, found_plan.notes).encode())
    with suppress(Exception):
        options = ImportOptions(layout=Layout.OBJECT, all_cameras=True)
        made.append(format_plan(guess([path], survey, options).plan).encode())
    return made


def _plan_inputs() -> list[bytes]:
    return [*_plans(), *BOMBS, *found('bombs/plan_*.yaml')]


def _lasers(data: bytes) -> None:
    parse_lasers(decode_text(data, PATH), PATH)


_LASERS = b"""lasers:
- {dist_correction: 1.2, dist_correction_x: 1.3, dist_correction_y: 1.3, laser_id: 0,
  rot_correction: -0.07, vert_correction: -0.12, vert_offset_correction: 0.2,
  horiz_offset_correction: 0.02, two_pt_correction_available: true}
- {laser_id: 1, vert_correction: 0.1}
num_lasers: 2
distance_resolution: 0.002
"""

TARGETS = (
    Target('yaml', _yaml,
           lambda: [*_plans()[:1], *BOMBS, *found('bombs/*.yaml'), b'', _LASERS],
           (_TEXT,), YAML_WORDS, is_text=True, long=100_000),
    Target('plan', _plan, _plan_inputs,
           ('importer/plan_text.py', 'importer/plan_classes.py', 'importer/plan_numbers.py'),
           YAML_WORDS, is_text=True, long=100_000),
    Target('plan_applied', _plan_applied, _plan_inputs,
           ('importer/apply_plan.py', 'importer/set_builder.py'),
           YAML_WORDS, is_text=True, short=30, long=5_000),
    Target('lasers', _lasers, lambda: [_LASERS], ('messages/velodyne_models.py',), YAML_WORDS,
           is_text=True, long=100_000),
)  # fmt: skip
"""All of them."""
