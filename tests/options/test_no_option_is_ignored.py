# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An option that is given is used, refused, or named in a line: never ignored in silence."""

from __future__ import annotations

import hashlib
import re

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.datasets import CROP, SPLIT, STATS, VALIDATE
from kitti_ros2.options.declare import parse_flag
from kitti_ros2.options.table import REPORT, TO_BAG, TO_KITTI, VIEW

VALUES = {
    'all_cameras': [], 'autoware_labels': ['Car=BUS'], 'base_to_imu': ['1,2,3'],
    'box': ['0,-5,-3,30,5,2'], 'calib': ['no_such_file'], 'camera': ['3'], 'classes': ['Car'],
    'columns': ['x y z intensity ring'], 'compression_level': ['3'], 'end': ['1'],
    'epoch': ['100'], 'exclude_topics': ['*points'], 'fps': ['3'], 'frame': ['2'],
    'frames': ['1:2'], 'folder': ['velodyne_cut'], 'ground_truth_base': ['other_base'],
    'ground_truth_map': ['other_map'], 'height': ['-1:1'], 'image_size': ['100,50'],
    'imu_from': ['no_such_folder'], 'iou': ['Car=0.5'], 'lists': ['no_such_list'],
    'mapping': ['no_such_folder'], 'marker_alpha': ['0.9'], 'marker_arrow_length': ['2'],
    'marker_lifetime': ['2'], 'marker_line_width': ['2'], 'marker_text_height': ['2'],
    'name': ['0007'], 'names': ['one', 'two'], 'origin': ['1,2,3'], 'out': ['elsewhere'],
    'period': ['0.2'], 'png': ['fast'], 'points': ['xyzirt'], 'point_size': ['5'],
    'predictions': ['no_such_folder'],
    'range': ['3:30'], 'ratio': ['70:30'], 'raw': ['no_such_folder'], 'resolution': ['5'],
    'seed': ['3'], 'sequence': ['0099'], 'split_duration': ['0.2'], 'split_size': ['1MB'],
    'start': ['1'], 'storage': ['sqlite3'], 'streams': ['scan'], 'topics': ['*imu'],
    'train_fraction': ['0.5'],
    'voxel': ['0.5'], ('view', 'range'): ['0,-20,40,20'],
    ('view', 'start'): ['2'],  # frame 1 is KITTI-360's first whole one
}  # fmt: skip
"""Values of the options that are neither flags nor choices."""
SILENT = {
    'overwrite': 'nothing is there',
    'fsync': 'what is on the disk is the same',
    'keep_partial': 'nothing is interrupted',
    'strict': 'nothing is lost',
    'append': 'nothing is there',
    'copy': 'files of the same bytes',
    'layout': 'that which is found',
    ('stats', 'columns'): 'scans of other columns are refused without',
    'quick': 'a sound recording',
    'decode': 'a sound recording',
    'snap': 'scans of own bags come back as they were',
}
COMMANDS = {
    'to-bag': (TO_BAG, ['to-bag', 'IN', 'out.mcap']),
    'to-kitti': (TO_KITTI, ['to-kitti', 'BAG', 'out']),
    'view': (VIEW, ['view', 'IN', '-o', 'out.png']),
    'report': (REPORT, ['report', 'IN', '-o', 'out.html']),
    'crop': (CROP, ['crop', 'IN', 'out', '--range', ':80']),
    'split': (SPLIT, ['split', 'IN', '--out', 'lists']),
    'stats': (STATS, ['stats', 'IN']),
    'validate': (VALIDATE, ['validate', 'IN']),
}
TIMES = re.compile(r'took .*|\d+(\.\d+)? s\b')


def words_of(command, option):
    flag = option.flag
    if option.parse is parse_flag:
        return [f'--no-{flag[2:]}' if option.default else flag]
    if option.choices and option.name not in VALUES:
        default = str(option.plain(option.default))
        return [flag, next(each for each in option.choices if each != default)]
    return [flag, *VALUES.get((command, option.name), VALUES[option.name])]


def outcome(words, folder, monkeypatch, capsys):
    """Exit code, printed text without times, and a digest of what is written."""
    folder.mkdir()
    monkeypatch.chdir(folder)
    code = main(words)
    said = capsys.readouterr()
    written = hashlib.sha256()
    for path in sorted(folder.rglob('*')):
        data = path.read_bytes() if path.is_file() else b''
        if path.suffix == '.html':
            data = TIMES.sub('', data.decode()).encode()
        written.update(f'{path.relative_to(folder)}'.encode() + data)
    return code, TIMES.sub('', said.out + said.err), written.hexdigest()


def ignored(command, recording, bag, tmp_path, monkeypatch, capsys):
    options, template = COMMANDS[command]
    base_words = [{'IN': str(recording), 'BAG': str(bag)}.get(word, word) for word in template]
    base = outcome(base_words, tmp_path / 'base', monkeypatch, capsys)
    for option in options:
        if option.name in SILENT or (command, option.name) in SILENT:
            continue
        words = words_of(command, option)
        changed = outcome([*base_words, *words], tmp_path / option.name, monkeypatch, capsys)
        if changed == base:
            yield ' '.join(words)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', list(Layout), ids=[layout.value for layout in Layout])
@pytest.mark.parametrize('command', COMMANDS)
def test_no_option_is_ignored_in_silence(
    command, layout, recordings, tmp_path, monkeypatch, capsys
):
    if command == 'split' and layout is not Layout.OBJECT:
        pytest.skip('one recording is too few to divide')
    recording, bag = recordings[layout], tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recording), str(bag), '-q']) in (0, 1)
    capsys.readouterr()
    silent = list(ignored(command, recording, bag, tmp_path, monkeypatch, capsys))
    assert silent == [], ' '.join(silent)


@pytest.mark.parametrize('mode', ['camera', 'boxes', 'lidar', 'bev', 'perspective', 'panel'])
def test_options_of_pictures_change_them_or_are_named(
    mode, recordings, tmp_path, monkeypatch, capsys
):
    words = ['view', str(recordings[Layout.TRACKING]), '-o', 'out.png', '--mode', mode]
    base = outcome(words, tmp_path / 'base', monkeypatch, capsys)
    options = {
        'camera': '3', 'point-size': '5', 'color-map': 'jet', 'color-by': 'intensity',
        'classes': 'Car', 'extent': '0,40,-20,20', 'resolution': '5', 'fps': '3',
    }  # fmt: skip
    for name, value in options.items():
        given = [*words, f'--{name}', value]
        code, said, written = outcome(given, tmp_path / name, monkeypatch, capsys)
        assert code == 0, said
        assert said.count('note: ') <= 1
        named = 'note: ' in said
        assert named != (written != base[2]), (name, said)
