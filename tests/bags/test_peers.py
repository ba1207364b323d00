# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that other programs read and write: the same messages, and no complaint about them.

pip install pymcap-cli kappe kitti2mcap rosbags, on the PATH
npm install @mcap/core@2 @mcap/nodejs@1 @foxglove/rosbag@0.4 @foxglove/rosmsg@5
    @foxglove/rosmsg2-serialization@3 fzstd@0.1 lz4js@0.2, in NODE_PATH
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import subprocess
import sysconfig
from collections import Counter
from dataclasses import fields, is_dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import convert_recording, files_of  # isort: skip

pytestmark = pytest.mark.programs

READ_WITH_NPM = Path(__file__).with_name('read_with_npm.cjs')
CONTAINERS = {
    'mcap': ('bag.mcap', {}),
    'mcap lz4': ('bag.mcap', {'compression': 'lz4'}),
    'mcap zstd': ('bag.mcap', {'compression': 'zstd'}),
    'ros1': ('bag.bag', {}),
    'ros1 lz4': ('bag.bag', {'compression': 'lz4'}),
}
_CONVERT = 'rosbags-convert --src {bag} --dst out'
REWRITES = {
    'bag.mcap': (
        'pymcap-cli filter {bag} out.mcap',
        'pymcap-cli compress {bag} -o out.mcap --compression lz4',
        'pymcap-cli rechunk {bag} out.mcap',
        'pymcap-cli sort {bag} -o out.mcap',
        'pymcap-cli split {bag} --duration 200ms -t out/out_{{index}}.mcap',
        'pymcap-cli process {bag} -o out.mcap',
        'kappe convert {bag} out',
        'rosbags-convert --src {bag} --dst out.bag',
        f'{_CONVERT} --dst-storage sqlite3',
        f'{_CONVERT} --dst-storage mcap',
        f'{_CONVERT} --dst-storage mcap --compress zstd --compress-mode message',
        f'{_CONVERT} --dst-storage sqlite3 --compress zstd --compress-mode file',
    ),
    'bag.bag': (
        'pymcap-cli bag2mcap {bag} out.mcap',
        _CONVERT,
        f'{_CONVERT} --dst-typestore ros2_jazzy',
    ),
}
REMARKS = {'bag-folder', 'bag-field-names', 'bag-latched'}
"""Rules with a right warning: no metadata.yaml, D for d, a /tf_static that is volatile."""
SCRIPTS = sysconfig.get_path('scripts')


def run(words, folder):
    """Run a program, and return its output; skip if it is absent."""
    program = shutil.which(words[0]) or shutil.which(words[0], path=SCRIPTS)
    if program is None:
        pytest.skip(f'{words[0]} is not installed')
    command = [program, *words[1:]]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def bag_of(recording, name, folder, **options):
    storage = 'ros1' if name.endswith('.bag') else 'mcap'
    convert_recording(recording, folder / name, storage=storage, **options)
    return folder / name


def messages_of(bag):
    """All messages with their values."""
    with open_messages(bag) as messages:
        return [
            (each.topic, each.stamp_ns, plain(messages.typestore.deserialize_cdr(each.data, name)))
            for each in messages
            for name in [messages.sources[each.topic].msgtype]
        ]


def plain(value):
    """A message as nested dicts and lists; names as in ROS 2, bytes as their SHA-256."""
    if is_dataclass(value):
        parts = {field.name: getattr(value, field.name) for field in fields(value)}
        skipped = ('__msgtype__', *filter(str.isupper, parts))  # constants
        return {name: plain(part) for name, part in parts.items() if name not in skipped}
    if isinstance(value, np.ndarray) and value.dtype == np.uint8:
        return hashlib.sha256(value.tobytes()).hexdigest()
    if isinstance(value, np.ndarray | list):
        return [plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return {math.inf: 'Infinity', -math.inf: '-Infinity'}.get(value, 'NaN')
    return value


def as_in_ros2(value):
    """The same of ROS 1: seq is dropped, nsec is nanosec, and D K R P are small letters."""
    if isinstance(value, list):
        return [as_in_ros2(part) for part in value]
    if not isinstance(value, dict):
        return value
    return {
        'nanosec' if name == 'nsec' else name.lower() if len(name) == 1 else name: as_in_ros2(part)
        for name, part in value.items()
        if name != 'seq'
    }


def counted(messages):
    """The messages in no order, as that of one stamp is free; 0 is 0.0 and -0.0."""
    found = Counter()
    for topic, stamp_ns, value in messages:
        numbers = json.loads(
            json.dumps(value), parse_int=float, parse_float=lambda x: 0.0 + float(x)
        )
        found[topic, stamp_ns, json.dumps(numbers, sort_keys=True)] += 1
    return found


@pytest.mark.parametrize('case', CONTAINERS)
def test_readers_of_foxglove_have_the_same_values(case, recordings, tmp_path):
    try:
        run(['node', '-e', "['@mcap/core', '@foxglove/rosbag'].forEach(require)"], tmp_path)
    except AssertionError:
        pytest.skip('the npm packages are not in NODE_PATH')
    name, options = CONTAINERS[case]
    bag = bag_of(recordings[Layout.TRACKING], name, tmp_path, **options)
    lines = run(['node', str(READ_WITH_NPM), str(bag)], tmp_path).splitlines()
    found = [
        (topic, int(stamp), as_in_ros2(value)) for topic, stamp, value in map(json.loads, lines)
    ]
    assert found
    assert counted(found) == counted(messages_of(bag))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
@pytest.mark.parametrize(
    ('name', 'command'),
    [(name, command) for name, commands in REWRITES.items() for command in commands],
)
def test_bags_that_others_rewrite(name, command, layout, recordings, tmp_path, capsys):
    bag = bag_of(recordings[layout], name, tmp_path)
    if '-t out/' in command:
        (tmp_path / 'out').mkdir()
    run(command.format(bag=name).split(), tmp_path)
    (out,) = tmp_path.glob('out*')
    found, expected = messages_of(out), messages_of(bag)
    if '--dst-typestore' in command:  # Jazzy's types have more fields
        found, expected = ([(*each[:2], 0) for each in every] for every in (found, expected))
    assert counted(found) == counted(expected)
    main(['validate', str(out), '--json'])
    said = json.loads(capsys.readouterr().out)
    assert said['errors'] == 0
    assert {each['rule'] for each in said['rules']} <= REMARKS
    for source, folder in ((bag, 'expected'), (out, 'again')):
        assert main(['to-kitti', str(source), str(tmp_path / folder), '-q']) == 0
    assert capsys.readouterr().err == ''
    assert files_of(tmp_path / 'again') == files_of(tmp_path / 'expected')


def test_kitti2mcap_keeps_scans_pixels_and_stamps(recordings, tmp_path, capsys):
    drive = recordings[Layout.RAW]
    _, _, _, _, number, _ = drive.name.split('_')
    words = ['--date', drive.parent.name, '--drive', number, '--kitti-dir', str(drive.parents[1])]
    bag = tmp_path / 'bag.mcap'
    run(['kitti2mcap', *words, '--cameras', '0,1,2,3', '--output', str(bag)], tmp_path)
    assert main(['info', str(bag)]) == 0
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'raw', '-q']) == 0
    assert capsys.readouterr().err == ''
    (again,) = tmp_path.glob('out/*/*_sync')
    files, expected = files_of(again), files_of(drive)
    for name, data in expected.items():
        if name.startswith(('velodyne_points/data', 'velodyne_points/timestamps.txt')):
            assert files[name] == data, name
        elif name.endswith('.png'):
            assert np.array_equal(pixels(files[name]), pixels(data)), name
    assert sum(name.endswith('.png') for name in files) == 4 * len(list(drive.glob('oxts/data/*')))


def pixels(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
