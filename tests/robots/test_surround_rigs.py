# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The camera that looks ahead becomes camera 2, whatever the names, and the set is right."""

from __future__ import annotations

import sys
from dataclasses import replace

import camera_rigs
import numpy as np
import pytest
import small_rigs
from autoware_rig import autoware_rig
from camera_rigs import assert_true, read_frame
from nuscenes_car import nuscenes_car

from kitti_ros2.cli import main
from kitti_ros2.importer.plan import parse_plan


@pytest.fixture
def convert(tmp_path, capsys):
    """Convert a robot's bag; returns the plan, its notes, and the split."""

    def run(robot, *options, code=0):
        bag = camera_rigs.write(robot, tmp_path / 'bag')
        words = ['to-kitti', str(bag), '--layout', 'object', *options]
        assert main([*words, '--plan']) == 0
        printed = capsys.readouterr().out
        assert main(['to-kitti', str(bag), str(tmp_path / 'out'), *words[2:]]) == code
        plan = parse_plan(printed, tmp_path / 'plan.yaml')
        return plan, printed.split('layout:')[0], tmp_path / 'out' / 'training'

    return run


def topics(plan):
    return {number: camera.topic for number, camera in plan.cameras.items()}


@pytest.mark.parametrize('ahead', [0, 3])
def test_autoware_s_camera_ahead_is_camera_2(convert, ahead):
    robot = autoware_rig(ahead)
    camera = robot.cameras[ahead]
    plan, notes, split = convert(robot)
    assert topics(plan) == {2: camera.topic}
    assert (plan.scan.frame, plan.scan.forward) == ('velodyne_top', 'base_link')
    assert notes.count('passed over: /sensing/camera') == 5
    assert '59 degrees to the right' in notes
    frame = assert_true(split, camera)
    assert len(frame.labels) == 1


def test_nuscenes_cam_front_is_camera_2_and_its_lidar_is_turned(convert):
    robot = nuscenes_car()
    plan, notes, split = convert(robot)
    assert topics(plan) == {2: '/CAM_FRONT/image_rect_compressed'}
    assert plan.scan.forward == 'base_link'
    assert 'passed over: /CAM_BACK_LEFT/image_rect_compressed; it looks 110 degrees' in notes
    assert 'passed over: /CAM_BACK/image_rect_compressed; it looks backward' in notes
    assert 'LIDAR_TOP, whose x looks 90 degrees to the right' in notes
    frame = assert_true(split, robot.camera('/CAM_FRONT'))
    assert len(frame.labels) == 1
    for number in (0, 1, 3):
        np.testing.assert_array_equal(frame.calib[f'P{number}'], frame.calib['P2'])
    np.testing.assert_allclose(frame.calib['P2'][:, :3], camera_rigs.K)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'names',
    [
        ('front', 'left', 'right'),
        ('FRONT', 'LEFT', 'RIGHT'),
        ('back', 'front'),
        ('Front', 'rear'),
        ('left', 'right'),
        ('right',),
        ('rear',),
    ],
)
def test_cameras_of_sides_are_no_pairs(convert, names):
    robot = small_rigs.sides(*names)
    plan, _, split = convert(robot)
    best = min(names, key=lambda name: ('front', 'left', 'right').index(name.lower())
               if name.lower() in ('front', 'left', 'right') else 9)  # fmt: skip
    assert topics(plan) == {2: f'/{best}/image_rect_color'}
    assert_true(split, robot.camera(f'/{best}'))


@pytest.mark.parametrize('yaw', [0.0, 180.0])
@pytest.mark.parametrize('joins', [True, False])
def test_a_stereo_pair_is_2_and_3(convert, joins, yaw):
    robot = small_rigs.stereo(joins=joins, yaw=yaw)
    plan, _, split = convert(robot)
    assert topics(plan) == {
        2: '/stereo/left/image_rect_color', 3: '/stereo/right/image_rect_color'
    }  # fmt: skip
    for index, camera in zip((2, 3), robot.cameras, strict=True):
        frame = assert_true(split, camera, index=index)
    assert frame.calib['P3'][0, 3] == pytest.approx(-0.12 * frame.calib['P3'][0, 0])


def test_a_stereo_pair_of_ros_1_is_paired_by_p(tmp_path):
    """The frame of the right camera is joined to nothing."""
    robot = small_rigs.stereo(joins=False)
    right = replace(robot.cameras[1], frame='stereo_right')
    robot = replace(robot, cameras=(robot.cameras[0], right), with_boxes=False)
    bag = camera_rigs.write(robot, tmp_path / 'stereo.bag')
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object']) == 0
    for index, camera in zip((2, 3), robot.cameras, strict=True):
        assert_true(tmp_path / 'out/training', camera, index=index)


def test_a_right_camera_by_p_alone_is_of_the_left_one_of_its_name(convert):
    stereo = small_rigs.stereo(joins=False)
    left, right = stereo.cameras
    front = replace(left, folder='/front', frame='front_eye', base_T_camera=small_rigs.LIDAR)
    right = replace(right, frame='stereo_right')
    front = replace(front, base_T_camera=camera_rigs.looking(0.0, (0.5, 0.0, 1.5)))
    links = (*stereo.links, ('base_link', 'front_eye', front.base_T_camera))
    plan, _, split = convert(replace(stereo, cameras=(front, left, right), links=links))
    assert plan.cameras[2].topic == '/front/image_rect_color'
    assert 3 not in plan.cameras
    assert_true(split, front)


def test_a_camera_in_a_frame_with_x_forward_is_told(convert):
    robot = small_rigs.sides('front')
    links = tuple(
        (parent, child, small_rigs.LIDAR if child == 'front_eye' else place)
        for parent, child, place in robot.links
    )
    plan, notes, _ = convert(replace(robot, links=links, with_boxes=False))
    assert 'z of front_eye is up, so it is taken as a frame with x forward' in notes
    assert plan.cameras[2].forward == 'x'


def test_the_root_of_the_tree_tells_where_forward_is(convert):
    """Neither names of cameras nor a body's frame do."""
    cameras = [
        camera_rigs.Camera(f'/cam_{name}', f'eye_{name}', camera_rigs.looking(yaw, (0.5, 0, 1.0)))
        for name, yaw in (('a', 180.0), ('b', 0.0))
    ]
    robot = small_rigs.joined(*cameras, root='rig')
    lidar = camera_rigs.pose(camera_rigs.turned(-115.0), (0.3, 0.0, 1.2))
    links = tuple(
        (parent, child, lidar if child == 'lidar' else place)
        for parent, child, place in robot.links
    )
    robot = replace(robot, links=links, base_T_lidar=lidar)
    plan, notes, split = convert(robot)
    assert topics(plan) == {2: '/cam_b/image_rect_color'}
    assert plan.scan.forward == 'rig'
    assert '115 degrees to the right (forward is x of rig)' in notes
    assert_true(split, cameras[1])


def test_colour_right_of_grey_is_the_left_colour_camera(convert):
    cameras = [
        camera_rigs.Camera(
            f'/{name}', name, camera_rigs.looking(0.0, (0.5, left, 1.0)), encoding=encoding
        )
        for name, left, encoding in (
            ('gl', 0.30, 'mono8'), ('cl', 0.24, 'bgr8'), ('gr', -0.24, 'mono8'),
            ('cr', -0.30, 'bgr8'),
        )
    ]  # fmt: skip
    plan, *_ = convert(small_rigs.joined(*cameras))
    assert [topics(plan)[index].split('/')[1] for index in range(4)] == ['gl', 'gr', 'cl', 'cr']


def test_a_camera_that_looks_down_is_told(convert):
    down = camera_rigs.Camera('/front', 'eye', camera_rigs.looking(0.0, (0.5, 0.0, 1.0), 90.0))
    robot = replace(small_rigs.joined(down), with_boxes=False)
    _, notes, _ = convert(robot)
    assert 'z of eye, the direction the camera looks in, is 90 degrees down' in notes
    assert 'if it is no optical frame' in notes


@pytest.mark.parametrize(('broken', 'code'), [('front', 2), ('left', 0)])
def test_a_camera_that_is_not_calibrated_matters_where_it_is_taken(broken, code, tmp_path, capsys):
    robot = small_rigs.sides('front', 'left')
    bag = camera_rigs.write(
        robot,
        tmp_path / 'bag',
        change_info=lambda camera: (
            replace(camera, k=np.zeros((3, 3))) if camera.folder == f'/{broken}' else camera
        ),
    )
    words = ['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object']
    assert main(words) == code
    if code:
        assert '/front/camera_info: a CameraInfo that is not calibrated' in capsys.readouterr().err
    else:
        assert_true(tmp_path / 'out/training', robot.cameras[0])
    words[2] = str(tmp_path / 'sets')
    assert main([*words, '--all-cameras']) == 0
    assert f'passed over: /{broken}/image_rect_color; its camera_info' in capsys.readouterr().out
    (split,) = (tmp_path / 'sets').glob('training_*')
    assert_true(split, next(camera for camera in robot.cameras if camera.folder != f'/{broken}'))


def test_a_camera_info_without_a_frame_is_of_the_image_s_frame(tmp_path):
    robot = small_rigs.sides('front')

    def nameless(camera):
        return replace(camera, frame='')

    bag = camera_rigs.write(robot, tmp_path / 'bag', change_info=nameless)
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'object']) == 0
    assert_true(tmp_path / 'out/training', robot.cameras[0])


def test_a_body_has_a_prefix_or_a_namespace(convert):
    robot = nuscenes_car()
    links = tuple(('husky_base_link', child, place) for _, child, place in robot.links)
    plan, _, split = convert(replace(robot, links=links))
    assert plan.scan.forward == 'husky_base_link'
    assert_true(split, robot.camera('/CAM_FRONT'))


def test_a_set_of_one_camera_opens_in_pykitti(tmp_path):
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    robot = autoware_rig()
    bag = camera_rigs.write(robot, tmp_path / 'bag')
    assert main(['to-kitti', str(bag), str(tmp_path / 'out'), '--layout', 'odometry']) == 0
    loaded = pykitti.odometry(str(tmp_path / 'out'), '00')
    assert len(list(loaded.cam2)) == len(list(loaded.velo)) == camera_rigs.FRAMES
    np.testing.assert_allclose(loaded.calib.K_cam0, camera_rigs.K)
    np.testing.assert_allclose(loaded.calib.K_cam2, camera_rigs.K)
    true = robot.cameras[0].pixels(camera_rigs.world())
    seen = np.isfinite(true[:, 0])
    rect = camera_rigs.moved(loaded.calib.T_cam2_velo, next(loaded.velo)[seen, :3])
    pixels = rect @ loaded.calib.K_cam2.T
    assert np.abs(pixels[:, :2] / pixels[:, 2:] - true[seen]).max() < 0.3


def test_a_stereo_pair_without_any_transform_is_paired_by_p(convert):
    robot = replace(small_rigs.stereo(), links=(), with_boxes=False)
    bag_cameras = tuple(robot.cameras)
    plan, _, _ = convert(replace(robot, cameras=bag_cameras), code=2)
    assert sorted(plan.cameras) == [2, 3]


@pytest.mark.parametrize('body', [True, False])
def test_the_infrared_pair_of_a_realsense_is_2_and_3(convert, body):
    robot = small_rigs.realsense(colour=False, body=body)
    plan, _, split = convert(robot)
    assert topics(plan) == {
        2: '/camera/infra1/image_rect_raw', 3: '/camera/infra2/image_rect_raw'
    }  # fmt: skip
    for index, camera in zip((2, 3), robot.cameras, strict=True):
        assert_true(split, camera, index=index)


def test_beside_a_colour_camera_the_infrared_pair_is_0_and_1(convert):
    robot = small_rigs.realsense()
    plan, _, split = convert(robot)
    assert topics(plan) == {
        2: '/camera/color/image_raw',
        0: '/camera/infra1/image_rect_raw',
        1: '/camera/infra2/image_rect_raw',
    }
    assert_true(split, robot.cameras[0])


def test_without_transforms_front_goes_before_left_and_that_is_said(convert):
    robot = replace(small_rigs.sides('left', 'Front', 'right'), links=(), with_boxes=False)
    plan, notes, _ = convert(robot, code=2)
    assert topics(plan) == {2: '/Front/image_rect_color'}
    assert 'camera 2 is /Front/image_rect_color by its name' in notes


def test_topics_of_one_folder_with_several_frames_are_several_cameras(convert):
    robot = small_rigs.sides('left', 'front')
    cameras = tuple(
        replace(camera, folder='/cams', image=camera.folder[1:], info=f'{camera.folder[1:]}_info')
        for camera in robot.cameras
    )
    bare = replace(robot, cameras=cameras)
    plan, _, split = convert(bare)
    assert topics(plan) == {2: '/cams/front'}
    assert_true(split, cameras[1])


def test_each_camera_gets_a_set_with_all_cameras(convert):
    robot = nuscenes_car()
    plan, _, split = convert(robot, '--all-cameras')
    assert set(plan.camera_sets) == {each.folder[1:] for each in robot.cameras}
    assert not plan.cameras
    out = split.parent
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ['ImageSets', *(f'training_{each.folder[1:]}' for each in robot.cameras)]
    )
    assert (out / 'ImageSets/train.txt').read_text() == '000000\n000001\n000002\n'
    first = None
    for camera in robot.cameras:
        own = out / f'training_{camera.folder[1:]}'
        assert_true(own, camera)
        scan = (own / 'velodyne/000001.bin').stat()
        first = first or scan
        assert (scan.st_ino, scan.st_dev) == (first.st_ino, first.st_dev)
    behind = read_frame(out / 'training_CAM_BACK', 0)
    assert len(behind.labels) == 1


@pytest.mark.parametrize('options', [(), ('--all-cameras',)])
def test_a_camera_behind_a_joint_is_passed_over_for_that(convert, options):
    robot = replace(small_rigs.sides('front', 'rear'), swinging=('rear_eye',))
    _, notes, split = convert(robot, *options)
    assert sorted(path.name for path in split.parent.iterdir()) == [
        'ImageSets', 'training_front' if options else 'training',
    ]  # fmt: skip
    moves = 'rear_eye moves against lidar (base_link -> rear_eye), so it has no fixed calibration'
    assert f'passed over: /rear/image_rect_color; {moves}' in notes
    assert '--all-cameras writes' not in notes


def test_another_camera_than_that_behind_a_joint_has_a_set(convert):
    robot = replace(small_rigs.sides('front', 'rear', 'left'), swinging=('rear_eye',))
    _, notes, _ = convert(robot)
    assert 'rear_eye moves against lidar' in notes
    assert '--all-cameras writes a set for each' in notes


def test_the_look_names_the_cameras_that_are_passed_over_in_one_line(tmp_path, capsys, monkeypatch):
    bag = camera_rigs.write(autoware_rig(), tmp_path / 'bag')
    with monkeypatch.context() as patch:
        patch.setattr(sys.stdout, 'isatty', lambda: True)
        assert main(['to-kitti', str(bag)]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith('note: ')]
    (note,) = (line for line in notes if 'passed over: ' in line)
    assert note.count(', it looks ') == 5
    assert len(notes) <= 10
