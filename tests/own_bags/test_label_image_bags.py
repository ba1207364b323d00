# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label images of KITTI-360 in bags: their files back to the byte, and the names of classes."""

from __future__ import annotations

import shutil

import pytest
from folder_and_bag import rerecord
from label_images import KINDS, LABELS, add_label_images, label_file

import kitti_ros2
from kitti_ros2.bags.reader import Decoder, open_messages
from kitti_ros2.cli import main
from kitti_ros2.messages.cdr import stamp_ns_of
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.table import make_play_settings
from kitti_ros2.player.bag_program import open_program

from builders import SMALL, files_of  # isort: skip

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')

INFO = '/kitti/label_info'


@pytest.fixture(scope='module')
def root(recordings, tmp_path_factory):
    """A drive of which two frames have label images; one of an instance is missing."""
    root = tmp_path_factory.mktemp('labels') / 'set'
    shutil.copytree(recordings[Layout.KITTI_360], root)
    add_label_images(root, SMALL.image_size)
    label_file(root, 1, 'instance', 4).unlink()
    (root / LABELS / 'instanceDict.json').unlink()
    return root


@pytest.fixture(scope='module')
def bag(root, tmp_path_factory):
    path = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    assert main(['to-bag', str(root), str(path), '-q']) == 0
    return path


def back(bag, out, *words):
    code = main(['to-kitti', str(bag), str(out), '-q', *words])
    return code, files_of(out)


@pytest.mark.parametrize('images', ['compressed', 'raw', 'both'])
@pytest.mark.parametrize('name', ['bag.mcap', 'bag', 'bag.bag'])
def test_every_file_comes_back_to_the_byte(root, tmp_path, name, images):
    """Also where images of cameras are pixels: no one knows the form of label images."""
    words = ['to-bag', str(root), str(tmp_path / name), '-q', '--images', images]
    assert main(words) == 0
    assert back(tmp_path / name, tmp_path / 'out') == (0, files_of(root))


def test_a_recorder_logs_them_later(root, bag, tmp_path):
    late = rerecord(bag, tmp_path / 'late.mcap', 12_345_678)
    assert back(late, tmp_path / 'out') == (0, files_of(root))


def test_a_part_has_those_of_its_frames(root, bag, tmp_path):
    words = '--start', '1', '--end', '3'
    main(['to-bag', str(root), str(tmp_path / 'part.mcap'), '-q', *words])
    code, files = back(tmp_path / 'part.mcap', tmp_path / 'out')
    assert (code, files) == back(bag, tmp_path / 'cut', *words)
    assert {name[-8:-4] for name in files if 'semantics' in name} == {'0002'}


def test_they_are_beside_the_image_with_its_stamp_and_frame(bag):
    found = {}
    with open_messages(bag) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            if message.topic.startswith('/kitti/camera_1/'):
                header = decode(message, '').header
                found.setdefault(message.topic, []).append((header.frame_id, stamp_ns_of(header)))
    images = found['/kitti/camera_1/image_rect/compressed']
    for kind in KINDS:
        expected = images[2:3] if kind == 'instance' else images[2:5:2]
        assert found[f'/kitti/camera_1/{kind}/compressed'] == expected


def test_classes_are_named_once(bag):
    with open_messages(bag, {INFO}) as messages:
        decode = Decoder(messages.typestore)
        (info,) = [decode(message, '') for message in messages]
        assert INFO in messages.latched
    names = {each.class_id: each.class_name for each in info.class_map}
    assert len(names) == 45
    assert (names[0], names[26], names[44]) == ('unlabeled', 'car', 'unknown object')


def test_a_drive_without_label_images_has_no_names(recordings, tmp_path):
    path = recordings[Layout.KITTI_360]
    assert main(['to-bag', str(path), str(tmp_path / 'bag.mcap'), '-q']) == 0
    with open_messages(tmp_path / 'bag.mcap') as messages:
        assert INFO not in {topic for topic, _ in messages.channels}


def test_the_player_has_them(root):
    program = open_program(root, make_play_settings({}))
    topics = [channel.topic for channel in program.channels]
    assert {f'/kitti/camera_{n}/{kind}/compressed' for n in (0, 1) for kind in KINDS} < {*topics}
    assert INFO in topics
    assert sorted({*program.frames.tolist()}) == [0, 1, 2, 3, 4]
    program.close()


def test_a_bag_is_opened_with_them(root, bag):
    folder = kitti_ros2.open(root)
    with kitti_ros2.open(bag) as other:
        assert not other.losses
        assert other.cameras == folder.cameras
        assert other.numbers.tolist() == folder.numbers.tolist()
        for kind in KINDS:
            one, two = (each.frame(2).label_image(kind) for each in (folder, other))
            assert (one == two).all()


def test_images_of_a_set_are_those_of_the_cameras(bag, tmp_path):
    words = ['--layout', 'object', '--name', 'testing', '-q']
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), *words]) == 0
    assert kitti_ros2.open(tmp_path / 'out')[2].image(2).shape == (*SMALL.image_size[::-1], 3)


def test_bags_have_no_findings(bag, capsys):
    assert main(['validate', str(bag)]) == 0
    assert '0 errors, 0 warnings' in capsys.readouterr().out
