# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""No topic is passed over in silence: each is named once, with its count and what could be done."""

from __future__ import annotations

import many_topics as robots
import pytest

from kitti_ros2.cli import main

COMMANDS = {
    'plan': lambda bag, _out: ['to-kitti', str(bag), '--layout', 'object', '--plan'],
    'conversion': lambda bag, out: ['to-kitti', str(bag), str(out / 'out'), '--layout', 'object'],
    'conversion by a plan': lambda bag, out: [
        *('to-kitti', str(bag), str(out / 'out')),
        *('--plan-file', str(out / 'plan.yaml')),
    ],
}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return robots.write(tmp_path_factory.mktemp('many') / 'bag')


@pytest.mark.parametrize('command', COMMANDS)
def test_every_topic_that_is_not_used_is_named_once(command, bag, tmp_path, capsys):
    if command == 'conversion by a plan':
        assert main(COMMANDS['plan'](bag, tmp_path)) == 0
        (tmp_path / 'plan.yaml').write_text(capsys.readouterr().out)
    assert main(COMMANDS[command](bag, tmp_path)) == 0
    said = ''.join(capsys.readouterr())
    notes = [line for line in said.splitlines() if 'not used: ' in line]
    for topic, (_, count) in robots.COUNTS.items():
        assert sum(f'{topic} ({count})' in note for note in notes) == 1
    assert not any('/points' in note or '/camera/image' in note for note in notes)
    together = [note for note in notes if '/rosout' in note]
    assert '/diagnostics (13), /parameter_events (12), /rosout (11)' in together[0]
    assert len(together) == 1
    assert len(notes) <= 11


@pytest.mark.parametrize(
    ('topic', 'advice'),
    [
        ('/scan', 'scan.from: laser_scan'),
        ('/livox/lidar', 'scan.from: livox'),
        ('/velodyne_packets', 'scan.from: velodyne'),
        ('/depth/image_raw', 'scan.from: depth'),
        ('/radar', 'KITTI has no radar'),
        (
            '/yolo/detections',
            '2D boxes whose frame is there; those of camera 2 have camera_optical',
        ),
        ('/particles', 'poses without sizes'),
        ('/widget', 'no stream of KITTI is made of this type'),
    ],
)
def test_a_note_says_what_could_be_done(topic, advice, bag, tmp_path, capsys):
    assert main(COMMANDS['plan'](bag, tmp_path)) == 0
    (note,) = [
        line for line in capsys.readouterr().out.splitlines() if f'not used: {topic} (' in line
    ]
    assert note.startswith('# ')
    assert advice in note
