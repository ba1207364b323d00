# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of to-bag whose images became video since, as `pymcap-cli roscompress` makes them."""

from __future__ import annotations

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from builders import convert_recording
from stored_messages import make_mcap

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import COMPRESSED, COMPRESSED_VIDEO
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

ODD = SyntheticOptions(frames=6, image_size=(311, 95), lidar_columns=100)
"""An odd size, as KITTI's: encoders make it even."""


class Encoder:
    """Encodes the images of a topic, scaled to an even size."""

    def __init__(self) -> None:
        self.context = av.CodecContext.create('libx264', 'w')
        self.context.width, self.context.height, self.context.pix_fmt = 310, 94, 'yuv420p'
        self.context.time_base, self.context.gop_size = Fraction(1, 10), 4
        self.context.options = {'preset': 'veryfast', 'crf': '4', 'tune': 'zerolatency'}

    def encode(self, picture: bytes) -> bytes:
        pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
        frame = av.VideoFrame.from_ndarray(cv2.resize(pixels, (310, 94)), format='bgr24')
        return b''.join(bytes(packet) for packet in self.context.encode(frame))


def reencode(bag):
    """The file of a bag with its images as video."""
    encoders, stored = {}, []
    with open_messages(bag) as messages:
        for each in messages:
            kind, data = each.msgtype, bytes(each.data)
            if kind == COMPRESSED:
                message = TYPESTORE.deserialize_cdr(data, kind)
                encoder = encoders.setdefault(each.topic, Encoder())
                packet = np.frombuffer(encoder.encode(message.data.tobytes()), np.uint8)
                kind = COMPRESSED_VIDEO
                head = message.header
                video = TYPESTORE.types[kind](head.stamp, head.frame_id, packet, 'h264')
                data = bytes(TYPESTORE.serialize_cdr(video, kind))
            stored.append((each.topic, kind, each.stamp_ns, data))
    bag.write_bytes(make_mcap(stored))
    return bag


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp('odd')
    return write_synthetic(folder, Layout.RAW, ODD)


@pytest.fixture(scope='module')
def bag(source, tmp_path_factory):
    path = tmp_path_factory.mktemp('bag') / 'bag.mcap'
    convert_recording(source, path)
    return reencode(path)


def assert_alike(pixels, path):
    """Sizes are the same, and pixels are within what a fine video differs by."""
    expected = cv2.imread(str(path))
    assert pixels.shape == expected.shape
    assert np.abs(pixels.astype(int) - expected).mean() < 8


def test_files_are_images_of_kittis_size(source, bag, tmp_path, capsys):
    assert main(['to-kitti', str(bag), str(tmp_path / 'out')]) == 1
    back = tmp_path / 'out' / source.parent.name / source.name
    names = sorted(path.relative_to(source) for path in source.rglob('image_*/data/*.png'))
    assert names == sorted(path.relative_to(back) for path in back.rglob('image_*/data/*.png'))
    for name in names:
        assert_alike(cv2.imread(str(back / name)), source / name)
    lines = capsys.readouterr().err.splitlines()
    for camera in range(4):
        text = f"image_{camera} of frames 0-5 is decoded from video: not KITTI's own pixels"
        assert f'skipped image_{camera} (6): {text}' in lines


def test_frames_show_them_in_any_order(source, bag):
    frames = open_frames(bag, ReadOptions())
    try:
        for number in (4, 1, 5):
            pixels = frames.pixels(2, number)
            assert_alike(pixels, source / 'image_02' / 'data' / f'{number:010}.png')
    finally:
        frames.close()
