# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-kitti restores the files from bags with the names of a stack; info and view know them."""

from __future__ import annotations

import shutil

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program


def files_of(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


@pytest.mark.parametrize('name', ['lio-sam', 'rtabmap-stereo', 'nvblox', 'ultralytics_ros'])
def test_a_bag_of_a_stack_gives_the_files_back(name, recordings, tmp_path):
    drive, bag, out = recordings[Layout.RAW], tmp_path / 'bag', tmp_path / 'out'
    assert main(['to-bag', str(drive), str(bag), '-q', '--for', name]) == 0
    assert main(['to-kitti', str(bag), str(out), '-q']) == 0
    assert files_of(out) == files_of(drive.parents[1])


def test_a_bag_is_played_as_it_is(recordings, tmp_path):
    bag = tmp_path / 'bag'
    words = ['--for', 'lio-sam', '--streams', 'oxts']
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q', *words]) == 0
    with pytest.raises(UsageError, match='to-bag --for makes a bag for a stack'):
        open_program(bag, make_play_settings({'stack': 'lio-sam'}))
    open_program(bag, make_play_settings({})).close()


def test_a_stack_is_told_what_the_drive_does_not_have(recordings, tmp_path, capsys):
    drive = str(recordings[Layout.RAW])
    assert main(['to-bag', drive, str(tmp_path / 'bag'), '--for', 'lio-sam']) == 0
    shown = capsys.readouterr()
    said = shown.out + shown.err
    assert 'note: lio-sam needs /imu/data at 100 Hz, it has 10 Hz: ' in said
    words = ['to-bag', drive, str(tmp_path / 'scans'), '--for', 'lio-sam', '--streams', 'scan']
    assert main(words) == 0
    shown = capsys.readouterr()
    assert 'note: lio-sam reads /imu/data: no messages' in shown.out + shown.err


def test_a_viewer_of_boxes_takes_a_drive_without_labels(recordings, tmp_path, capsys):
    source = recordings[Layout.RAW].parent
    drive = tmp_path / source.name / recordings[Layout.RAW].name
    shutil.copytree(source, drive.parent, ignore=shutil.ignore_patterns('tracklet_labels.xml'))
    words = ['to-bag', str(drive), str(tmp_path / 'bag'), '--streams', 'image_2', '--end', '1']
    assert main([*words, '--for', 'foxglove']) == 0
    assert 'note: no annotations can be made: the recording has' in capsys.readouterr().out
    assert main([*words, '--annotations', '--overwrite']) == 2
