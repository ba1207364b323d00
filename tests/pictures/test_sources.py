# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A frame is the same wherever it is read from: every layout, every container, bags of others."""

from __future__ import annotations

import shutil
from contextlib import closing
from copy import copy

import foreign
import numpy as np
import pytest

from kitti_ros2.kitti.label_file import ResultFiles
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import join
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.recording import BY_POSITION
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.pictures.painters import Predictions
from kitti_ros2.pictures.recording_frames import open_frames
from kitti_ros2.pictures.series import first_whole

from builders import convert_recording  # isort: skip

ANY = ReadOptions()


def make_bag(source, path, storage='mcap', images=Images.COMPRESSED):
    convert_recording(source, path, MessageOptions(images=images), storage=storage)
    return path


def assert_same(frame, other):
    assert frame.images.keys() == other.images.keys()
    for camera, pixels in frame.images.items():
        np.testing.assert_array_equal(pixels, other.images[camera])
    np.testing.assert_array_equal(frame.points, other.points)
    assert frame.calibration is not None
    assert other.calibration is not None
    for camera, calibration in frame.calibration.cameras.items():
        if camera in other.images:
            np.testing.assert_allclose(
                calibration.p_rect, other.calibration.cameras[camera].p_rect, atol=1e-9
            )


@pytest.mark.one_in(3)
@pytest.mark.parametrize('images', [Images.COMPRESSED, Images.RAW])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_a_bag_shows_what_its_folder_shows(recording_path, tmp_path, storage, images):
    name = {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}[storage]
    bag = open_frames(make_bag(recording_path, tmp_path / name, storage, images), ANY)
    folder = open_frames(recording_path, ANY)
    assert len(bag.numbers) == len(folder.numbers)
    assert bag.cameras == folder.cameras
    for number in (0, int(folder.numbers[-1])):
        there, here = bag.frame(number), folder.frame(number)
        assert not there.missing
        assert not here.missing
        assert there.stamp_ns == here.stamp_ns
        assert_same(there, here)
        solid = sorted(obj.class_name for obj in here.objects if obj.cuboid is not None)
        assert sorted(obj.class_name for obj in there.objects if obj.cuboid is not None) == solid


def test_a_bag_of_others(tmp_path):
    truth = foreign.make_truth()
    source = open_frames(foreign.write_foreign(tmp_path / 'bag.mcap', truth), ANY)
    frame = source.frame(3)
    assert set(frame.images) == {2, 3}
    assert frame.points is not None
    assert len(frame.points)
    assert frame.calibration is not None
    assert frame.pose is not None
    assert frame.objects


def test_only_what_is_wanted_is_read(recordings):
    source = open_frames(recordings[Layout.OBJECT], ANY)
    frame = source.frame(1, frozenset({Stream.SCAN.value}))
    assert not frame.images
    assert not frame.objects
    assert frame.points is not None


@pytest.mark.one_in(3)
@pytest.mark.parametrize('number', [-1, 5])
def test_a_frame_that_is_not_there(recording_path, tmp_path, number):
    with pytest.raises(UsageError, match=f'has no frame {number}; it has 5 frames, 0 to 4'):
        open_frames(recording_path, ANY).frame(number)
    bag = open_frames(make_bag(recording_path, tmp_path / 'bag.mcap'), ANY)
    with pytest.raises(UsageError, match=f'has no frame {number}; it has 5 frames, 0 to 4'):
        bag.frame(number)


def test_a_gap_shifts_nothing(drive):
    (drive / 'velodyne_points/data/0000000002.bin').unlink()
    source = open_frames(drive, ANY)
    assert source.frame(2).points is None
    assert set(source.frame(2).images) == {0, 1, 2, 3}
    before = open_recording(drive).read(Stream.SCAN, 3)
    np.testing.assert_array_equal(source.frame(3).points, before.points)
    assert any('no file for frames 2' in loss.text() for loss in source.losses)


def test_what_cannot_be_read_costs_itself(drive):
    (drive / 'image_02/data/0000000001.png').write_bytes(b'no picture')
    frame = open_frames(drive, ANY).frame(1)
    assert set(frame.images) == {0, 1, 3}
    assert '0000000001.png' in frame.missing['image_2']


def test_an_extract_is_put_together_by_time(recordings, tmp_path):
    drive = tmp_path / recordings[Layout.RAW].parent.name / 'drive_0001_extract'
    drive = drive.with_name(recordings[Layout.RAW].name.replace('sync', 'extract'))
    shutil.copytree(recordings[Layout.RAW].parent, drive.parent)
    drive.with_name(recordings[Layout.RAW].name).rename(drive)
    stamps = drive / 'image_02/timestamps.txt'
    lines = stamps.read_text().splitlines(keepends=True)
    # The camera begins a frame late: its file 0 belongs to scan 1.
    stamps.write_text(''.join(lines[1:]))
    (drive / 'image_02/data/0000000004.png').unlink()
    source = open_frames(drive, ANY)
    assert 2 not in source.frame(0).images
    expected = open_recording(drive).read(Stream.IMAGE_2, 2)
    frame = source.frame(3)
    assert frame.images[2].shape == (expected.height, expected.width, 3)
    own = open_frames(recordings[Layout.RAW], ANY).frame(2)
    np.testing.assert_array_equal(frame.images[2], own.images[2])


def test_a_picture_is_of_a_whole_frame(recordings):
    """KITTI-360 has no pose, and so no box, at frame 0."""
    for layout, first in {layout: int(layout.traits.world_boxes) for layout in Layout}.items():
        with closing(open_frames(recordings[layout], ANY)) as source:
            numbers = source.numbers.tolist()
            assert first_whole(numbers, source) == first
            assert first_whole(numbers[2:], source) == 2


def test_nothing_to_look_at(tmp_path):
    with pytest.raises(UsageError, match='no such file or folder'):
        open_frames(tmp_path / 'none', ANY)


def test_a_calibration_that_cannot_be_had_is_noted(tmp_path):
    truth = foreign.make_truth()
    path = foreign.write_foreign(tmp_path / 'bag.mcap', truth, 'mcap', '/tf_static')
    source = open_frames(path, ANY)
    frame = source.frame(0)
    assert frame.images
    assert frame.calibration is None
    assert any(note.startswith('no calibration: ') for note in source.guess_notes)
    assert frame.missing['calibration']


LINE = 'Car 0.00 0 -1.57 100.00 50.00 200.00 90.00 1.50 1.60 3.90 1.00 1.60 12.00 -1.57 0.91\n'


class TestPredictions:
    @pytest.mark.parametrize('below', ['.', 'data'])
    def test_a_file_for_each_frame(self, recordings, tmp_path, below):
        (tmp_path / below).mkdir(exist_ok=True)
        (tmp_path / below / '000001.txt').write_text(LINE * 2)
        source = open_frames(recordings[Layout.OBJECT], ANY)
        results = Predictions(ResultFiles(tmp_path).read)
        first, second = results.add_to(source.frame(1)).predictions
        assert first.score == second.score == 0.91
        assert first.cuboid is not None
        frame = results.add_to(source.frame(2))
        assert not frame.predictions
        assert frame.missing['predictions'].endswith('no result file for frames {}')

    def test_a_file_of_tracks(self, recordings, tmp_path):
        path = tmp_path / '0000.txt'
        path.write_text(f'1 7 {LINE}3 8 {LINE}')
        source = open_frames(recordings[Layout.TRACKING], ANY)
        predictions = Predictions(ResultFiles(path).read)
        frames = [predictions.add_to(source.frame(number)) for number in range(4)]
        ids = [[prediction.track_id for prediction in frame.predictions] for frame in frames]
        assert ids == [[], [7], [], [8]]

    def test_a_bad_line_costs_itself(self, recordings, tmp_path):
        (tmp_path / '000000.txt').write_text(f'Car 1 2\n{LINE}')
        frame = open_frames(recordings[Layout.OBJECT], ANY).frame(0)
        frame = Predictions(ResultFiles(tmp_path).read).add_to(frame)
        assert len(frame.predictions) == 1
        assert '000000.txt:1: 3 columns' in frame.missing['predictions 0']


ALL_BUT_POINTS = (
    '/tf_static',
    '/perception/objects',
    *(f'/cam/left/{name}' for name in ('image_raw', 'camera_info')),
    *(f'/cam/right/{name}' for name in ('image_rect/compressed', 'camera_info')),
)


def test_a_cloud_of_a_depth_camera_has_z_forward(tmp_path):
    def in_a_camera(topic, _place, message):
        if topic == '/sensors/ouster/points':
            message.header.frame_id = 'depth_optical_frame'
        return message

    truth = foreign.make_truth()
    sources = {}
    for name, change in (('plain', lambda _topic, _place, message: message), ('z', in_a_camera)):
        path = tmp_path / f'{name}.mcap'
        foreign.write_foreign(path, truth, 'mcap', *ALL_BUT_POINTS, change=change)
        sources[name] = open_frames(path, ANY)
    before, after = (sources[name].frame(0).points for name in ('plain', 'z'))
    np.testing.assert_array_equal(after[:, 0], before[:, 2])
    np.testing.assert_array_equal(after[:, 1], -before[:, 0])
    np.testing.assert_array_equal(after[:, 2], -before[:, 1])
    assert any('z axis is taken as forward' in note for note in sources['z'].guess_notes)
    assert sources['plain'].guess_notes == [BY_POSITION]


@pytest.mark.parametrize(
    ('names', 'expected'),
    [(['7', '8'], [7, 8]), (['box/7', 'a-b-c'], [7, None]), (['', ''], [None, None])],
)
def test_tracks_of_others_are_what_the_bag_says(tmp_path, names, expected):
    def named(topic, _place, message):
        if topic == '/perception/objects':
            message = TYPESTORE.deserialize_cdr(join(message), 'vision_msgs/msg/Detection3DArray')
            first = message.detections[0]
            message.detections = [copy(first) for _ in names]
            for detection, name in zip(message.detections, names, strict=True):
                detection.id = name
        return message

    path = foreign.write_foreign(tmp_path / 'bag.mcap', foreign.make_truth(), change=named)
    source = open_frames(path, ANY)
    for number in (3, 0, 3):
        assert [obj.track_id for obj in source.frame(number).objects] == expected
    source.close()
