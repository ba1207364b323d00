# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to_bag, to_kitti, encode and draw: equal to the commands."""

from __future__ import annotations

import struct
import warnings

import cv2
import numpy as np
import pytest
from folder_and_bag import make_holes

import kitti_ros2
from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout


def files(root):
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in root.rglob('*')
        if path.is_file()
    }


@pytest.fixture(params=list(Layout), ids=[layout.value for layout in Layout])
def holed(request, recordings, tmp_path):
    return make_holes(recordings[request.param], request.param, tmp_path)


def test_to_bag_and_back_is_the_commands(holed, tmp_path):
    seen = []
    ours, theirs = tmp_path / 'ours', tmp_path / 'theirs'
    ours.mkdir()
    theirs.mkdir()
    with warnings.catch_warnings(record=True):
        warnings.simplefilter('always')
        report = kitti_ros2.to_bag(
            holed, ours / 'bag.mcap', progress=lambda *done: seen.append(done)
        )
        reports = kitti_ros2.to_kitti(str(ours / 'bag.mcap'), ours / 'set')
    main(['to-bag', str(holed), str(theirs / 'bag.mcap'), '-q'])
    main(['to-kitti', str(theirs / 'bag.mcap'), str(theirs / 'set'), '-q'])
    assert (ours / 'bag.mcap').read_bytes() == (theirs / 'bag.mcap').read_bytes()
    assert files(ours / 'set') == files(theirs / 'set')
    assert seen[-1][0] == seen[-1][1]
    assert sum(report.counts.values()) >= seen[-1][1]
    assert len(reports) == 1


def test_a_bag_becomes_another(recordings, tmp_path):
    first = kitti_ros2.to_bag(recordings[Layout.RAW], tmp_path / 'a.mcap')
    seen = []
    second = kitti_ros2.to_bag(
        tmp_path / 'a.mcap', tmp_path / 'b.bag', progress=lambda *done: seen.append(done)
    )
    assert second.counts == {topic: count for topic, count in first.counts.items() if count}
    assert (second.first_ns, second.last_ns) == (first.first_ns, first.last_ns)
    assert (second.frames, second.losses) == (0, ())
    assert seen[-1] == (sum(first.counts.values()),) * 2
    with pytest.raises(UsageError, match='--images is for KITTI folders'):
        kitti_ros2.to_bag(tmp_path / 'a.mcap', tmp_path / 'c.bag', images='raw')


def test_options_have_the_names_of_the_command_line(recordings, tmp_path):
    kitti_ros2.to_bag(
        recordings[Layout.RAW],
        tmp_path / 'a.mcap',
        images='raw',
        topics=['/kitti/camera_color_left/*', '/kitti/velo/points'],
        start=1,
        end=['frame', '2'][1],
    )
    with OpenBag(tmp_path / 'a.mcap') as bag, open_messages(bag, None) as messages:
        topics = {message.topic for message in messages}
    assert topics == {
        '/kitti/camera_color_left/image_rect',
        '/kitti/camera_color_left/camera_info',
        '/kitti/velo/points',
    }


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda src, out: kitti_ros2.to_bag(src, out, image='raw'), "unknown option 'image'"),
        (lambda src, out: kitti_ros2.to_bag(src, out, images='rw'), 'raw'),
        (lambda src, _: kitti_ros2.to_bag(src, src / 'out.mcap'), 'inside'),
        (lambda src, out: kitti_ros2.to_bag(src / 'nothing', out), 'no such file or folder'),
        (lambda src, out: kitti_ros2.to_kitti(src / 'nothing.mcap', out), 'no such file'),
        (lambda _, out: kitti_ros2.to_kitti([], out), 'no bag'),
        (kitti_ros2.to_kitti, 'bag'),
    ],
)
def test_mistakes_leave_nothing(call, message, recordings, tmp_path):
    with pytest.raises(kitti_ros2.KittiRos2Error, match=message):
        call(recordings[Layout.RAW], tmp_path / 'out.mcap')
    assert list(tmp_path.iterdir()) == []


def test_losses_are_warnings(drive, tmp_path):
    path = drive / 'velodyne_points/data/0000000001.bin'
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.warns(kitti_ros2.KittiRos2Warning, match=r'0000000001\.bin') as found:
        report = kitti_ros2.to_bag(drive, tmp_path / 'a.mcap')
    assert len(found) == len(report.losses)
    assert {each.filename for each in found} == {__file__}


def test_encode_is_what_to_bag_writes(holed, tmp_path):
    """Every message of a frame but the texts is in the bag, byte for byte."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        kitti_ros2.to_bag(holed, tmp_path / 'a.mcap', images='both')
        recording = kitti_ros2.open(holed)
    written = {}
    with OpenBag(tmp_path / 'a.mcap') as bag, open_messages(bag, None) as messages:
        for message in messages:
            written.setdefault(message.topic, []).append(bytes(message.data))
    seen = {}
    for frame in recording:
        for topic, (msgtype, data) in kitti_ros2.encode(frame, images='both').items():
            assert struct.unpack('<4B', data[:4]) == (0, 1, 0, 0), topic
            # In a bag it stands once, with the stamp of the first frame.
            assert topic == '/tf_static' or data in written[topic], (topic, frame.number)
            assert '/msg/' in msgtype
            seen.setdefault(topic, []).append(data)
    left_out = {topic for topic in written if '/source/' in topic or topic.endswith('/path')}
    assert set(written) - set(seen) <= left_out
    for topic, messages in seen.items():
        if topic != '/tf_static':
            assert messages == written[topic]


def test_encode_of_a_bag_says_that_it_has_messages(recordings, tmp_path):
    kitti_ros2.to_bag(recordings[Layout.RAW], tmp_path / 'a.mcap')
    frame = kitti_ros2.open(tmp_path / 'a.mcap')[0]
    with pytest.raises(kitti_ros2.KittiRos2Error, match='encode needs a KITTI folder'):
        kitti_ros2.encode(frame)


@pytest.mark.parametrize('mode', ['camera', 'boxes', 'lidar', 'bev', 'panel'])
def test_draw_is_view(mode, recordings, tmp_path):
    path = recordings[Layout.OBJECT]
    frame = kitti_ros2.open(path)[1]
    picture = kitti_ros2.draw(frame, mode)
    main(['view', str(path), '--mode', mode, '--frame', '1', '-q', '-o', str(tmp_path / 'a.png')])
    expected = cv2.imread(str(tmp_path / 'a.png'))[..., ::-1]
    np.testing.assert_array_equal(picture, expected)
    picture.save(tmp_path / 'b.png')
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / 'b.png'))[..., ::-1], picture)


def test_pictures_are_arrays_that_notebooks_show(recordings):
    frame = kitti_ros2.open(recordings[Layout.OBJECT])[0]
    picture = kitti_ros2.draw(frame, 'bev', range=(0, 20, -10, 10), resolution=5)
    assert picture.shape == (100, 100, 3)
    assert picture._repr_png_().startswith(b'\x89PNG')
    assert picture[..., 0]._repr_png_() is None
    assert (picture / 2)._repr_png_() is None
    with pytest.raises(kitti_ros2.KittiRos2Error, match='no RGB picture'):
        picture[0].png()


@pytest.mark.parametrize(
    ('options', 'message'),
    [({'mode': 'birdseye'}, 'birdseye'), ({'mode': 'bev', 'colour': 1}, 'unknown option')],
)
def test_mistakes_of_draw_are_named(options, message, recordings):
    frame = kitti_ros2.open(recordings[Layout.OBJECT])[0]
    with pytest.raises(kitti_ros2.KittiRos2Error, match=message):
        kitti_ros2.draw(frame, **options)


def test_split_is_the_keyword_of_its_flag(recordings, tmp_path):
    kitti_ros2.to_bag(recordings[Layout.RAW], tmp_path / 'a.mcap')
    kitti_ros2.to_kitti(tmp_path / 'a.mcap', tmp_path / 'set', layout='object', split=0.5)
    assert (tmp_path / 'set/ImageSets/val.txt').read_text()
