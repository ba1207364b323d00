# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: values of the options of every command, from words, YAML files and ROS parameters."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from kitti_ros2.cli.command import load_config
from kitti_ros2.kitti.store import decode_text
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.yaml_text import load_yaml
from kitti_ros2.options import datasets as sets
from kitti_ros2.options import evaluation as evaluations
from kitti_ros2.options import table

from .inputs import found
from .target import YAML_WORDS, Target, stored
from .yaml_targets import BOMBS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from kitti_ros2.options.declare import Option

PATH = Path('folder/file.yaml')
_LONGEST_YAML = 100

_COMMANDS: dict[str, tuple[tuple[Option, ...], Callable[[Mapping[str, object]], object]]] = {
    'to-bag': (table.TO_BAG, table.make_settings),
    'play': (table.PLAY, table.make_play_settings),
    'to-kitti': (table.TO_KITTI, table.make_import_options),
    'view': (table.VIEW, table.make_view_settings),
    'extract': (sets.EXTRACT, sets.make_extract_options),
    'download': (sets.DOWNLOAD, sets.make_download_options),
    'stats': (sets.STATS, sets.make_statistics_options),
    'validate': (sets.VALIDATE, sets.make_validation_options),
    'crop': (sets.CROP, sets.make_crop_options),
    'split': (sets.SPLIT, sets.make_split_options),
    'eval detection': (evaluations.DETECTION, evaluations.make_detection_options),
    'eval tracking': (evaluations.TRACKING, evaluations.make_tracking_options),
    'eval odometry': (evaluations.ODOMETRY, evaluations.make_odometry_options),
    'eval live': (evaluations.LIVE, evaluations.make_live_options),
}
"""The options of commands, and what makes their objects."""


def _config(data: bytes) -> None:
    path = stored('config.yaml', data)
    known = {each.name for each in (*table.TO_BAG, *table.TO_KITTI)}
    values = load_config(path, known)
    for command in ('to-bag', 'to-kitti'):
        options, make = _COMMANDS[command]
        names = {each.name for each in options}
        make({name: value for name, value in values.items() if name in names})


def _configs() -> list[bytes]:
    options = (*table.TO_BAG, *table.TO_KITTI)
    lines = [f'{each.name}: {each.plain(each.default)!r}\n' for each in options]
    texts = [line.replace('None', 'null').replace('(', '[').replace(')', ']') for line in lines]
    by_name = {line.partition(':')[0]: line for line in texts}
    lines = list(by_name.values())
    # Short texts are read fast; the whole is read once.
    parts = [''.join(lines[at : at + 4]).encode() for at in range(0, len(lines), 4)]
    every = ''.join(lines).encode()
    others = [b'images: raw\nstart: 10\nend: 3.5s\n', b'', b'- images\n', b'\xff', b'1: 2\n']
    return [*parts, *others, every, *BOMBS, *found('bombs/*.yaml')]


def _option_text(data: bytes) -> None:
    """Read a value as a command line does, and as a YAML file; before it are command and name."""
    name, _, text = decode_text(data, PATH).partition('\n')
    command, _, name = name.rpartition(' ')
    _, make = _COMMANDS.get(command, _COMMANDS['to-bag'])
    values: list[object] = [text.split()]
    if len(text) <= _LONGEST_YAML:
        with suppress(ValueError):
            values.append(load_yaml(text))
    for value in values:
        with suppress(ValueError, KittiRos2Error):
            make({name: value})
    with suppress(ValueError):  # what the command line reports
        make({name: text})


def _option_texts() -> list[bytes]:
    """The default and choices of each option, and all values for the first one of a parser."""
    made: dict[str, bytes] = {}
    parsers = set()
    for command, (options, _) in _COMMANDS.items():
        for each in options:
            values = [each.plain(each.default), *each.choices]
            if each.parse not in parsers:
                values += _VALUES
                parsers.add(each.parse)
            for value in values:
                made.setdefault(f'{each.name}\n{value}', f'{command} {each.name}\n{value}'.encode())
    return [*made.values()]


_VALUES = (
    *('1', '0.5', 'yes', '1,2', '10:20', ':', '1,2,3,4', '8x4', '0 -4 -3 7 4 1', '1/3 2/3', '2GB'),
    *('Car: car', '2011-09-26 00:00:00', '60s', '[1, 2]', 'true', '1e999999999'),
)
TARGETS = (
    Target('config', _config, _configs,
           ('model/yaml_text.py', 'cli/command.py', 'options/declare.py'),
           YAML_WORDS, is_text=True, short=50, long=100_000),
    Target('option_text', _option_text, _option_texts,
           ('options/declare.py',),
           (b'GB', b'min', b':', b',', b'x', b'off', b'/kitti/*', b'2/3'),
           is_text=True, long=100_000),
)  # fmt: skip
"""All of them."""
