# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label images of KITTI-360: the classes, instances and confidence of the pixels of some frames."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest
from label_images import KINDS, LABELS, add_label_images, classes_of, label_file

import kitti_ros2
from kitti_ros2.datasets import validate
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.classes import KITTI_360_IMAGE_LABELS, KITTI_360_LABELS
from kitti_ros2.model.streams import LABEL_STREAMS, Layout, Stream

from builders import SMALL, png_bytes  # isort: skip

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')

SHAPE = SMALL.image_size[::-1]
HALF = cv2.imencode('.png', np.zeros((SHAPE[0] // 2, SHAPE[1]), np.uint16))[1].tobytes()


@pytest.fixture
def root(recordings, tmp_path):
    """A drive of which two frames have label images."""
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    add_label_images(tmp_path / 'set', SMALL.image_size)
    return tmp_path / 'set'


def test_they_are_streams_with_the_stamps_of_their_camera(root):
    recording = open_recording(root)
    assert not recording.losses
    for stream in LABEL_STREAMS:
        images = recording.streams[Stream(f'image_{stream.viewer}')]
        index = recording.streams[stream]
        assert index.numbers.tolist() == [2, 4]
        assert index.stamps_ns.tolist() == images.stamps_ns[[2, 4]].tolist()
    assert [note for note in recording.notes if 'data_2d' in note] == [
        f'{root / LABELS}/instanceDict.json: not converted; it lists what images of instances have'
    ]


def test_the_stamps_of_a_camera_without_images_serve(root):
    shutil.rmtree(root / 'data_2d_raw' / LABELS[-26:] / 'image_01/data_rect')
    stamps = open_recording(root).streams[Stream.INSTANCE_1].stamps_ns.tolist()
    (root / 'data_2d_raw' / LABELS[-26:] / 'image_01/timestamps.txt').unlink()
    recording = open_recording(root)
    scans = recording.streams[Stream.SCAN].stamps_ns
    assert recording.streams[Stream.INSTANCE_1].stamps_ns.tolist() == scans[[2, 4]].tolist()
    assert stamps != scans[[2, 4]].tolist()
    said = [note for note in recording.notes if f'{LABELS}/image_01' in note]
    assert said == [f'{root / LABELS}/image_01: no timestamps.txt; stamped as scan']


def test_without_any_stamps_a_hole_is_no_loss(root):
    for path in root.glob('data_[23]d_raw/*/*/timestamps.txt'):
        path.unlink()
    recording = open_recording(root)
    assert recording.streams[Stream.SEMANTIC_0].numbers.tolist() == [2, 4]
    assert not recording.losses


def test_one_kind_alone_is_read(root):
    for kind in KINDS[1:]:
        shutil.rmtree(root / LABELS / 'image_00' / kind)
    shutil.rmtree(root / LABELS / 'image_01')
    recording = open_recording(root)
    assert {*LABEL_STREAMS} & recording.streams.keys() == {Stream.SEMANTIC_0}
    assert not any('not read' in loss.text() for loss in recording.losses)


@pytest.mark.parametrize('camera', [0, 1])
def test_the_library_decodes_them(root, camera):
    frame = kitti_ros2.open(root).frame(2)
    classes = classes_of(camera, 2, SHAPE)
    np.testing.assert_array_equal(frame.label_image(camera=camera), classes)
    instances = frame.label_image('instance', camera)
    assert instances.dtype == np.uint16
    np.testing.assert_array_equal(instances // 1000, classes)
    assert frame.label_image('semantic_rgb', camera).shape == (*SHAPE, 3)
    assert frame.label_image('confidence', camera).max() == 200


def test_a_frame_without_them_says_so(root):
    recording = kitti_ros2.open(root)
    with pytest.raises(kitti_ros2.KittiRos2Error, match='frame 3: no instance image of camera 1'):
        recording.frame(3).label_image('instance', 1)
    with pytest.raises(kitti_ros2.KittiRos2Error, match='no label image depth of camera 0; there'):
        recording.frame(2).label_image('depth')
    with pytest.raises(kitti_ros2.KittiRos2Error, match='no label image semantic of camera 2'):
        recording.frame(2).label_image(camera=2)
    assert recording.numbers.tolist() == [0, 1, 2, 3, 4]


def test_every_id_up_to_44_has_a_label():
    """Ids of pixels are not those of the XML file."""
    assert sorted(KITTI_360_IMAGE_LABELS) == [*range(45)]
    assert len({*KITTI_360_IMAGE_LABELS.values()}) == 45
    assert (KITTI_360_IMAGE_LABELS[26], KITTI_360_LABELS[13][1]) == ('car', 'car')


def planted(root, number, data):
    path = label_file(root, 0, 'instance', number)
    path.write_bytes(data(path.read_bytes()))
    return [(each.rule, each.path) for each in validate(root).findings if each.severity != 'note']


@pytest.mark.parametrize(
    ('rule', 'change'),
    [
        ('file-empty', lambda _: b''),
        ('image-file', lambda data: data[:-40]),
        ('image-file', lambda _: png_bytes(*SMALL.image_size, channels=1)),
        ('image-file', lambda _: png_bytes(*SMALL.image_size)),
        ('image-size', lambda _: HALF),
    ],
    ids=['empty', 'cut', '8 bits', 'colour', 'size'],
)
def test_a_fault_is_found(root, rule, change):
    assert planted(root, 2, lambda data: data) == []
    assert (rule, label_file(root, 0, 'instance', 2)) in planted(root, 2, change)
