# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Targets: YAML of any kind, and calibrations of scanners; options and plans have their own."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from kitti_ros2.kitti.store import decode_text
from kitti_ros2.messages.scan_sources import parse_lasers
from kitti_ros2.model.errors import shown
from kitti_ros2.model.yaml_text import YamlTextError, load_yaml

from .inputs import found
from .target import YAML_WORDS, Target

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


def _laser_texts() -> list[bytes]:
    huge = b'1' + b'0' * 400
    odd = (b'lasers: [7]', b'lasers: [{laser_id: 9}]', b'lasers: [{rot_correction: %s}]' % huge)
    return [_LASERS, _LASERS.replace(b'0.002', b'5'), _LASERS.replace(b'0.002', b'x'), *odd]


TARGETS = (
    Target('yaml', _yaml,
           lambda: [*BOMBS, *found('bombs/*.yaml'), b'', _LASERS],
           (_TEXT,), YAML_WORDS, is_text=True, short=25, long=100_000),
    Target('lasers', _lasers, _laser_texts, ('messages/scan_sources.py',), YAML_WORDS,
           is_text=True, long=100_000),
)  # fmt: skip
"""All of them."""
