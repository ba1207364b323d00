# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pinhole views of fisheyes played live: the bytes that to-bag writes."""

import pytest

from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Fisheye, Images, MessageOptions

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import fisheye_drive
import live

from builders import convert_recording  # isort: skip

pytestmark = pytest.mark.programs

TOPICS = {
    f'/kitti/camera_{index}/pinhole/{topic}': f'sensor_msgs/msg/{kind}'
    for index in (2, 3)
    for topic, kind in (
        ('camera_info', 'CameraInfo'),
        ('image_rect', 'Image'),
        ('image_rect/compressed', 'CompressedImage'),
    )
}


def test_views_are_published_as_the_converter_writes_them(recordings, tmp_path):
    drive = fisheye_drive.add_fisheyes(recordings[Layout.KITTI_360], tmp_path / 'set')
    messages = MessageOptions(fisheye=Fisheye.PINHOLE, images=Images.BOTH)
    convert_recording(drive, tmp_path / 'o.mcap', messages)
    written = live.bag_digests(tmp_path / 'o.mcap')
    heard = live.hear_all(TOPICS, drive, '--fisheye', 'pinhole')
    for topic, msgtype in TOPICS.items():
        assert len(heard[topic]) == len(fisheye_drive.FRAMES)
        assert [digest for _, digest in heard[topic]] == written[topic, msgtype]
