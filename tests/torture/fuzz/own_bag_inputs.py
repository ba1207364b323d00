# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that to-bag writes: of each layout and with its options, and some with parts that differ."""

from __future__ import annotations

import json
import struct
from functools import cache
from shutil import copytree
from typing import TYPE_CHECKING, Any

import numpy as np

from kitti_ros2.api.conversions import to_bag
from kitti_ros2.kitti.scan_grid import on_grid
from kitti_ros2.messages.naming import CALIBRATION, FILES, POINTS, RECORDING
from kitti_ros2.model.streams import Layout

from .inputs import own_bag, recording
from .target import place

from stored_messages import Stored, make_mcap, messages_of  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_TEXT_HEAD = b'\0\1\0\0'
_OPTIONS: dict[str, tuple[Layout, dict[str, Any]]] = {
    'stereo': (Layout.RAW, {'stereo': True, 'images': 'raw', 'scan_stamp': 'start'}),
    'deskewed': (Layout.RAW, {'deskew': True, 'exclude_topics': ('*image*',)}),
    'period': (Layout.OBJECT, {'images': 'raw', 'period': 0.2, 'stereo': True}),
    'ouster': (Layout.TRACKING, {'points': 'ouster', 'exclude_topics': ('*image*',)}),
}
"""By name: a layout, and options of to-bag."""
_COMPACT = {'clouds': 'compact', 'exclude_topics': ('*image*',)}


@cache
def _bags() -> dict[str, list[Stored]]:
    """The messages of bags, by name of layout or options."""
    made = {each.value: messages_of(own_bag('a.mcap', each)) for each in Layout}
    for name, (layout, options) in _OPTIONS.items():
        out = place(f'bags/{name}.mcap')
        to_bag(recording(layout), out, overwrite=True, fsync=False, **options)
        made[name] = messages_of(out)
    drive = recording(Layout.RAW)
    extract = drive.with_name(drive.name.replace('_sync', '_extract'))
    to_bag(extract, place('bags/extract.mcap'), overwrite=True, fsync=False)
    made['extract'] = messages_of(place('bags/extract.mcap'))
    to_bag(_on_grid(), place('bags/compact.mcap'), overwrite=True, fsync=False, **_COMPACT)
    made['compact'] = messages_of(place('bags/compact.mcap'))
    return made


def _on_grid() -> Path:
    """An object set whose scans are on KITTI's grid, with a zero of minus."""
    root = place('on_grid')
    copytree(recording(Layout.OBJECT), root, dirs_exist_ok=True)
    for path in root.rglob('*.bin'):
        points = np.fromfile(path, '<f4').reshape(-1, 4)
        points[:, :3] = on_grid(points[:, :3])
        points[:, 3] = np.rint(points[:, 3] * 100) / 100
        points[0, 1] = -0.0
        points.tofile(path)
    return root


def own_bags() -> list[bytes]:
    """Bags of to-bag as it writes them."""
    return [make_mcap(messages) for messages in _bags().values()]


def _described(messages: list[Stored], change: Callable[[dict[str, Any]], None]) -> list[Stored]:
    """Messages with another description of the recording."""
    made = []
    for topic, kind, stamp_ns, data in messages:
        if topic == RECORDING:
            values = json.loads(_text_of(data))
            change(values)
            made.append((topic, kind, stamp_ns, _text(json.dumps(values))))
        else:
            made.append((topic, kind, stamp_ns, data))
    return made


def _text_of(data: bytes) -> str:
    (length,) = struct.unpack_from('<I', data, 4)
    return data[8 : 7 + length].decode()


def _text(text: str) -> bytes:
    data = text.encode() + b'\0'
    return _TEXT_HEAD + struct.pack('<I', len(data)) + data


def _set(name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda values: values.update({name: value})


def _set_of_stream(name: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda values: next(iter(values['files'].values())).update({name: value})


def _without_scans(values: dict[str, Any]) -> None:
    del values['files']['scan']
    values['scan_stamp'] = 'start'


def _without_files(values: dict[str, Any]) -> None:
    values['files'] = {}


def _remove_numbers(values: dict[str, Any]) -> None:
    for each in values['files'].values():
        del each['numbers']


def _one_folder(values: dict[str, Any]) -> None:
    first, *others = values['files'].values()
    for each in others:
        each.update({'folder': first['folder'], 'suffix': first['suffix']})


_REAL_TIME = {
    'columns': ['scan', 'image_2', 'start', 'end'],
    'drives': {
        '2011_09_26_drive_0005_sync': [
            [0, 3, 10**18, 10**18, 10**18 - 5 * 10**7, 10**18 + 5 * 10**7],
            [1, 4, 10**18 + 10**8, None, None, None],
        ]
    },
}
_CHANGES: tuple[Callable[[dict[str, Any]], None], ...] = (
    *(lambda values: values.pop('texts'), lambda values: values.pop('files'), _remove_numbers),
    *(_without_scans, _without_files),
    *(_set('period_ns', -1), _set('layout', 'kitti'), _set('real_time', _REAL_TIME), _one_folder),
    *(_set('real_time', {'columns': [], 'drives': {'a': []}}), _set('scan_stamp', 'start')),
    *(_set('texts', ['a.txt', '../b']), _set('name', '../x'), _set('deskew', 'on')),
    *(_set('grey', ['image_2']), _set('stereo', True), _set_of_stream('digits', 99)),
    *(_set_of_stream('numbers', [[5, 2]]), _set_of_stream('carried', [[900, 900]])),
    *(_set_of_stream('numbers', [[0, 900_000], [900_001, 999_999]]), _set_of_stream('suffix', 'x')),
    *(_set_of_stream('folder', '../x'), _set_of_stream('folder', '/x')),
)
_ODD = (_without_scans, _without_files, _set('stereo', True), _set_of_stream('numbers', []))
"""Changes of a description: some that an earlier to-bag wrote, some that are refused."""


def _without(messages: list[Stored], *topics: str) -> list[Stored]:
    return [each for each in messages if each[0] not in topics]


def _named(messages: list[Stored], topic: str, name: str) -> list[Stored]:
    """Messages with another name of the first text of a topic."""
    place_of = next(at for at, each in enumerate(messages) if each[0] == topic)
    topic, kind, stamp_ns, data = messages[place_of]
    text = _text_of(data)
    renamed = _text('\n'.join((name, text.partition('\n')[2])))
    return [
        *messages[:place_of], (topic, kind, stamp_ns, renamed), *messages[place_of:]
    ]  # fmt: skip


def _later(messages: list[Stored], lead_ns: int) -> list[Stored]:
    """Messages as a recorder stores them that another program plays them to."""
    return [(topic, kind, stamp_ns + lead_ns, data) for topic, kind, stamp_ns, data in messages]


def _odd(messages: list[Stored]) -> list[list[Stored]]:
    """Without the texts of files, with names that belong to others, and with parts lost."""
    damaged = [(*each[:3], each[3][: len(each[3]) // 2]) for each in messages]
    pairs = list(zip(messages, damaged, strict=True))
    return [
        *(_without(messages, FILES), _without(messages, CALIBRATION), _without(messages, POINTS)),
        *(_named(messages, FILES, name) for name in _NAMES),
        _named(messages, CALIBRATION, 'calib/000000.txt'),
        [one if at % 3 else two for at, (one, two) in enumerate(pairs)],
        [(*each[:3], each[3][:4] + bytes(8) + each[3][12:]) if each[0] == POINTS else each
         for each in messages],
    ]  # fmt: skip


_NAMES = ('a/b.txt', '../a', 'training/image_2/000000.png', 'training', 'a' * 300, '')


@cache
def odd_bags() -> list[bytes]:
    """Bags that differ from what to-bag writes; each of few messages."""
    bags = _bags()
    made = [_described(bags['object'], change) for change in _CHANGES]
    made += [_described(bags[name], change) for name in ('raw', 'stereo') for change in _ODD]
    made += [_described(bags[name], _CHANGES[0]) for name in ('raw', 'odometry', 'tracking')]
    leads = (5 * 10**9 + 7, 2**63)
    made += [_later(messages, lead_ns) for messages in bags.values() for lead_ns in leads]
    made += [one for name in ('object', 'raw', 'compact') for one in _odd(bags[name])]
    return [make_mcap(messages) for messages in made]
