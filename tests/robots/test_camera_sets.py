# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""--all-cameras: one data set for each camera, in every layout, by the command and by a plan."""

from __future__ import annotations

import json
from dataclasses import replace

import camera_rigs
import cv2
import numpy as np
import pytest
import small_rigs
from camera_rigs import assert_true, moved

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Stream

ROBOT = small_rigs.sides('front', 'Left', 'rear')
FOLDERS = ('front', 'Left', 'rear')


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return str(camera_rigs.write(ROBOT, tmp_path_factory.mktemp('robot') / 'bag'))


@pytest.mark.parametrize('layout', ['raw', 'odometry', 'tracking'])
def test_other_layouts_have_a_folder_for_each_camera(bag, layout, tmp_path):
    out = tmp_path / 'out'
    words = ['to-kitti', bag, str(out), '--layout', layout, '--all-cameras', '-q']
    assert main(words) == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(FOLDERS)
    inodes = set()
    for camera, name in zip(ROBOT.cameras, FOLDERS, strict=True):
        (split,) = [*(out / name).glob('*/*_drive_*'), *(out / name).glob('sequences/*'),
                    *(out / name).glob('training')]  # fmt: skip
        recording = open_recording(split)
        calibration = recording.calibration(0)
        points = recording.read(Stream.SCAN, 1).points[:, :3]
        seen = np.isfinite(camera.pixels(camera_rigs.world())[:, 0])
        rect = moved(calibration.cam0_T_velo.matrix(), points) @ calibration.r0_rect.T
        pixels = moved(np.vstack([calibration.cameras[2].p_rect, [0, 0, 0, 1]]), rect[seen])
        true = camera.pixels(camera_rigs.world())[seen]
        assert np.abs(pixels[:, :2] / pixels[:, 2:] - true).max() < 0.3
        scans = sorted(split.rglob('*.bin'))
        assert len(scans) == camera_rigs.FRAMES
        inodes.add(scans[0].stat().st_ino)
    assert len(inodes) == 1


def test_a_printed_plan_gives_the_same_sets_and_overwrite_replaces_them(bag, tmp_path, capsys):
    assert main(['to-kitti', bag, '--layout', 'object', '--all-cameras', '--plan']) == 0
    plan = tmp_path / 'plan.yaml'
    plan.write_text(capsys.readouterr().out)
    assert 'camera_sets:' in plan.read_text()
    assert '\ncameras:' not in plan.read_text()
    out = tmp_path / 'out'
    for words in ([], ['--all-cameras', '--overwrite']):
        assert main(['to-kitti', bag, str(out), '--plan-file', str(plan), *words]) == 0
    said = capsys.readouterr().out
    assert f'{out}: layout object, training_Left, 3 frames' in said
    for camera in ROBOT.cameras:
        assert_true(out / f'training_{camera.folder[1:]}', camera)
    (out / 'mine.txt').write_text('keep\n')
    assert main(['to-kitti', bag, str(out), '--plan-file', str(plan), '--overwrite']) == 2
    assert (out / 'mine.txt').is_file()


def test_a_part_of_the_frames_is_the_same_part_of_all(bag, tmp_path):
    out = tmp_path / 'out'
    words = ['--layout', 'object', '--all-cameras', '--start', '1', '--end', '1']
    assert main(['to-kitti', bag, str(out), *words]) == 0
    for name in FOLDERS:
        assert len(list((out / f'training_{name}').rglob('*.png'))) == 1


def test_only_frames_that_all_cameras_have_are_numbered(tmp_path):
    """The last image of one camera is missing."""
    robot = small_rigs.sides('front', 'left')
    path = camera_rigs.write(robot, tmp_path / 'bag', leave_out=(('/left/image_rect_color', 1),))
    out = tmp_path / 'out'
    assert main(['to-kitti', str(path), str(out), '--layout', 'object', '--all-cameras']) == 0
    for camera in robot.cameras:
        split = out / f'training_{camera.folder[1:]}'
        assert len(list((split / 'velodyne').iterdir())) == camera_rigs.FRAMES - 1
        assert_true(split, camera, 1)


@pytest.mark.parametrize(
    ('words', 'change', 'complaint'),
    [
        (['--append'], {}, '--append continues one object set'),
        (['--calib', 'x.txt'], {}, 'calibration: x.txt; expected tf'),
        ([], {'  Left:': '  ../Left:'}, "camera_sets: '../Left'; expected a name of letters"),
        ([], {'  Left:': '  FRONT:'}, 'names of sets must differ by more than case'),
        ([], {'  Left:': '  7:'}, 'camera_sets: 7; expected a name'),
        ([], {'camera_sets:': 'cameras: {2: {topic: /x}}\ncamera_sets:'}, 'expected no cameras'),
        ([], {'camera_sets:': 'camera_sets: 3\nx:'}, 'camera_sets: 3; expected names of sets'),
    ],
)  # fmt: skip
def test_sets_that_cannot_be_made_are_refused(bag, words, change, complaint, tmp_path, capsys):
    assert main(['to-kitti', bag, '--layout', 'object', '--all-cameras', '--plan']) == 0
    text = capsys.readouterr().out
    for before, after in change.items():
        assert before in text
        text = text.replace(before, after)
    plan = tmp_path / 'plan.yaml'
    plan.write_text(text)
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, str(out), '--plan-file', str(plan), *words]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count('\n') == 1
    assert not out.exists()


def test_a_camera_that_nothing_joins_is_passed_over_by_name(tmp_path, capsys):
    links = tuple(link for link in ROBOT.links if link[1] != ROBOT.cameras[1].frame)
    path = camera_rigs.write(replace(ROBOT, links=links), tmp_path / 'bag')
    out = tmp_path / 'out'
    assert main(['to-kitti', str(path), str(out), '--layout', 'object', '--all-cameras']) == 0
    told = 'passed over: /Left/image_rect_color; no static transform joins Left_eye to lidar'
    assert told in capsys.readouterr().out
    assert sorted(file.name for file in out.glob('training*')) == [
        'training_front',
        'training_rear',
    ]
    assert_true(out / 'training_front', ROBOT.cameras[0])


def rectified_pair(*, left_r, right_r, left_m=0.0):
    """A stereo pair whose TF has rectified frames, and the R of unrectified cameras."""
    robot = small_rigs.stereo()
    left, right = robot.cameras
    left = replace(left, r=left_r, offset_m=left_m)
    right = replace(right, r=right_r, offset_m=left_m + right.offset_m)
    return replace(robot, cameras=(left, right))


@pytest.mark.parametrize('left_m', [0.0, 0.06])
def test_frames_mean_in_each_set_what_they_mean_in_a_plan_of_all(left_m, tmp_path, capsys):
    robot = rectified_pair(
        left_r=camera_rigs.turned(0.9, 0.4), right_r=camera_rigs.turned(-0.6, 0.7), left_m=left_m
    )
    bag = str(camera_rigs.write(robot, tmp_path / 'bag'))
    words = ['--layout', 'object']
    assert main(['to-kitti', bag, str(tmp_path / 'pair'), *words]) == 0
    assert main(['to-kitti', bag, str(tmp_path / 'sets'), *words, '--all-cameras']) == 0
    assert capsys.readouterr().out.count('stereo_right: taken as rectified frames') == 2
    for index, camera in enumerate(robot.cameras, 2):
        assert_true(tmp_path / 'pair/training', camera, index=index)
        assert_true(tmp_path / f'sets/training_{camera.folder.rpartition("/")[2]}', camera)


def test_a_plan_of_the_right_camera_alone_is_compared_with_the_left_one(tmp_path):
    robot = rectified_pair(left_r=np.eye(3), right_r=camera_rigs.turned(-0.6, 0.7))
    bag = str(camera_rigs.write(robot, tmp_path / 'bag'))
    plan = tmp_path / 'plan.yaml'
    plan.write_text(
        'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
        'scan: {topic: /lidar/points, frame: lidar}\n'
        'cameras: {2: {topic: /stereo/right/image_rect_color, info: /stereo/right/camera_info}}\n'
    )
    assert main(['to-kitti', bag, str(tmp_path / 'out'), '--plan-file', str(plan)]) == 0
    assert_true(tmp_path / 'out/training', robot.cameras[1])


def test_x_forward_pairs_of_simulators_count_a_baseline_once_in_each_set(tmp_path):
    stereo = small_rigs.stereo()
    bodies = {
        each.frame: each.base_T_camera @ camera_rigs.pose(camera_rigs.OPTICAL.T, (0.0, 0.0, 0.0))
        for each in stereo.cameras
    }
    links = tuple(
        (parent, child, bodies.get(child, place)) for parent, child, place in stereo.links
    )
    bag = str(camera_rigs.write(replace(stereo, links=links), tmp_path / 'bag'))
    words = ['--layout', 'object', '--all-cameras']
    assert main(['to-kitti', bag, str(tmp_path / 'sets'), *words]) == 0
    for camera in stereo.cameras:
        assert_true(tmp_path / f'sets/training_{camera.folder.rpartition("/")[2]}', camera)


def test_all_cameras_needs_camera_infos(tmp_path, capsys):
    robot = replace(small_rigs.sides('front', 'left'), with_boxes=False)
    path = camera_rigs.write(
        robot,
        tmp_path / 'bag',
        leave_out=(('/left/camera_info', None), ('/front/camera_info', None)),
    )
    assert (
        main(['to-kitti', str(path), str(tmp_path / 'o'), '--layout', 'object', '--all-cameras'])
        == 2
    )
    assert '--all-cameras needs cameras with a camera_info' in capsys.readouterr().err


def test_a_camera_whose_clock_differs_is_in_its_set(tmp_path, capsys):
    ahead = {'/Left': 37 * 10**9}
    bag = str(camera_rigs.write(ROBOT, tmp_path / 'bag', ahead_ns=ahead))
    assert main(['to-kitti', bag, '--layout', 'object', '--all-cameras', '--plan']) == 0
    text = capsys.readouterr().out
    assert 'camera_sets.Left.offset_s -37.0 corrects it' in text
    assert text.count('offset_s: -37.0') == 1
    assert text.count('offset_s:') == 1
    out = tmp_path / 'out'
    assert main(['to-kitti', bag, str(out), '--layout', 'object', '--all-cameras']) == 0
    for camera in ROBOT.cameras:
        assert_true(out / f'training_{camera.folder[1:]}', camera)
    plan = tmp_path / 'plan.yaml'
    plan.write_text(text.replace('offset_s: -37.0', 'offset_s: 0.0'))
    capsys.readouterr()
    assert main(['to-kitti', bag, str(tmp_path / 'apart'), '--plan-file', str(plan)]) != 0
    assert 'set camera_sets.Left.offset_s: -37.0' in capsys.readouterr().err
    assert not (tmp_path / 'apart').exists()


def test_the_look_and_the_preview_show_all_sets(bag, tmp_path, capsys):
    path = tmp_path / 'preview.png'
    words = ['to-kitti', bag, '--layout', 'object', '--all-cameras']
    assert main([*words, '--preview', str(path)]) == 0
    said = capsys.readouterr().out
    assert 'no camera' not in said
    assert 'frames 0, 1, 2' in said
    height, width = cv2.imread(str(path)).shape[:2]
    assert height > 3 * camera_rigs.SIZE[1]
    assert width > 3 * camera_rigs.SIZE[0]
    assert main([*words, '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['faults'] == []
    assert told['frames'] == camera_rigs.FRAMES
    assert told['passed_over'] == []
    images = [each['topic'] for each in told['topics'] if each['streams'] == ['image_2']]
    assert images == sorted(camera.topic for camera in ROBOT.cameras)
