# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360, by way of its bag, as KITTI's object sets and odometry sequences.

Numbers of points, of boxes and of poses are those of README.md beside the real files, found with
NumPy alone; they are skipped without these.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from field_readers import check_mmdet3d, check_openpcdet, points_in_labels

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.kitti_recording import rect_from_imu
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import join
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions, Preset
from kitti_ros2.options.outputs import BagOptions, ImportOptions

from builders import convert_recording  # isort: skip

D = '2013_05_28_drive_{}_sync'
COURSE = 'extra/course_boxes/BBoxes_1134.json'
SCANS = 'data_3d_raw/{}/velodyne_points/data/{:010d}.bin'
IMAGES = 'data_2d_raw/{}/image_{:02d}/{}/{:010d}.png'
# Of a frame: points, and those in image_00 and image_01.
FRAMES = {('0000', 1134): (112580, 25407, 25225), ('0008', 3000): (111883, 27707, 27128)}


@pytest.fixture(scope='module')
def bags(real_360, tmp_path_factory):
    """The bags of drives 0000 and 0008, the first with an image of each fisheye."""
    folder = tmp_path_factory.mktemp('kitti360_bags')
    shutil.copytree(real_360, folder / 'set', copy_function=shutil.copyfile)
    fisheye = real_360 / IMAGES.format(D.format('0003'), 2, 'data_rgb', 0)
    for camera in (2, 3):
        path = folder / 'set' / IMAGES.format(D.format('0000'), camera, 'data_rgb', 1134)
        path.parent.mkdir(parents=True)
        shutil.copyfile(fisheye, path)
    made = {}
    for drive in ('0000', '0003', '0008'):
        made[drive] = folder / f'{drive}.mcap'
        convert_recording(folder / 'set/data_poses' / D.format(drive), made[drive])
    made['kitti2bag'] = folder / 'kitti2bag.bag'
    names = MessageOptions(preset=Preset.KITTI2BAG)
    source = folder / 'set/data_poses' / D.format('0000')
    convert_recording(source, made['kitti2bag'], names, storage='ros1')
    return made


def convert(bag, out, layout, **scan):
    """The report of a conversion, and its plan; scan are other fields of the plan's."""
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    guessed = guess([bag], survey, options)
    plan = guessed.plan
    if scan:
        plan = replace(plan, scan=replace(plan.scan, **scan))
    report = convert_by_plan([bag], plan, survey, out, options)
    return replace(report, losses=(*guessed.losses, *report.losses)), guessed


def read_calib(path):
    rows = (line.split(':') for line in path.read_text().splitlines() if line)
    return {key: np.array(values.split(), float) for key, values in rows}


def counts(split):
    """The points of the first frame in images 2 and 3, as KITTI's devkit projects them."""
    calib = read_calib(split / 'calib/000000.txt')
    points = np.fromfile(split / 'velodyne/000000.bin', np.float32).reshape(-1, 4)
    rect = calib['R0_rect'].reshape(3, 3) @ calib['Tr_velo_to_cam'].reshape(3, 4)
    seen = np.column_stack([points[:, :3].astype(np.float64), np.ones(len(points))]) @ rect.T
    found = []
    for key in ('P2', 'P3'):
        u, v, depth = calib[key].reshape(3, 4) @ np.vstack([seen.T, np.ones(len(seen))])
        ahead = depth > 0
        u, v = u[ahead] / depth[ahead], v[ahead] / depth[ahead]
        found.append(int(((u >= 0) & (u < 1408) & (v >= 0) & (v < 376)).sum()))
    return len(points), *found


@pytest.mark.parametrize(('drive', 'number'), FRAMES)
def test_points_in_the_images_of_an_object_set(real_360, bags, drive, number, tmp_path):
    report, guessed = convert(bags[drive], tmp_path / 'out', Layout.OBJECT)
    split = tmp_path / 'out/training'
    assert not report.losses
    assert counts(split) == FRAMES[drive, number]
    for camera, folder in ((0, 'image_2'), (1, 'image_3')):
        path = real_360 / IMAGES.format(D.format(drive), camera, 'data_rect', number)
        if path.is_file():
            assert (split / folder / '000000.png').read_bytes() == path.read_bytes()
    # Loaders take x of the scans as the optical axis, seen from above.
    assert any('turned by 2.5 degrees about z' in note for note in guessed.notes)
    calib = read_calib(split / 'calib/000000.txt')
    axis = calib['Tr_velo_to_cam'].reshape(3, 4)[2, :3]
    assert abs(np.degrees(np.arctan2(axis[1], axis[0]))) < 1e-3
    own = np.fromfile(real_360 / SCANS.format(D.format(drive), number), np.float32).reshape(-1, 4)
    scan = np.fromfile(split / 'velodyne/000000.bin', np.float32).reshape(-1, 4)
    assert np.array_equal(scan[:, 3], own[:, 3])
    np.testing.assert_allclose(scan[:, 2], own[:, 2], atol=1e-6)
    np.testing.assert_allclose(np.hypot(*scan.T[:2]), np.hypot(*own.T[:2]), atol=2e-5)


def test_scans_are_those_of_the_files_on_request(real_360, bags, tmp_path):
    convert(bags['0000'], tmp_path / 'out', Layout.OBJECT, forward='')
    own = real_360 / SCANS.format(D.format('0000'), 1134)
    assert (tmp_path / 'out/training/velodyne/000000.bin').read_bytes() == own.read_bytes()
    assert counts(tmp_path / 'out/training') == FRAMES['0000', 1134]


def test_all_four_projections_are_those_of_the_pair(bags, tmp_path):
    for drive in ('0000', '0008', 'kitti2bag'):
        _, guessed = convert(bags[drive], tmp_path / drive, Layout.OBJECT)
        assert guessed.plan.scan.forward == 'camera'
        calib = read_calib(tmp_path / drive / 'training/calib/000000.txt')
        assert [calib[f'P{index}'][3] for index in range(4)] == [0, -328.318735, 0, -328.318735]


def test_fisheyes_are_passed_over(bags):
    guessed = guess([bags['0000']], survey_bags([bags['0000']]), ImportOptions(Layout.OBJECT))
    for camera in (2, 3):
        topic = f'/kitti/camera_{camera}/image_raw/compressed'
        assert f'passed over: {topic}; it is a fisheye' in guessed.notes
    assert [camera.topic for camera in guessed.plan.cameras.values()] == [
        f'/kitti/camera_{own}/image_rect/compressed' for own in (0, 1)
    ]


# Boxes: a Detection3DArray in velo_link a frame, with the classes of the data set.


def cuboids_of_course(real_360, velo_t_rect):
    """The boxes of a course, eight corners in the rectified camera 0, as boxes in velo_link."""
    for box in json.loads((real_360 / COURSE).read_text()):
        corners = np.array(box['corners_cam0']) @ velo_t_rect[:3, :3].T + velo_t_rect[:3, 3]
        middle = corners.mean(axis=0)
        _, lengths, axes = np.linalg.svd(corners - middle)
        sizes = 2 * lengths / np.sqrt(8)
        up = int(np.argmax(np.abs(axes[:, 2])))
        ahead, aside = (axis for axis in range(3) if axis != up)
        z = axes[up] * np.sign(axes[up, 2])
        rotation = np.column_stack([axes[ahead], np.cross(z, axes[ahead]), z])
        size = (sizes[ahead], sizes[aside], sizes[up])
        yield Cuboid('car', str(box['index']), Transform(rotation, middle), size)


def with_boxes(bag, out, cuboids):
    """The bag with boxes at the stamp of each scan."""
    with open_messages(bag) as messages, open_bag(out, BagOptions(), TYPESTORE) as writer:
        ids = {
            topic: writer.add_channel(Channel(topic, kind, latched=topic in messages.latched))
            for topic, kind in messages.channels
        }
        kind = 'vision_msgs/msg/Detection3DArray'
        boxes = writer.add_channel(Channel('/kitti/labels/detections', kind, latched=False))
        for message in messages:
            writer.write(ids[message.topic], message.stamp_ns, [bytes(message.data)])
            if message.topic == '/kitti/velo/points':
                parts = encode_detections(cuboids, message.stamp_ns, 'velo_link')
                writer.write(boxes, message.stamp_ns, [join(parts)])
    return out


def test_boxes_become_labels_that_programs_accept(real_360, bags, tmp_path):
    rig = open_recording(real_360 / 'data_poses' / D.format('0000')).calibration(0)
    rect_t_velo = Transform(rig.r0_rect, np.zeros(3)) @ rig.cam0_T_velo
    cuboids = [*cuboids_of_course(real_360, np.linalg.inv(rect_t_velo.matrix()))]
    scan = np.fromfile(real_360 / SCANS.format(D.format('0000'), 1134), np.float32).reshape(-1, 4)
    inside = [
        (abs((scan[:, :3] - box.velo_T_box.translation) @ box.velo_T_box.rotation)
         <= np.array(box.size_lwh) / 2).all(axis=1).sum()
        for box in cuboids
    ]  # fmt: skip
    assert inside == [3554, 2570, 837, 57, 4816, 3775, 1774, 7, 0, 0, 0, 0]
    bag = with_boxes(bags['0000'], tmp_path / 'boxes.mcap', cuboids)
    report, guessed = convert(bag, tmp_path / 'out', Layout.OBJECT)
    assert guessed.plan.labels.classes == {'car': 'Car'}
    lines = (tmp_path / 'out/training/label_2/000000.txt').read_text().splitlines()
    assert len(lines) == 10
    assert {line.split()[0] for line in lines} == {'Car'}
    # One is behind the camera, one beside it; the lean is the camera's, which looks down.
    assert '2 boxes out of view were left out of the labels' in report.notes
    assert any('boxes lean by up to 5 degrees' in note for note in report.notes)
    assert check_openpcdet(tmp_path / 'out') == []
    assert all('empty part' in line for line in check_mmdet3d(tmp_path / 'out', whole=True))
    # Loaders place the boxes in the scans upright, and count points in view of the camera only.
    (loaded,) = points_in_labels(tmp_path / 'out').values()
    assert loaded[:3] == pytest.approx([2570, 837, 57], rel=0.05)


# Odometry: frames with a pose of their own.


def test_poses_alone_are_those_of_the_rectified_camera_0(real_360, bags, tmp_path):
    report, _ = convert(bags['0003'], tmp_path / 'out', Layout.ODOMETRY)
    assert (report.frames, report.losses) == (1010, ())
    poses = np.loadtxt(tmp_path / 'out/poses/00.txt').reshape(-1, 3, 4)
    assert np.allclose(poses[0], np.eye(3, 4), atol=1e-12)
    rows = np.loadtxt(real_360 / f'data_poses/{D.format("0003")}/cam0_to_world.txt')
    own = rows[:, 1:].reshape(-1, 4, 4)
    expected = (np.linalg.inv(own[0]) @ own)[:, :3]
    np.testing.assert_allclose(poses[..., :3], expected[..., :3], atol=5e-6)
    np.testing.assert_allclose(poses[..., 3], expected[..., 3], atol=2e-3)  # its rounding


@pytest.fixture
def with_holes(recordings, tmp_path):
    """The bag of a drive with poses of frames 1, 2 and 4, no packets, and the drive with all."""
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    shutil.rmtree(tmp_path / f'set/data_poses/{D.format("0000")}/oxts')
    (path,) = (tmp_path / 'set').glob('data_poses/*/poses.txt')
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(''.join(line for line in lines if not line.startswith('3 ')))
    convert_recording(tmp_path / 'set', tmp_path / 'holes.mcap')
    whole = open_recording(recordings[Layout.KITTI_360])
    return tmp_path / 'holes.mcap', whole


def test_frames_without_a_pose_get_none(with_holes, tmp_path):
    bag, whole = with_holes
    report, guessed = convert(bag, tmp_path / 'out', Layout.ODOMETRY)
    assert guessed.plan.pose.interpolate is False
    (loss,) = report.losses
    assert (loss.count, loss.stream) == (1, guessed.plan.pose.topic)
    assert loss.text().endswith('no frame is written here, for it has no pose of its own')
    assert any('2 of 5 frames: no pose' in note and '1 before' in note for note in report.notes)
    sequence = open_recording(tmp_path / 'out')
    assert len(sequence.streams[Stream.SCAN]) == len(sequence.streams[Stream.POSE]) == 3
    imu_t_cam = np.linalg.inv(rect_from_imu(whole.calibration(0)).matrix())
    cameras = []
    for line, number in enumerate((1, 2, 4)):
        scans = (sequence.read(Stream.SCAN, line), whole.read(Stream.SCAN, number))
        assert scans[0].points.tobytes() == scans[1].points.tobytes()
        cameras.append(whole.read(Stream.POSE, number).world_T_imu.matrix() @ imu_t_cam)
    expected = (np.linalg.inv(cameras[0]) @ cameras)[:, :3]
    poses = np.loadtxt(tmp_path / 'out/poses/00.txt').reshape(-1, 3, 4)
    np.testing.assert_allclose(poses, expected, atol=1e-5)


def test_packets_are_of_frames_with_a_pose(with_holes, tmp_path):
    report, _ = convert(with_holes[0], tmp_path / 'out', Layout.RAW)
    drive = open_recording(tmp_path / 'out')
    assert drive.streams[Stream.OXTS].numbers.tolist() == [1, 2, 4]
    assert len(drive.streams[Stream.SCAN]) == 5
    assert [loss.count for loss in report.losses] == [1]


def test_a_plan_may_interpolate(with_holes, tmp_path):
    bag, _ = with_holes
    options, survey = ImportOptions(layout=Layout.ODOMETRY), survey_bags([bag])
    plan = guess([bag], survey, options).plan
    plan = replace(plan, pose=replace(plan.pose, interpolate=True))
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    assert (report.frames, report.losses) == (4, ())


@pytest.mark.parametrize('layout', [Layout.OBJECT, Layout.ODOMETRY])
@pytest.mark.parametrize('name', ['calib_cam_to_velo.txt', 'calib_cam_to_pose.txt'])
def test_nominal_mounts_are_losses(recordings, tmp_path, layout, name):
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    (tmp_path / 'set/calibration' / name).unlink()
    convert_recording(tmp_path / 'set', tmp_path / 'bag.mcap')
    report, _ = convert(tmp_path / 'bag.mcap', tmp_path / 'out', layout)
    assert any(
        f'{name}: no such file' in loss.text() and 'the bag has a nominal value' in loss.text()
        for loss in report.losses
    )


def test_its_own_layout_is_not_made_of_others(recordings, tmp_path):
    bag = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.ODOMETRY], bag)
    with pytest.raises(UsageError, match='layout kitti360 is made of bags of its own only'):
        guess([bag], survey_bags([bag]), ImportOptions(layout=Layout.KITTI_360))
