# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--fisheye pinhole: views beside the images of fisheyes, which no way back takes for files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import cv2
import fisheye_drive
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.cli.completion import VARIABLE
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.topics import view_topics
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Fisheye, Images, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program
from kitti_ros2.player.program import RecordingProgram

from builders import convert_recording, files_of, one_line  # isort: skip

BAGS = ('bag.mcap', 'bag', 'bag.bag')
VIEW = '/kitti/camera_{}/pinhole/{}'
FRAME = 'camera_{}_optical_frame'
PINHOLE = ('--fisheye', 'pinhole')
RUN = 'import sys; sys.argv[0] = "kitti-ros2"; from kitti_ros2.cli import main; sys.exit(main())'


@pytest.fixture(scope='module')
def fisheyes(recordings, tmp_path_factory):
    """The synthetic drive with both fisheyes."""
    root = tmp_path_factory.mktemp('fisheyes') / 'set'
    return fisheye_drive.add_fisheyes(recordings[Layout.KITTI_360], root)


@pytest.fixture(scope='module')
def bag(fisheyes, tmp_path_factory):
    path = tmp_path_factory.mktemp('fisheye_bag') / 'bag.mcap'
    assert main(['to-bag', str(fisheyes), str(path), '-q', *PINHOLE]) == 0
    return path


def messages_in(path):
    """By topic its messages, decoded by rosbags."""
    found = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
    return found


@pytest.mark.parametrize('index', [2, 3])
def test_each_image_has_a_view_of_its_stamp_and_frame(bag, index):
    messages = messages_in(bag)
    images = messages[f'/kitti/camera_{index}/image_raw/compressed']
    views = messages[VIEW.format(index, 'image_rect/compressed')]
    infos = messages[VIEW.format(index, 'camera_info')]
    assert len(images) == len(fisheye_drive.FRAMES)
    stamps = [each.header.stamp for each in images]
    for others in (views, infos):
        assert [each.header.stamp for each in others] == stamps
        assert {each.header.frame_id for each in others} == {FRAME.format(index)}
    links = {each.child_frame_id: each for each in messages['/tf_static'][0].transforms}
    assert links[FRAME.format(index)].header.frame_id == 'velo_link'
    for view, info in zip(views, infos, strict=True):
        picture = cv2.imdecode(view.data, cv2.IMREAD_UNCHANGED)
        assert picture.shape == (info.height, info.width, 3)
        assert view.format == 'png'
        assert (info.distortion_model, info.d.tolist()) == ('plumb_bob', [0.0] * 5)
        x, y = np.array([0.4, -0.5]), np.array([0.3, 0.6])
        u, v = info.k[0] * x + info.k[2], info.k[4] * y + info.k[5]
        shown = picture[np.rint(v).astype(int), np.rint(u).astype(int), 0]
        np.testing.assert_allclose(shown, fisheye_drive.brightness(x, y), atol=3)


def test_without_the_option_there_is_no_view(fisheyes, bag, tmp_path):
    assert main(['to-bag', str(fisheyes), str(tmp_path / 'raw.mcap'), '-q']) == 0
    plain = messages_in(tmp_path / 'raw.mcap').keys()
    assert messages_in(bag).keys() - plain == {
        VIEW.format(index, topic)
        for index in (2, 3)
        for topic in ('camera_info', 'image_rect/compressed')
    }
    assert not plain & view_topics().keys()


@pytest.mark.parametrize('images', [each.value for each in Images])
def test_views_have_the_form_of_images(fisheyes, tmp_path, images):
    words = ['--images', images, *PINHOLE, '--topics', '/kitti/camera_2/pinhole/*']
    assert main(['to-bag', str(fisheyes), str(tmp_path / 'o.mcap'), '-q', *words]) == 0
    messages = messages_in(tmp_path / 'o.mcap')
    names = {topic.removeprefix('/kitti/camera_2/pinhole/') for topic in messages}
    forms = {'compressed': {'image_rect/compressed'}, 'raw': {'image_rect'}}
    forms['both'] = forms['raw'] | forms['compressed']
    assert names == {'camera_info'} | forms[images]
    if images == 'both':
        for pixels, file in zip(
            messages[VIEW.format(2, 'image_rect')],
            messages[VIEW.format(2, 'image_rect/compressed')],
            strict=True,
        ):
            decoded = cv2.imdecode(file.data, cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(pixels.data.reshape(decoded.shape), decoded)
            assert pixels.encoding == 'bgr8'


@pytest.mark.parametrize('images', ['compressed', 'raw'])
@pytest.mark.parametrize('name', BAGS)
def test_files_come_back_to_the_byte_and_no_view_is_a_loss(fisheyes, tmp_path, name, images):
    path, out = tmp_path / name, tmp_path / 'out'
    words = ['-q', '--images', images, *PINHOLE]
    assert main(['to-bag', str(fisheyes), str(path), *words]) == 0
    assert main(['to-kitti', str(path), str(out), '-q']) == 0
    assert files_of(out) == files_of(fisheyes)


def bytes_in(path):
    """By topic the bytes of its messages."""
    found = {}
    with open_messages(path) as messages:
        for message in messages:
            found.setdefault(message.topic, []).append(bytes(message.data))
    return found


def test_worker_processes_write_the_same_messages(fisheyes, bag, tmp_path):
    words = ['-q', '--jobs', '2', *PINHOLE]
    assert main(['to-bag', str(fisheyes), str(tmp_path / 'o.mcap'), *words]) == 0
    assert bytes_in(tmp_path / 'o.mcap') == bytes_in(bag)


def test_the_player_has_the_very_bytes_of_the_bag(fisheyes, bag):
    written, played = bytes_in(bag), {}
    options = MessageOptions(fisheye=Fisheye.PINHOLE)
    program = RecordingProgram(open_recording(fisheyes), options, SelectionOptions(), 1)
    wanted = range(len(program.channels))
    for position in range(len(program.stamps_ns)):
        for message in program.fetch(position, wanted)[0]:
            topic = program.channels[message.channel].topic
            played.setdefault(topic, []).append(bytes(message.data))
    views = written.keys() & view_topics().keys()
    assert len(views) == 4
    assert {topic: played[topic] for topic in views} == {topic: written[topic] for topic in views}


def test_the_option_is_a_ros_parameter_and_one_of_the_library(fisheyes, tmp_path):
    assert make_play_settings({'fisheye': 'pinhole'}).messages.fisheye is Fisheye.PINHOLE
    kitti_ros2.to_bag(fisheyes, tmp_path / 'o.mcap', fisheye='pinhole', end=0)
    assert view_topics().keys() & messages_in(tmp_path / 'o.mcap').keys()


@pytest.mark.parametrize('layout', [each for each in Layout if not each.traits.raw_cameras])
def test_a_recording_without_fisheyes_says_that_nothing_changes(recordings, tmp_path, layout):
    options = MessageOptions(fisheye=Fisheye.PINHOLE)
    report = convert_recording(recordings[layout], tmp_path / 'o.mcap', options)
    assert any('no fisheye is written; without effect: fisheye' in note for note in report.notes)
    assert not report.losses
    plain = convert_recording(recordings[layout], tmp_path / 'plain.mcap')
    assert set(report.notes) - set(plain.notes) == {
        note for note in report.notes if note.endswith('without effect: fisheye')
    }
    assert messages_in(report.path).keys() == messages_in(plain.path).keys()


def test_without_its_file_a_fisheye_has_no_view_and_that_is_a_loss(fisheyes, tmp_path):
    root = shutil.copytree(fisheyes, tmp_path / 'set')
    (root / 'calibration' / 'image_03.yaml').unlink()
    options = MessageOptions(fisheye=Fisheye.PINHOLE)
    report = convert_recording(root, tmp_path / 'o.mcap', options)
    lost = {loss.stream: loss for loss in report.losses if 'camera_3' in loss.stream}
    assert set(lost) == {
        '/kitti/camera_3/camera_info',
        VIEW.format(3, 'camera_info'),
        VIEW.format(3, 'image_rect/compressed'),
    }
    view = lost[VIEW.format(3, 'image_rect/compressed')]
    assert view.count == len(fisheye_drive.FRAMES)
    assert 'image_03.yaml' in view.message
    assert report.counts['/kitti/camera_3/image_raw/compressed'] == len(fisheye_drive.FRAMES)


def test_bags_are_played_as_they_are(bag, fisheyes, tmp_path):
    settings = make_play_settings({'fisheye': 'pinhole'})
    open_program(bag, settings).close()  # has views
    assert main(['to-bag', str(fisheyes), str(tmp_path / 'raw.mcap'), '-q']) == 0
    with pytest.raises(UsageError, match='this is a bag; to-bag --fisheye pinhole makes a bag'):
        open_program(tmp_path / 'raw.mcap', settings)


@pytest.mark.parametrize('layout', ['object', 'odometry'])
def test_no_other_layout_takes_a_view_for_a_camera(bag, tmp_path, capsys, layout):
    words = ['--layout', layout, *(['--name', 'testing'] if layout == 'object' else [])]
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), *words]) == 0
    said = capsys.readouterr().out
    for index in (2, 3):
        topic = VIEW.format(index, 'image_rect/compressed')
        assert f'passed over: {topic}; it is made of the images of a fisheye' in said
    frame = kitti_ros2.open(tmp_path / 'out')[0]
    images = {path.parent.name for path in (tmp_path / 'out').rglob('*.png')}
    assert images == {'image_2', 'image_3'}
    assert frame.image(2).shape == kitti_ros2.open(bag)[0].image(0).shape


def test_rerun_alone_takes_the_option_of_view(fisheyes, capsys):
    assert main(['view', str(fisheyes), '-o', 'x.png', *PINHOLE]) == 2
    assert '--fisheye go with --rerun' in one_line(capsys.readouterr().err)


@pytest.mark.parametrize(('words', 'offered'), [(PINHOLE, True), ((), False)])
def test_completion_offers_the_topics_that_the_option_makes(fisheyes, words, offered):
    line = ' '.join(['kitti-ros2 to-bag', str(fisheyes), 'o.mcap', *words, '--topics '])
    asked = {VARIABLE: 'complete_zsh', '_TYPER_COMPLETE_ARGS': line}
    run = {'env': {**os.environ, **asked}, 'text': True, 'capture_output': True}
    shown = subprocess.run([sys.executable, '-c', RUN], check=True, **run).stdout
    assert '"/kitti/camera_2/camera_info"' in shown
    assert ('"/kitti/camera_2/pinhole/camera_info"' in shown) == offered
