# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Real files of KITTI-360 in bags: back to the byte with all holes, and as KITTI's own layouts."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import kitti_ros2
from kitti_ros2.cli import main

from builders import files_of  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

D = '2013_05_28_drive_{}_sync'
FISHEYE = 'data_2d_raw/{}/image_02/data_rgb/{:010d}.png'
BAGS = ('bag.mcap', 'bag', 'bag.bag')

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')


@pytest.fixture(scope='module')
def real(real_360, tmp_path_factory) -> Path:
    """The real files; the fisheye image, of drive 0003, once more as one of frame 0000/1134."""
    root = tmp_path_factory.mktemp('real') / 'set'
    shutil.copytree(real_360, root, ignore=shutil.ignore_patterns('extra', '*.py', '*.md', 'SHA*'))
    fisheye = root / FISHEYE.format(D.format('0000'), 1134)
    fisheye.parent.mkdir(parents=True)
    shutil.copy(root / FISHEYE.format(D.format('0003'), 0), fisheye)
    return root


@pytest.fixture(scope='module')
def bag(real, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    assert main(['to-bag', str(real), str(path), '--sequence', '0000', '-q']) == 1  # an excerpt
    return path


def of_drive(root: Path, drive: str) -> dict[str, bytes]:
    return {
        name: data
        for name, data in files_of(root).items()
        if drive in name or name.startswith('calibration/')
    }


@pytest.mark.parametrize('drive', ['0000', '0003', '0008'])
@pytest.mark.parametrize('name', BAGS)
def test_every_file_comes_back_to_the_byte(real, tmp_path, drive, name):
    main(['to-bag', str(real), str(tmp_path / name), '--sequence', drive, '-q'])
    main(['to-kitti', str(tmp_path / name), str(tmp_path / 'out'), '-q'])
    assert files_of(tmp_path / 'out') == of_drive(real, D.format(drive))


def test_images_come_back_to_the_byte_from_their_pixels(real, tmp_path):
    """KITTI-360's PNG files are in another form than KITTI's."""
    words = ['to-bag', str(real), str(tmp_path / 'bag.mcap'), '--images', 'raw', '-q']
    main([*words, '--sequence', '0000'])
    main(['to-kitti', str(tmp_path / 'bag.mcap'), str(tmp_path / 'out'), '-q'])
    assert files_of(tmp_path / 'out') == of_drive(real, D.format('0000'))


def test_a_bag_has_the_frames_and_poses_of_its_folder(real, bag):
    folder = kitti_ros2.open(real, sequence='0000')
    with kitti_ros2.open(bag) as other:
        assert other.numbers.tolist() == folder.numbers.tolist()
        assert other.streams['pose'].tolist() == folder.streams['pose'].tolist()
        for number in (1, 14, 1134, 1200):
            np.testing.assert_allclose(
                other.frame(number).pose, folder.frame(number).pose, atol=1e-6
            )
        frame = other.frame(1134)
        assert frame.stamp_ns == folder.frame(1134).stamp_ns
        uv, distance = frame.calibration.project(frame.points, 2)
        inside = ((uv >= 0) & (uv < 1400)).all(axis=1)
        assert inside.sum() == 65676
        assert (distance[inside] > 0).all()


def test_a_fisheye_says_its_model_and_is_never_called_rectified(bag):
    topics = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            if '/camera_' in connection.topic:
                topics[connection.topic] = reader.deserialize(data, connection.msgtype)
    assert '/kitti/camera_2/image_raw/compressed' in topics
    assert '/kitti/camera_0/image_rect/compressed' in topics
    info = topics['/kitti/camera_2/camera_info']
    assert (info.distortion_model, info.width, info.height) == ('mei', 1400, 1400)
    assert info.d[0] == 2.2134047507854890
    assert info.k.reshape(3, 3)[0, 0] == pytest.approx(1336.3220825849971)
    # The pinhole of the same size in the middle of the image.
    assert info.p.reshape(3, 4)[0, 0] == pytest.approx(1336.3220825849971 / (1 + info.d[0]))
    right = topics['/kitti/camera_1/camera_info']
    assert right.header.frame_id == 'camera_0_optical_frame'
    assert -right.p[3] / right.p[0] == pytest.approx(0.59418, abs=1e-5)


@pytest.mark.parametrize(('camera', 'points'), [(2, 25407), (3, 25225)])
def test_an_object_set_has_the_pair_as_its_colour_cameras(bag, tmp_path, camera, points):
    words = ['--layout', 'object', '--name', 'testing', '-q']
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), *words]) == 0
    frame = kitti_ros2.open(tmp_path / 'out')[0]
    uv, _ = frame.calibration.project(frame.points, camera)
    assert ((uv >= 0) & (uv < (1408, 376))).all(axis=1).sum() == points
    assert frame.image(camera).shape == (376, 1408, 3)
