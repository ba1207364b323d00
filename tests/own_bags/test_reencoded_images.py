# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of to-bag whose images are encoded anew, as `pymcap-cli roscompress` makes them."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from builders import convert_recording
from stored_messages import make_mcap

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.messages.images import encode_pixels, pixels_of
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import COMPRESSED, COMPRESSED_VIDEO, IMAGE
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
    expected = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == expected.shape
    assert np.abs(pixels.astype(int) - expected).mean() < 8


def test_files_are_images_of_kittis_size(source, bag, tmp_path, capsys):
    assert main(['to-kitti', str(bag), str(tmp_path / 'out')]) == 1
    back = tmp_path / 'out' / source.parent.name / source.name
    names = sorted(path.relative_to(source) for path in source.rglob('image_*/data/*.png'))
    assert names == sorted(path.relative_to(back) for path in back.rglob('image_*/data/*.png'))
    for name in names:
        assert_alike(cv2.imread(str(back / name), cv2.IMREAD_UNCHANGED), source / name)
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


# Pixels that became PNG, JPEG or WebP on their topic, and files that became pixels.

NOT_OWN = "not KITTI's own pixels"


def as_picture(ending, size=None, tint=0):
    """A change of an Image to a CompressedImage; three channels, as of some tools, with a tint."""

    def change(message):
        pixels = pixels_of(message)
        if size is not None:
            pixels = cv2.resize(pixels, size)
        if ending == '.webp' or tint:
            pixels = pixels.copy() if pixels.ndim == 3 else cv2.merge([pixels] * 3)
            pixels[..., 0] = np.where(pixels[..., 0] > 200, pixels[..., 0] - tint, pixels[..., 0])
        quality = [cv2.IMWRITE_WEBP_QUALITY, 101] if ending == '.webp' else []  # without a loss
        data = cv2.imencode(ending, pixels, quality)[1].ravel()
        return TYPESTORE.types[COMPRESSED](message.header, ending[1:], data)

    return change


def as_pixels(message):
    stamp = message.header.stamp
    stamp_ns = stamp.sec * 10**9 + stamp.nanosec
    return encode_pixels(pixels_of(message), stamp_ns, message.header.frame_id)


def changed(bag, change, kind=IMAGE, other=COMPRESSED):
    """The bag with the messages of a type changed to those of another."""
    stored = []
    with open_messages(bag) as messages:
        for each in messages:
            msgtype, data = each.msgtype, bytes(each.data)
            if msgtype == kind:
                message = change(TYPESTORE.deserialize_cdr(data, kind))
                msgtype, data = other, bytes(TYPESTORE.serialize_cdr(message, other))
            stored.append((each.topic, msgtype, each.stamp_ns, data))
    bag.write_bytes(make_mcap(stored))
    return bag


@pytest.fixture
def raw_bag(source, tmp_path):
    bag = tmp_path / 'raw.mcap'
    assert main(['to-bag', str(source), str(bag), '-q', '--images', 'raw']) == 0
    return bag


def back_of(bag, source, *words):
    """The folder of a drive that came back, and the exit code."""
    out = bag.parent / 'out'
    code = main(['to-kitti', str(bag), str(out), '--overwrite', *words])
    return out / source.parent.name / source.name, code


def pictures_of(drive):
    return {
        path.relative_to(drive): path.read_bytes() for path in drive.rglob('image_*/data/*.png')
    }


@pytest.mark.parametrize('change', [as_picture('.png'), as_picture('.webp')], ids=['png', 'webp'])
def test_pictures_without_a_loss_are_kittis_files(source, raw_bag, capsys, change):
    back, code = back_of(changed(raw_bag, change), source)
    assert code == 0
    assert pictures_of(back) == pictures_of(source)
    assert 'image_' not in capsys.readouterr().out.partition('\n')[2]


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (as_picture('.jpg'), f'decoded from JPEG: {NOT_OWN}'),
        (as_picture('.jpg', (310, 94)), f'decoded from JPEG: {NOT_OWN}'),
        (as_picture('.png', (310, 94)), f'scaled from 310 x 94 pixels: {NOT_OWN}'),
    ],
    ids=['jpeg', 'even jpeg', 'even png'],
)
def test_pictures_with_a_loss_are_alike_and_named(source, raw_bag, capsys, change, text):
    back, code = back_of(changed(raw_bag, change), source)
    assert code == 1
    names = pictures_of(source).keys()
    assert pictures_of(back).keys() == names
    for name in names:
        assert (back / name).read_bytes().startswith(b'\x89PNG')
        assert_alike(cv2.imread(str(back / name), cv2.IMREAD_UNCHANGED), source / name)
    said = capsys.readouterr().err.splitlines()
    for camera in range(4):
        assert f'skipped image_{camera} (6): image_{camera} of frames 0-5 is {text}' in said


def test_another_size_is_named(source, raw_bag, capsys):
    back, code = back_of(changed(raw_bag, as_picture('.png', (155, 47))), source)
    assert code == 1
    text = f'of 155 x 47 pixels, and its camera has 311 x 95: {NOT_OWN}'
    assert f'image_2 of frames 0-5 is {text}' in capsys.readouterr().err
    pixels = cv2.imread(str(back / 'image_02/data/0000000000.png'), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (47, 155, 3)


def test_coloured_pixels_of_a_grey_camera_stay(source, raw_bag, capsys):
    back, code = back_of(changed(raw_bag, as_picture('.png', tint=90)), source)
    assert code == 0
    pixels = cv2.imread(str(back / 'image_00/data/0000000000.png'), cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (95, 311, 3)
    assert "image_0 of frames 0-5 have other bytes than KITTI's files" in capsys.readouterr().out


def test_a_damaged_picture_is_a_loss_of_its_frame(source, raw_bag, capsys):
    count = iter(range(1000))

    def change(message):
        picture = as_picture('.jpg')(message)
        return replace(picture, data=picture.data[:40]) if next(count) == 0 else picture

    back, code = back_of(changed(raw_bag, change), source)
    assert code == 1
    assert len(pictures_of(back)) == len(pictures_of(source)) - 1
    assert 'the JPEG is cut after 40 bytes' in capsys.readouterr().err


def test_files_that_became_pixels_come_back(source, tmp_path, capsys):
    again = tmp_path / 'again.mcap'
    convert_recording(source, again)
    back, code = back_of(changed(again, as_pixels, COMPRESSED, IMAGE), source)
    assert code == 0
    assert pictures_of(back) == pictures_of(source)
    assert "the bag does not tell the bytes of KITTI's files" in capsys.readouterr().out


@pytest.mark.parametrize('ending', ['.png', '.jpg'])
def test_readers_show_pictures(source, raw_bag, ending):
    frames = open_frames(changed(raw_bag, as_picture(ending)), ReadOptions())
    try:
        for camera, number in ((2, 4), (0, 1), (3, 5)):
            path = source / f'image_0{camera}' / 'data' / f'{number:010}.png'
            difference = frames.pixels(camera, number).astype(int) - cv2.imread(str(path))
            assert np.abs(difference).mean() < 8
    finally:
        frames.close()


PYMCAP = shutil.which('pymcap-cli')


@pytest.mark.skipif(PYMCAP is None, reason='pymcap-cli is not installed')
@pytest.mark.parametrize('form', ['png', 'jpeg'])
def test_after_roscompress(source, raw_bag, tmp_path, form):
    out = tmp_path / 'o.mcap'
    command = [PYMCAP, 'roscompress', raw_bag, out, '--image-format', form, '--no-pointcloud']
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    if 'extras' in ran.stdout + ran.stderr:
        pytest.skip('pymcap-cli is installed without its extra "video"')
    back, _ = back_of(out, source)
    assert pictures_of(back).keys() == pictures_of(source).keys()
    for name in pictures_of(source):
        assert_alike(cv2.imread(str(back / name), cv2.IMREAD_UNCHANGED), source / name)
