# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Notes on what stops programs that train: label files and lists of frames without a line."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import pytest
import small_rigs
from object_readers import check_mmdet3d, check_openpcdet

from kitti_ros2.cli import main

LISTS = 'ImageSets/val.txt and test.txt are empty'


@pytest.fixture
def converted(tmp_path, capsys):
    def run(robot, *words, layout='object'):
        bag = camera_rigs.write(robot, tmp_path / 'bag')
        words = ['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', layout, *words]
        assert main(words) == 0
        return tmp_path / 'out', capsys.readouterr().out

    return run


def test_empty_label_files_are_counted(converted):
    """The camera looks between the boxes."""
    camera = camera_rigs.Camera('/a', 'eye', camera_rigs.looking(0.0, (14.0, 0.0, 1.0)))
    out, said = converted(small_rigs.joined(camera))
    assert sum('no object' in line for line in check_openpcdet(out)) == camera_rigs.FRAMES
    assert '3 of 3 label files have no line, which stops OpenPCDet' in said


def test_files_with_a_line_have_no_note_and_empty_lists_have_one(converted):
    out, said = converted(small_rigs.sides('front'))
    assert 'have no line' not in said
    assert said.count(LISTS) == 1
    assert '--split 0.8' in said
    assert [line for line in check_mmdet3d(out, whole=True) if 'empty part' in line]


def test_after_a_split_test_alone_is_empty(converted):
    _, said = converted(small_rigs.sides('front'), '--split', '0.5')
    assert 'ImageSets/test.txt is empty' in said
    assert '--split' not in said


def test_sets_of_all_cameras_have_the_lists_in_common(converted):
    _, said = converted(small_rigs.sides('front', 'left'), '--all-cameras')
    assert said.count(LISTS) == 1


def test_only_object_sets_with_labels_are_for_training(converted):
    _, said = converted(small_rigs.sides('front'), layout='tracking')
    assert 'ImageSets' not in said


def test_sets_without_labels_have_no_note(converted):
    robot = replace(small_rigs.sides('front'), with_boxes=False)
    _, said = converted(robot)
    assert 'ImageSets' not in said


def test_the_origin_of_an_own_bag_is_refused(tmp_path, capsys):
    assert main(['demo', str(tmp_path / 'drive'), '--count', '2', '-q']) == 0
    assert main(['to-bag', str(tmp_path / 'drive/kitti'), str(tmp_path / 'bag'), '-q']) == 0
    capsys.readouterr()
    call = ['to-kitti', str(tmp_path / 'bag'), str(tmp_path / 'out'), '--origin', '49,8.4,110']
    assert main(call) == 2
    said = capsys.readouterr().err
    assert '--origin' in said
    assert said.count('\n') == 1
    assert not (tmp_path / 'out').exists()
