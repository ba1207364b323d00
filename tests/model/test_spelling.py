# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Suggestions for misspelt names."""

from __future__ import annotations

import pytest

from kitti_ros2.model.errors import close_names, did_you_mean, not_one_of
from kitti_ros2.model.streams import Layout

LAYOUTS = [layout.value for layout in Layout]
MODES = ['camera', 'boxes', 'lidar', 'bev', 'panel']
COMMANDS = ['to-bag', 'to-kitti', 'recover', 'info', 'view', 'report', 'demo', 'play']
TOPICS = ['/kitti/oxts/fix', '/kitti/oxts/imu', '/kitti/oxts/vel', '/kitti/velo/points', '/tf']
DRIVES = [f'2011_09_26_drive_{number:04d}_sync' for number in (1, 2, 5, 9)]


@pytest.mark.parametrize(
    ('word', 'known', 'close'),
    [
        ('rwa', LAYOUTS, ['raw']),
        ('Raw', LAYOUTS, ['raw']),
        ('odom', LAYOUTS, ['odometry']),
        ('objects', LAYOUTS, ['object']),
        ('nuscenes', LAYOUTS, []),
        ('lider', MODES, ['lidar']),
        ('bew', MODES, ['bev']),
        ('tobag', COMMANDS, ['to-bag']),
        ('to_kitti', COMMANDS, ['to-kitti']),
        ('vew', COMMANDS, ['view']),
        ('convert', COMMANDS, []),
        ('/kitti/oxts/imo', TOPICS, ['/kitti/oxts/imu']),
        ('points', TOPICS, ['/kitti/velo/points']),
        ('velo/points', TOPICS, ['/kitti/velo/points']),
        ('tf', TOPICS, ['/tf']),
        ('cra', ['Car', 'Cyclist', 'Van'], ['Car']),
        ('2011_09_26_drive_0005_snyc', DRIVES, [DRIVES[2]]),
        ('2011_09_26_drive_0006_sync', DRIVES, []),  # equally similar to all
        ('7', ['00', '01', '02'], []),
        ('', LAYOUTS, []),
        ('raw', [], []),
    ],
)
def test_close_names(word, known, close):
    assert close_names(word, known) == close


def test_the_best_come_first_and_no_more_than_three():
    assert close_names('image', ['image_0', 'image_1', 'images', 'map']) == ['images']
    assert close_names('image_9', ['image_0', 'image_1']) == ['image_0', 'image_1']
    assert close_names('image_9', [f'image_{index}' for index in range(5)]) == []


def test_texts():
    assert did_you_mean('rwa', LAYOUTS) == '; did you mean raw?'
    assert did_you_mean('image_9', ['image_0', 'image_1']) == '; did you mean image_0 or image_1?'
    assert did_you_mean('nuscenes', LAYOUTS) == ''
    assert str(not_one_of('mode', 'lider', MODES)) == (
        "mode takes camera, boxes, lidar, bev or panel, not 'lider'; did you mean lidar?"
    )
    assert str(not_one_of('at_end', 3, ['exit', 'pause'])) == 'at_end takes exit or pause, not 3'
