# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti_ros2.open: a folder and its bags give the same frames, with holes in their numbers."""

from __future__ import annotations

import ast
import gc
import multiprocessing
import pickle
import shutil
import warnings
import weakref
from importlib.util import resolve_name
from pathlib import Path

import cv2
import numpy as np
import pytest
from folder_and_bag import BAGS, make_bag, make_holes

import kitti_ros2
from kitti_ros2 import datasets, evaluation
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout, Stream

# Sets with holes warn of them when they are opened.
pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')


@pytest.fixture(params=list(Layout), ids=[layout.value for layout in Layout])
def holed(request, recordings, tmp_path):
    return make_holes(recordings[request.param], request.param, tmp_path)


def assert_same(ours, other):
    assert ours.number == other.number
    assert ours.stamp_ns == other.stamp_ns
    assert ours.streams == other.streams
    if 'scan' in ours.streams:
        np.testing.assert_array_equal(ours.points, other.points)
    for camera in (0, 1, 2, 3):
        if f'image_{camera}' in ours.streams:
            assert ours.png(camera) == other.png(camera)
            np.testing.assert_array_equal(ours.image(camera), other.image(camera))
    assert (ours.pose is None) == (other.pose is None)
    if ours.pose is not None:
        # Seven digits of a matrix in odometry are no exact rotation; a quaternion is.
        np.testing.assert_allclose(ours.pose, other.pose, atol=1e-6)
    assert ours.oxts == other.oxts
    for mine, its in zip(ours.objects, other.objects, strict=True):
        assert (mine.class_name, mine.box_2d, mine.track) == (its.class_name, its.box_2d, its.track)
        assert mine.has_box == its.has_box
        if mine.has_box:
            np.testing.assert_allclose(mine.corners(2), its.corners(2), atol=1e-6)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('storage', BAGS)
def test_folder_and_bag_are_the_same(holed, storage, tmp_path):
    folder = kitti_ros2.open(holed)
    with kitti_ros2.open(make_bag(holed, tmp_path / 'bag', storage)) as bag:
        assert bag.numbers.tolist() == folder.numbers.tolist()
        assert bag.streams.keys() == folder.streams.keys()
        for ours, other in zip(folder, bag, strict=True):
            assert_same(ours, other)


def test_an_extract_pairs_streams_by_time(recordings, tmp_path):
    """Numbers of its streams are independent: image 0 is gone, and the scans still count."""
    holed = make_holes(recordings[Layout.RAW], Layout.RAW, tmp_path)
    drive = holed.rename(holed.with_name(holed.name.replace('sync', 'extract')))
    folder = kitti_ros2.open(drive)
    reader = open_recording(drive)
    assert folder.numbers.tolist() == reader.streams[Stream.SCAN].numbers.tolist()
    with kitti_ros2.open(make_bag(drive, tmp_path / 'bag')) as bag:
        for ours, other in zip(folder, bag, strict=True):
            assert_same(ours, other)


def test_frames_are_addressed_by_position_and_by_number(holed):
    recording = kitti_ros2.open(holed)
    numbers = [frame.number for frame in recording]
    assert numbers == recording.numbers.tolist() == sorted(numbers)
    assert len(recording) == len(numbers)
    assert recording[0].number == numbers[0]
    assert recording[-1].number == numbers[-1]
    assert recording.frame(numbers[1]).number == numbers[1]
    assert [frame.number for frame in recording[1:3]] == numbers[1:3]
    assert [frame.number for frame in recording[::-2]] == sorted(numbers[::-2])
    assert recording[1:3].frame(numbers[2]).number == numbers[2]
    with pytest.raises(IndexError, match=f'has {len(numbers)} frames'):
        recording[len(numbers)]
    if numbers[-1] >= len(numbers):
        with pytest.raises(IndexError, match=rf'frame\({numbers[-1]}\) takes file numbers'):
            recording[numbers[-1]]


def test_a_frame_that_is_not_there_is_an_error(holed):
    recording = kitti_ros2.open(holed)[:-1]
    gone = kitti_ros2.open(holed)[-1].number
    with pytest.raises(kitti_ros2.KittiRos2Error, match=f'no frame {gone}; it has '):
        recording.frame(gone)


def test_a_stream_that_the_frame_does_not_have_is_an_error(recordings, tmp_path):
    source = make_holes(recordings[Layout.RAW], Layout.RAW, tmp_path)
    recording = kitti_ros2.open(source)
    without = next(frame for frame in recording if 'scan' not in frame.streams)
    with pytest.raises(
        kitti_ros2.KittiRos2Error, match=f'frame {without.number}: no scan .* other'
    ):
        without.points  # noqa: B018
    with pytest.raises(kitti_ros2.KittiRos2Error, match=r'no image of camera 4 .the recording has'):
        without.image(4)
    with pytest.raises(kitti_ros2.KittiRos2Error, match='camera 7'):
        without.image(7)


def test_arrays_are_as_documented(recording_path):
    frame = kitti_ros2.open(recording_path)[0]
    camera = open_recording(recording_path).layout.traits.main_camera
    assert frame.points.dtype == np.float32
    assert frame.points.shape[1:] == (4,)
    assert frame.points.flags.writeable
    assert frame.points.flags.c_contiguous
    image = frame.image(camera)
    assert image.dtype == np.uint8
    assert image.flags.writeable
    assert image.flags.c_contiguous
    whole = cv2.imdecode(np.frombuffer(frame.png(camera), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(image, cv2.cvtColor(whole, cv2.COLOR_BGR2RGB))


def test_values_are_those_of_the_reader(recording_path):
    reader = open_recording(recording_path)
    recording = kitti_ros2.open(recording_path)
    for frame in recording:
        np.testing.assert_array_equal(frame.points, reader.read(Stream.SCAN, frame.number).points)
        if Stream.OXTS in reader.streams:
            assert frame.oxts == reader.read(Stream.OXTS, frame.number)


def test_iterating_keeps_no_frame(recording_path):
    recording = kitti_ros2.open(recording_path)
    alive = []
    for frame in recording:
        assert len(frame.points)
        alive.append(weakref.ref(frame))
    del frame
    gc.collect()
    assert [each() for each in alive] == [None] * len(recording)


def test_trajectory_is_the_poses_of_the_frames(holed):
    recording = kitti_ros2.open(holed)
    found = recording.trajectory()
    posed = [frame for frame in recording if frame.pose is not None]
    assert found.numbers.tolist() == [frame.number for frame in posed]
    assert found.stamps_ns.tolist() == [frame.stamp_ns for frame in posed]
    assert found.map_T_base.shape == (len(posed), 4, 4)
    for pose, frame in zip(found.map_T_base, posed, strict=True):
        np.testing.assert_array_equal(pose, frame.pose)


def test_a_recording_can_be_pickled(recording_path):
    recording = kitti_ros2.open(recording_path)[1:]
    again = pickle.loads(pickle.dumps(recording))
    assert_same(recording[0], again[0])
    assert len(again) == len(recording)


def _sum_of(pair):
    recording, index = pair
    return float(recording[index].points.sum())


@pytest.mark.parametrize('storage', BAGS)
def test_forked_processes_read_one_bag(storage, recordings, tmp_path):
    recording = kitti_ros2.open(make_bag(recordings[Layout.RAW], tmp_path / 'bag', storage))
    expected = [_sum_of((recording, index)) for index in range(len(recording))]
    with multiprocessing.get_context('fork').Pool(2) as pool:
        pairs = [(recording, index) for index in range(len(recording))] * 4
        assert pool.map(_sum_of, pairs) == expected * 4


def test_a_closed_recording_is_opened_again(recordings, tmp_path):
    recording = kitti_ros2.open(make_bag(recordings[Layout.OBJECT], tmp_path / 'bag'))
    first = recording[0].points
    recording.close()
    np.testing.assert_array_equal(recording[0].points, first)


def test_options_are_those_of_the_command_line(recordings):
    path = recordings[Layout.TRACKING]
    nominal = kitti_ros2.open(path, period=0.2, epoch='2012-01-01 00:00:00')
    assert np.diff(nominal.stamps_ns).tolist() == [200_000_000] * (len(nominal) - 1)
    with pytest.raises(kitti_ros2.KittiRos2Error, match="unknown option 'perod'"):
        kitti_ros2.open(path, perod=0.2)


def test_a_missing_path_is_a_file_not_found_error(tmp_path):
    with pytest.raises(FileNotFoundError, match='no such file or folder') as found:
        kitti_ros2.open(tmp_path / 'nothing')
    assert isinstance(found.value, kitti_ros2.KittiRos2Error)
    assert found.value.path == str(tmp_path / 'nothing')


def test_a_folder_that_is_no_recording_is_an_error(tmp_path):
    with pytest.raises(kitti_ros2.KittiRos2Error, match='the folder is empty'):
        kitti_ros2.open(tmp_path)


def test_a_truncated_scan_is_named(drive):
    path = drive / 'velodyne_points/data/0000000001.bin'
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(kitti_ros2.KittiRos2Error, match='cut inside a point') as found:
        kitti_ros2.open(drive).frame(1).points  # noqa: B018
    assert found.value.path == str(path)


def test_an_invalid_label_is_a_warning_with_its_line(recordings, tmp_path):
    source = tmp_path / 'object'
    shutil.copytree(recordings[Layout.OBJECT], source)
    path = next(source.glob('training/label_2/000000.txt'), None) or next(
        source.glob('label_2/000000.txt')
    )
    lines = path.read_text().splitlines()
    path.write_text('\n'.join([lines[0], 'Car 1 2', *lines[1:]]) + '\n')
    frame = kitti_ros2.open(source)[0]
    with pytest.warns(kitti_ros2.KittiRos2Warning, match=r'000000\.txt:2: 3 columns'):
        assert len(frame.objects) == len(lines)


def test_losses_of_a_recording_are_a_warning(drive):
    (drive / 'image_02/timestamps.txt').unlink()
    with pytest.warns(kitti_ros2.KittiRos2Warning, match='timestamps.txt'):
        recording = kitti_ros2.open(drive)
    assert recording.losses
    assert 'image_2' not in recording.streams


def test_a_whole_recording_warns_of_nothing(recording_path):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for frame in kitti_ros2.open(recording_path):
            assert frame.objects is not None


packages = pytest.mark.parametrize(
    'package', [kitti_ros2, datasets, evaluation], ids=lambda each: each.__name__
)


@packages
def test_public_names_are_the_same_for_python_and_for_type_checkers(package):
    tree = ast.parse(Path(package.__file__).read_text(encoding='utf-8'))
    typed = [
        resolve_name('.' * node.level + node.module, package.__name__).removeprefix('kitti_ros2.')
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.names[0].name in {'*', *package.__all__}
    ]
    assert package.__all__ == list(package._MODULES)
    assert sorted(typed) == sorted(set(package._MODULES.values()))
    for name, module in package._MODULES.items():
        assert getattr(package, name).__module__ == f'kitti_ros2.{module}'


@packages
def test_no_module_hides_a_public_name(package):
    modules = {path.stem for path in Path(package.__file__).parent.glob('*.py')}
    assert not modules & {*package.__all__}


@packages
def test_every_public_name_is_there_and_documented(package):
    for name in package.__all__:
        assert getattr(package, name).__doc__, name
    others = {'__version__', 'datasets', 'evaluation'} if package is kitti_ros2 else set()
    assert set(dir(package)) == {*package.__all__, *others}
    with pytest.raises(AttributeError, match='nothing'):
        package.nothing  # noqa: B018
