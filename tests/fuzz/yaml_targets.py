# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: YAML files, which are options, plans and calibrations of scanners."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import foreign

from kitti_ros2.cli.config_file import load_config
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
from kitti_ros2.options.table import TO_BAG, TO_KITTI, make_import_options, make_settings

from .inputs import found
from .target import YAML_WORDS, Target, place, stored

if TYPE_CHECKING:
    from kitti_ros2.importer.survey import Survey

PATH = Path('folder/file.yaml')
_BOMBS = (
    b'a: &a [x, x, x, x]\nb: &b [*a, *a, *a, *a]\nc: &c [*b, *b, *b, *b]\nimages: [*c, *c, *c]\n',
    b'start: ' + b'9' * 5000 + b'\n',
    b'images: ' + b'[' * 5000 + b'\n',
    b'a: &a\n  b: *a\n',
    b'images: raw\nimages: both\n',
    b'split_size: .nan\n1: 2\nstart: 2011-99-99\n',
    b'{[1]: 2}\n',
    b'images: !!binary aaa\n',
)
_TEXT = 'model/yaml_text.py'


def _yaml(data: bytes) -> None:
    for kept in ((), ('int', 'timestamp')):
        with suppress(YamlTextError):
            shown(load_yaml(data, kept))


def _config(data: bytes) -> None:
    path = stored('config.yaml', data)
    known = {each.name for each in (*TO_BAG, *TO_KITTI)}
    values = load_config(path, known)
    bag = {each.name for each in TO_BAG}
    kitti = {each.name for each in TO_KITTI}
    make_settings({name: value for name, value in values.items() if name in bag})
    make_import_options({name: value for name, value in values.items() if name in kitti})


def _configs() -> list[bytes]:
    lines = [f'{each.name}: {each.plain(each.default)!r}\n' for each in (*TO_BAG, *TO_KITTI)]
    texts = [line.replace('None', 'null').replace('(', '[').replace(')', ']') for line in lines]
    by_name = {line.partition(':')[0]: line for line in texts}
    lines = list(by_name.values())
    # Short texts are read fast; the whole is read once.
    parts = [''.join(lines[at : at + 4]).encode() for at in range(0, len(lines), 4)]
    every = ''.join(lines).encode()
    return [*parts, b'images: raw\nstart: 10\nend: 3.5s\n', every, *_BOMBS, *found('bombs/*.yaml')]


def _option_text(data: bytes) -> None:
    """Read a value as the command line does; the line before names the option."""
    name, _, text = decode_text(data, PATH).partition('\n')
    for each in (*TO_BAG, *TO_KITTI):
        if each.name == name:
            with suppress(ValueError):  # what the command line reports
                make_settings({name: each.parse(name, text)})


def _option_texts() -> list[bytes]:
    made = []
    for each in {one.name: one for one in (*TO_BAG, *TO_KITTI)}.values():
        plain = each.plain(each.default)
        values = (plain, *each.choices, '1', '0.5', 'yes', '1,2', '10:20', '1,2,3,4', '8x4')
        made += [f'{each.name}\n{value}'.encode() for value in values]
    return made


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
    return [*_plans(), *_BOMBS, *found('bombs/plan_*.yaml')]


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
    Target('yaml', _yaml, lambda: [*_configs(), _LASERS], (_TEXT,), YAML_WORDS, is_text=True,
           long=100_000),
    Target('config', _config, _configs,
           (_TEXT, 'cli/config_file.py', 'options/parsers.py', 'options/declare.py',
            'options/quantity_parsers.py'),
           YAML_WORDS, is_text=True, long=100_000),
    Target('option_text', _option_text, _option_texts,
           ('options/parsers.py', 'options/declare.py', 'options/quantity_parsers.py'),
           (b'GB', b'min', b':', b',', b'x', b'off', b'/kitti/*'), is_text=True, long=100_000),
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
