# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's annotated images: drawn where the objects are, and only for who asks."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.images import decode_pixels
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.options.table import make_play_settings, make_settings
from kitti_ros2.own_bags import encode
from kitti_ros2.player.program import RecordingProgram

ANNOTATED = MessageOptions(images=Images.BOTH, annotated=True)
CAMERA = '/kitti/camera_color_left'


def program(path, options=ANNOTATED):
    return RecordingProgram(open_recording(path), options, SelectionOptions(), 1)


def names(played):
    return {outlet.topic: index for index, outlet in enumerate(played.channels)}


def images(played, wanted):
    """Topic to the images of camera 2, in order; fetched while the wanted ones are subscribed."""
    index = names(played)
    found = {}
    for place in range(len(played.stamps_ns)):
        due, missing = played.fetch(place, {index[name] for name in wanted})
        assert not missing
        for message in due:
            name = played.channels[message.channel].topic
            if name in wanted:
                decoded = TYPESTORE.deserialize_cdr(message.data, 'sensor_msgs/msg/Image')
                found.setdefault(name, []).append(decoded)
    return found


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT, Layout.TRACKING])
def test_labels_are_drawn_on_the_image(recordings, layout):
    wanted = {f'{CAMERA}/annotated', f'{CAMERA}/image_rect'}
    found = images(program(recordings[layout]), wanted)
    changed = 0
    for plain, drawn in zip(
        found[f'{CAMERA}/image_rect'], found[f'{CAMERA}/annotated'], strict=True
    ):
        assert drawn.header == plain.header
        assert drawn.encoding == 'bgr8'
        before, after = decode_pixels(plain), decode_pixels(drawn)
        assert before.shape == after.shape
        changed += int(np.count_nonzero((before != after).any(axis=2)))
    assert changed > 100


def test_a_grey_camera_is_drawn_on_in_colour(recordings):
    name = '/kitti/camera_gray_left/annotated'
    (first, *_) = images(program(recordings[Layout.RAW]), {name})[name]
    assert first.encoding == 'bgr8'


def test_an_image_is_decoded_once(recordings, monkeypatch):
    decoded = []
    decode = encode.decode_image
    monkeypatch.setattr(encode, 'decode_image', lambda image: decoded.append(1) or decode(image))
    played = program(recordings[Layout.RAW])
    images(played, {f'{CAMERA}/annotated', f'{CAMERA}/image_rect'})
    assert len(decoded) == 5


def test_nothing_is_drawn_for_nobody(recordings, monkeypatch):
    played = program(recordings[Layout.RAW])
    monkeypatch.setattr(encode, 'decode_image', pytest.fail)
    assert played.channels[names(played)[f'{CAMERA}/annotated']].on_demand
    assert not images(played, set())


def test_it_is_not_there_unless_asked_for(recordings):
    played = program(recordings[Layout.RAW], MessageOptions(images=Images.BOTH))
    assert not [name for name in names(played) if name.endswith('annotated')]
    assert make_play_settings({'annotated': True}).messages.annotated
    with pytest.raises(UsageError, match='annotated'):
        make_settings({'annotated': True})


def test_labels_that_cannot_be_read_cost_the_annotated_image_only(recordings, tmp_path):
    root = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], root)
    (root / 'training/label_2/000001.txt').unlink()
    played = program(root)
    index = names(played)
    (root / 'training/label_2/000002.txt').unlink()  # after it was listed
    losses = []
    for place in range(len(played.stamps_ns)):
        losses += played.fetch(place, set(index.values()))[1]
    texts = [loss.message for loss in losses if 'annotated' in loss.message]
    assert len(texts) == len([name for name in index if name.endswith('annotated')])
    assert all('000002.txt' in text for text in texts)


def test_the_stream_that_it_is_made_of_is_the_image(recordings):
    played = RecordingProgram(
        open_recording(recordings[Layout.RAW]),
        ANNOTATED,
        SelectionOptions(streams=(Stream.IMAGE_2.value,)),
        1,
    )
    assert f'{CAMERA}/annotated' in names(played)
