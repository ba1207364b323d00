# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import re

import pytest

from kitti_ros2.kitti.find import LAYOUTS, make_writer
from kitti_ros2.kitti.names import parse_drive, parse_sequence
from kitti_ros2.kitti.opening import guess_layout, open_recording
from kitti_ros2.model.errors import (
    AmbiguousLayoutError,
    AmbiguousSequenceError,
    NotKittiError,
    UsageError,
)
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.read import ReadOptions


def put(folder, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b'')


def test_each_layout_is_guessed(recordings):
    assert {layout: guess_layout(path) for layout, path in recordings.items()} == {
        layout: layout for layout in Layout
    }


def test_a_level_above_and_below_is_found(recordings):
    raw = recordings[Layout.RAW]
    assert guess_layout(raw.parent) is Layout.RAW
    assert guess_layout(raw.parent.parent) is Layout.RAW
    assert guess_layout(recordings[Layout.OBJECT] / 'training') is Layout.OBJECT
    assert guess_layout(recordings[Layout.TRACKING] / 'training') is Layout.TRACKING
    odometry = recordings[Layout.ODOMETRY]
    assert guess_layout(odometry / 'sequences') is Layout.ODOMETRY
    assert guess_layout(odometry / 'sequences' / '00') is Layout.ODOMETRY


@pytest.mark.parametrize('inside', [[], ['notes.txt'], ['a/b/c.png']])
def test_what_is_no_kitti(tmp_path, inside):
    put(tmp_path, *inside)
    with pytest.raises(NotKittiError, match=re.escape(str(tmp_path))):
        guess_layout(tmp_path)


def test_absent_path_and_file(tmp_path):
    with pytest.raises(NotKittiError, match='no such file or folder'):
        open_recording(tmp_path / 'absent')
    put(tmp_path, 'file.txt')
    with pytest.raises(NotKittiError, match='is a file'):
        open_recording(tmp_path / 'file.txt')


def test_a_folder_that_fits_two_layouts_asks(tmp_path):
    put(tmp_path, 'training/velodyne/000000.bin', 'training/velodyne/0000/000000.bin')
    with pytest.raises(AmbiguousLayoutError, match=r'object and tracking.*--layout object'):
        guess_layout(tmp_path)
    recording = open_recording(tmp_path, ReadOptions(layout=Layout.TRACKING))
    assert recording.layout is Layout.TRACKING


def test_scans_and_images_alone_fit_two_layouts(tmp_path):
    put(tmp_path, 'velodyne/000000.bin', 'image_2/000000.png')
    with pytest.raises(AmbiguousLayoutError, match='object and odometry'):
        guess_layout(tmp_path)


def test_a_forced_layout_that_is_not_there(recordings):
    with pytest.raises(NotKittiError, match='no odometry recording'):
        open_recording(recordings[Layout.RAW], ReadOptions(layout=Layout.ODOMETRY))


def test_several_sequences_ask_for_one(tmp_path):
    for name in ('00', '01'):
        put(tmp_path, f'sequences/{name}/velodyne/000000.bin', f'sequences/{name}/times.txt')
        (tmp_path / 'sequences' / name / 'times.txt').write_text('0.0\n')
    with pytest.raises(
        AmbiguousSequenceError, match=r'2 sequences \(00, 01\); choose one with --sequence'
    ):
        open_recording(tmp_path)
    assert open_recording(tmp_path, ReadOptions(sequence='1')).name == '01'
    with pytest.raises(UsageError, match=r"'7'.*00, 01"):
        open_recording(tmp_path, ReadOptions(sequence='7'))


def test_raw_drives_are_chosen_by_their_number(tmp_path):
    for number in (1, 5):
        put(
            tmp_path,
            f'2011_09_26/2011_09_26_drive_000{number}_sync/velodyne_points/data/0000000000.bin',
        )
    assert open_recording(tmp_path, ReadOptions(sequence='5')).name.endswith('0005_sync')


def test_folders_without_a_single_usable_file(tmp_path):
    put(tmp_path, '2011_09_26_drive_0001_sync/velodyne_points/data/readme.md')
    with pytest.raises(NotKittiError, match='no data file'):
        open_recording(tmp_path)


def test_object_takes_training_and_says_what_it_leaves(tmp_path):
    put(tmp_path, 'training/velodyne/000000.bin', 'testing/velodyne/000000.bin')
    recording = open_recording(tmp_path)
    assert recording.name == 'training'
    assert any('testing left out' in note for note in recording.notes)
    assert open_recording(tmp_path, ReadOptions(sequence='testing')).name == 'testing'


def test_each_layout_has_a_reader_and_a_writer_of_its_default_name(tmp_path):
    assert set(LAYOUTS) == set(Layout)
    for layout in Layout:
        name = layout.traits.default_name.format(date='2011_09_26', kind='sync')
        writer = make_writer(layout, tmp_path, name)
        assert writer.layout is layout
        with pytest.raises(UsageError):
            make_writer(layout, tmp_path, 'no such name')


def test_names_of_drives_and_sequences():
    assert parse_drive('2011_09_26_drive_0005_sync') == ('2011_09_26', 5, 'sync')
    assert parse_sequence('07') == 7
    for name in ('drive', '../2011_09_26_drive_0005_sync', '2011_09_26_drive_5_sync'):
        with pytest.raises(UsageError):
            parse_drive(name)
    for name in ('', 'a', '../1', '12345', '-1'):
        with pytest.raises(UsageError):
            parse_sequence(name)
