# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs played live: equal stamps, and the bytes that to-bag writes."""

import pytest

from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import ColorEncoding, Images, MessageOptions
from kitti_ros2.options.read import ReadOptions

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from builders import convert_recording  # isort: skip

pytestmark = pytest.mark.programs

PAIRS = (('gray_left', 'gray_right'), ('color_left', 'color_right'))
TOPICS = {
    f'/kitti/camera_{name}/{topic}': f'sensor_msgs/msg/{kind}'
    for pair in PAIRS
    for name in pair
    for topic, kind in (('camera_info', 'CameraInfo'), ('image_rect', 'Image'))
}


def test_no_pair_is_heard_with_two_stamps(recordings, tmp_path):
    drive = recordings[Layout.RAW]
    messages = MessageOptions(stereo=True, images=Images.RAW, color_encoding=ColorEncoding.RGB8)
    convert_recording(drive, tmp_path / 'o.mcap', messages, read=ReadOptions(stereo=True))
    written = live.bag_digests(tmp_path / 'o.mcap')
    heard = live.hear_all(TOPICS, drive, '--stereo', '--color-encoding', 'rgb8')
    for topic, msgtype in TOPICS.items():
        assert [digest for _, digest in heard[topic]] == written[topic, msgtype]
    for left, right in PAIRS:
        for topic in ('camera_info', 'image_rect'):
            stamps = [
                [stamp for stamp, _ in heard[f'/kitti/camera_{name}/{topic}']]
                for name in (left, right)
            ]
            assert stamps[0] == stamps[1]
            assert len(stamps[0]) == 5
