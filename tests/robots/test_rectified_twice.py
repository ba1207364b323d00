# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rectified images whose CameraInfo has the lens of the unrectified ones are not rectified again.

kitti2bag writes image_raw of a sync drive so.
"""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import cv2
import numpy as np
import pytest
import small_rigs
from camera_rigs import SIZE, K, assert_true

from kitti_ros2.cli import main

LARGER_K = np.array([[262.0, 0, 0.57 * SIZE[0]], [0, 262.5, 0.6 * SIZE[1]], [0, 0, 1]])
D = (-0.3, 0.12, 0.0008, 0.0007, -0.02)


def kitti2bag_pair(k=LARGER_K):
    """A pair whose TF has the rectified frames, and whose images are rectified."""
    robot = small_rigs.stereo()
    left, right = (
        replace(each, image='image_raw', raw_k=k, d=D, r=camera_rigs.turned(*turn))
        for each, turn in zip(robot.cameras, ((0.9, 0.4), (-0.6, 0.7)), strict=True)
    )
    return replace(robot, cameras=(left, right))


@pytest.mark.parametrize('words', [(), ('--all-cameras',)])
@pytest.mark.parametrize('layout', ['object', 'raw', 'odometry'])
def test_images_that_are_rectified_stay_as_they_are(layout, words, tmp_path, capsys):
    robot = kitti2bag_pair()
    bag = str(camera_rigs.write(robot, tmp_path / 'bag.bag', leave_out=(('/detections', None),)))
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, '--layout', layout, *words, '--plan']) == 0
    plan = capsys.readouterr().out
    assert plan.count('rectify: false') == 2
    topics = ', '.join(each.topic for each in robot.cameras)
    assert f'{topics}: taken as rectified already, for K, D and R of the camera_info' in plan
    assert main(['to-kitti', bag, str(out), '--layout', layout, *words]) == 0
    images = sorted(out.rglob('*.png'))
    assert len(images) == 2 * camera_rigs.FRAMES
    for path in images:
        np.testing.assert_array_equal(cv2.imread(str(path)), 60)
    if layout == 'raw':
        assert not list(out.rglob('*_extract'))
        assert list(out.rglob('*_sync'))
    if layout == 'object':
        for index, camera in enumerate(robot.cameras, 2):
            own = f'_{camera.folder.rpartition("/")[2]}' if words else ''
            assert_true(out / f'training{own}', camera, index=2 if words else index)


@pytest.mark.parametrize('words', [(), ('--all-cameras',)])
@pytest.mark.parametrize('twice', [True, False])
def test_a_size_with_width_and_height_swapped_is_that_of_the_images(twice, words, tmp_path, capsys):
    robot = kitti2bag_pair() if twice else small_rigs.stereo()

    def swapped(camera):
        return replace(camera, size=SIZE[::-1])

    bag = str(camera_rigs.write(robot, tmp_path / 'bag', change_info=swapped))
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, str(out), '--layout', 'object', *words]) == 0
    said = capsys.readouterr().out
    told = 'width and height are swapped; the size of the images is taken'
    assert said.count(told) == (2 if words else 1)
    assert ('taken as rectified already' in said) == twice
    for index, camera in enumerate(robot.cameras, 2):
        own = f'_{camera.folder.rpartition("/")[2]}' if words else ''
        number = 2 if words else index
        assert_true(out / f'training{own}', camera, index=number)
        image = cv2.imread(str(out / f'training{own}/image_{number}/000000.png'))
        np.testing.assert_array_equal(image, np.full((*SIZE[::-1], 3), 60))


@pytest.mark.parametrize('size', [(SIZE[1], SIZE[0] + 1), (2 * SIZE[0], 2 * SIZE[1])])
def test_any_other_size_than_that_of_the_images_is_a_loss(size, tmp_path, capsys):
    def other(camera):
        return replace(camera, size=size)

    bag = str(camera_rigs.write(small_rigs.sides('front'), tmp_path / 'bag', change_info=other))
    assert main(['to-kitti', bag, str(tmp_path / 'out'), '--layout', 'object']) == 1
    said = capsys.readouterr()
    assert f'expected {size[0]}x{size[1]}' in said.out + said.err
    assert 'swapped' not in said.out


def test_a_camera_info_of_images_before_they_were_turned_is_a_loss(tmp_path, capsys):
    """Its principal point is in the middle of its own size."""
    upright = np.array([[200.0, 0, SIZE[1] / 2], [0, 201.0, SIZE[0] / 2], [0, 0, 1]])

    def other(camera):
        return replace(camera, size=SIZE[::-1], k=upright)

    bag = str(camera_rigs.write(small_rigs.sides('front'), tmp_path / 'bag', change_info=other))
    assert main(['to-kitti', bag, str(tmp_path / 'out'), '--layout', 'object']) == 1
    assert 'swapped' not in capsys.readouterr().out


def test_a_camera_with_the_lens_of_its_images_is_rectified(tmp_path, capsys):
    robot = kitti2bag_pair(K)
    bag = str(camera_rigs.write(robot, tmp_path / 'bag'))
    assert main(['to-kitti', bag, '--layout', 'object', '--plan']) == 0
    said = capsys.readouterr().out
    assert said.count('rectify: true') == 2
    assert 'larger image' not in said
