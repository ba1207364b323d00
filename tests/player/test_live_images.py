# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Images that a node makes of a bag's, heard by a second process."""

import hashlib

import pytest

from kitti_ros2.model.streams import Layout
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from kitti_ros2.cli import main

from builders import convert_recording, one_line  # isort: skip
from waiting import PATIENCE_S  # isort: skip

IMAGE = 'sensor_msgs/msg/Image'
CAMERA = '/kitti/camera_color_left'
TOPICS = {
    f'{CAMERA}/image_rect/compressed': 'sensor_msgs/msg/CompressedImage',
    f'{CAMERA}/image_rect': IMAGE,
    f'{CAMERA}/annotated': IMAGE,
}


def to_bag(path, out):
    convert_recording(path, out)
    return out


def digests_of(folder):
    """By topic the digests of a folder's images, in order."""
    program = open_program(folder, make_play_settings({'annotated': True}))
    index = {each.topic: n for n, each in enumerate(program.channels)}
    names = {index[topic]: topic for topic in TOPICS}
    found = {topic: [] for topic in TOPICS}
    for place in range(len(program.stamps_ns)):
        for message in program.fetch(place, set(names))[0]:
            if message.channel in names:
                digest = hashlib.sha1(message.data).hexdigest()
                found[names[message.channel]].append(digest)
    return found


def test_a_bag_shows_the_images_of_its_folder(recordings, tmp_path):
    bag = to_bag(recordings[Layout.RAW], tmp_path / 'drive_0005')
    process = live.play(bag, '--annotated', '--start-paused')
    try:
        assert 'frames 0 to 4' in process.stderr.readline()  # its topics come next
        listener = live.Listening(TOPICS)
        try:
            listener.wait_for_publishers(process)
            assert listener.tell('call', 'resume')[0]
            _, said = process.communicate(timeout=PATIENCE_S)
            assert (process.returncode, 'Traceback' in said) == (0, False), said
            for topic, digests in digests_of(recordings[Layout.RAW]).items():
                assert listener.tell('wait', topic, len(digests)) == len(digests)
            heard = listener.heard()
        finally:
            live.stop(listener.process)
    finally:
        live.stop(process)
    assert {topic: [digest for _, digest in found] for topic, found in heard.items()} == (
        digests_of(recordings[Layout.RAW])
    )


@pytest.mark.parametrize('kind', ['folder', 'bag'])
def test_without_labels_annotated_is_wrong_usage(recordings, tmp_path, capsys, kind):
    source = recordings[Layout.ODOMETRY]
    if kind == 'bag':
        source = to_bag(source, tmp_path / 'o.mcap')
    assert main(['play', str(source), '--annotated']) == 2
    complaint = one_line(capsys.readouterr().err)
    assert f'{source}: no annotated images can be made: ' in complaint
    assert 'no labels' in complaint
