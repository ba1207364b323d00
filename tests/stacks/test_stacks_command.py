# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stacks: the list, one stack, JSON, mistakes."""

from __future__ import annotations

import json

import pytest

from kitti_ros2.cli.boundary import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.stack_catalogue import STACKS


def test_the_list_fits_a_terminal(capsys):
    assert main(['stacks']) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ['stack', 'does', 'points', 'Imu', 'read', 'at']
    assert [row.split()[0] for row in rows] == list(STACKS)
    assert all(len(row.rstrip()) <= 80 for row in rows)


@pytest.mark.parametrize('name', STACKS)
def test_a_stack_is_shown_with_its_sources_and_commands(name, capsys):
    assert main(['stacks', name]) == 0
    shown = capsys.readouterr().out
    for each in STACKS[name].demands:
        assert str(each.source) in shown
    packets = '--imu-from DRIVE_extract ' if STACKS[name].imu_hz else ''
    assert f'kitti-ros2 play DRIVE {packets}--for {name}' in shown
    for own, renamed in STACKS[name].topics.items():
        assert f'{own} -> {renamed}' in ' '.join(shown.split())


def test_json_has_the_same(capsys):
    assert main(['stacks', '--json']) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [each['name'] for each in listed] == list(STACKS)
    assert main(['stacks', 'lio-sam', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == listed[list(STACKS).index('lio-sam')]
    assert found['topics'] == {'/kitti/velo/points': '/points', '/kitti/oxts/imu': '/imu/data'}
    assert found['options']['points'] == 'xyzirt'
    assert found['demands'][0]['source'].endswith('include/lio_sam/utility.hpp:157')


def test_files_for_a_drive(recordings, tmp_path, capsys):
    words = ['stacks', 'kiss-icp', '--drive', str(recordings[Layout.RAW]), '-o', str(tmp_path)]
    assert main(words) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[:2] == [f'{tmp_path}/kiss-icp.yaml', f'{tmp_path}/kiss-icp.launch.py']
    assert f'ros2 launch {tmp_path}/kiss-icp.launch.py' in shown
    assert main([*words, '--overwrite', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['files'] == shown[:2]
    assert main(words) == 2
    assert 'pass --overwrite' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['kis-icp'], 'did you mean kiss-icp?'),
        (['--drive', 'drive'], '--drive needs a STACK'),
        (['kiss-icp', '-o', 'folder'], 'go with --drive DRIVE'),
    ],
)
def test_a_mistake_is_one_line(words, message, capsys):
    assert main(['stacks', *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1


def test_quiet_writes_the_files_and_prints_nothing(recordings, tmp_path, capsys):
    words = ['stacks', 'lio-sam', '--drive', str(recordings[Layout.RAW]), '-o', str(tmp_path)]
    assert main([*words, '-q']) == 0
    assert capsys.readouterr() == ('', '')
    assert (tmp_path / 'lio-sam.yaml').is_file()
