# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""PNG files that are made of the pixels in bags: byte for byte KITTI's, or said not to be."""

from __future__ import annotations

import shutil
from dataclasses import replace

import cv2
import pytest
from folder_and_bag import make_holes
from stored_messages import make_mcap

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main
from kitti_ros2.files.image_files import decode_png, encode_png, parse_png
from kitti_ros2.messages.images import pixels_of
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import COMPRESSED, IMAGE
from kitti_ros2.model.streams import Layout

OTHER_BYTES = "have other bytes than KITTI's files; the bag does not tell if other pixels"
UNKNOWN = "the bag does not tell the bytes of KITTI's files"
CONTAINERS = ('bag.mcap', 'bag.bag', 'bag')


def files_of(root):
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob('*'))
        if path.is_file()
    }


def there_and_back(source, tmp_path, *words, bag='bag.mcap', back=()):
    bag, out = tmp_path / bag, tmp_path / 'out'
    shutil.rmtree(out, ignore_errors=True)
    assert main(['to-bag', str(source), str(bag), '--overwrite', '-q', *words]) in (0, 1)
    assert main(['to-kitti', str(bag), str(out), *back]) in (0, 1)
    return files_of(out)


@pytest.mark.parametrize('bag', CONTAINERS)
@pytest.mark.parametrize('layout', list(Layout), ids=[layout.value for layout in Layout])
def test_every_image_comes_back_to_the_byte(recordings, tmp_path, capsys, layout, bag):
    source = make_holes(recordings[layout], layout, tmp_path / 'holed')
    root = source.parent.parent if layout is Layout.RAW else source
    made = there_and_back(source, tmp_path, '--images', 'raw', bag=bag)
    true = files_of(root)
    pictures = {name for name in true if name.endswith('.png')}
    assert pictures
    assert {name: made.get(name) for name in pictures} == {name: true[name] for name in pictures}
    said = capsys.readouterr().out
    assert OTHER_BYTES not in said
    assert UNKNOWN not in said


def test_other_bytes_are_counted(recordings, tmp_path, capsys):
    source = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], source)
    (changed,) = source.glob('training/image_2/000003.png')
    changed.write_bytes(encode_png(decode_png(parse_png(changed.read_bytes(), changed))))
    there_and_back(source, tmp_path, '--images', 'raw')
    assert f'image_2 of frames 3 {OTHER_BYTES}' in capsys.readouterr().out
    there_and_back(source, tmp_path, '--images', 'raw', back=['--png', 'fast'])
    assert f'image_2 of frames 0-2, 4 {OTHER_BYTES}' in capsys.readouterr().out


@pytest.mark.parametrize('kind', ['png', 'jpg'])
def test_images_that_became_compressed_ones_are_read(recordings, tmp_path, capsys, kind):
    """As pymcap-cli roscompress --image-format makes them, on the same topics."""
    source, bag = recordings[Layout.OBJECT], tmp_path / 'bag.mcap'
    assert main(['to-bag', str(source), str(bag), '--images', 'raw']) == 0
    stored = []
    with open_messages(bag) as messages:
        for message in messages:
            data, msgtype = bytes(message.data), message.msgtype
            if msgtype == IMAGE:
                image, msgtype = TYPESTORE.deserialize_cdr(data, msgtype), COMPRESSED
                _, file = cv2.imencode(f'.{kind}', pixels_of(image))
                made = TYPESTORE.types[msgtype](image.header, kind, file.ravel())
                data = bytes(TYPESTORE.serialize_cdr(made, msgtype))
            stored.append((message.topic, msgtype, message.stamp_ns, data))
    bag.write_bytes(make_mcap(stored))
    code = main(['to-kitti', str(bag), str(tmp_path / 'out')])
    back, true = files_of(tmp_path / 'out'), files_of(source)
    loss = "image_2 of frames 0-4 is decoded from JPEG: not KITTI's own pixels"
    if kind == 'png':
        assert code == 0
        assert back == true
    else:
        assert code == 1
        assert back.keys() == true.keys()
        assert loss in capsys.readouterr().err
    assert main(['view', str(bag), '--mode', 'camera', '-o', str(tmp_path / 'view.png')]) == 0


def changed(bag, msgtype, change):
    """The bag with each message of a type changed."""
    stored = []
    with open_messages(bag) as messages:
        for message in messages:
            data = bytes(message.data)
            if message.msgtype == msgtype:
                image = TYPESTORE.deserialize_cdr(data, msgtype)
                pixels = replace(image, data=change(image.data))
                data = bytes(TYPESTORE.serialize_cdr(pixels, msgtype))
            stored.append((message.topic, message.msgtype, message.stamp_ns, data))
    bag.write_bytes(make_mcap(stored))
    return bag


def test_other_pixels_are_not_said_to_be_kittis(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(bag), '--images', 'raw']) == 0
    darker = changed(bag, IMAGE, lambda data: data // 2)
    assert main(['to-kitti', str(darker), str(tmp_path / 'out')]) == 0
    said = capsys.readouterr().out
    assert f'image_2 of frames 0-4 {OTHER_BYTES}' in said
    assert "the pixels of KITTI's" not in said


def test_jpegs_in_place_of_png_files_are_named(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.OBJECT]), str(bag)]) == 0

    def as_jpeg(data):
        _, jpeg = cv2.imencode('.jpg', cv2.imdecode(data, cv2.IMREAD_COLOR))
        return jpeg.ravel()

    assert main(['to-kitti', str(changed(bag, COMPRESSED, as_jpeg)), str(tmp_path / 'out')]) == 0
    said = capsys.readouterr().out
    assert 'image_2 of frames 0-4 are JPEGs in files named .png' in said


def test_where_the_bag_does_not_tell_nothing_is_claimed(recordings, tmp_path, capsys):
    words = ['--images', 'raw', '--exclude-topics', '/kitti/source/image_2']
    there_and_back(recordings[Layout.OBJECT], tmp_path, *words)
    assert f'image_2 of frames 0-4 are made of pixels; {UNKNOWN}' in capsys.readouterr().out


@pytest.mark.parametrize('preset', ['kitti2bag', 'default'])
def test_bags_with_kittis_topics_get_kittis_form(recordings, tmp_path, preset):
    """Without the notes of to-bag a bag is any program's."""
    source = recordings[Layout.RAW]
    words = ['--images', 'raw', '--preset', preset, '--exclude-topics', '/kitti/source/*']
    true = set(files_of(source.parent.parent).values())
    for back, same in ((), True), (('--png', 'fast'), False):
        made = there_and_back(source, tmp_path, *words, back=['--layout', 'raw', *back])
        pictures = {data for name, data in made.items() if name.endswith('.png')}
        assert pictures
        assert (pictures <= true) is same
