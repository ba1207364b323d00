# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags as exporters of nuScenes, Argoverse 2 and Waymo write them, by docs/howto/."""

from __future__ import annotations

from dataclasses import replace

import argoverse2_mcap
import cv2
import numpy as np
import nuscenes_mcap
import pytest
import waymo_mcap

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

pytest.importorskip('mcap_protobuf')
pytest.importorskip('foxglove_schemas_protobuf')


def convert(bags, out, change=lambda plan: plan, **options):
    """The object set of bags by the plan that is guessed, changed."""
    chosen = ImportOptions(layout=Layout.OBJECT, **options)
    survey = survey_bags(bags)
    guessed = guess(bags, survey, chosen)
    return convert_by_plan(bags, change(guessed.plan), survey, out, chosen), guessed


def calibration(out, number):
    path = out / 'training/calib' / f'{number:06}.txt'
    rows = dict(line.split(':') for line in path.read_text().splitlines() if line)
    return {name: np.array(text.split(), float).reshape(3, -1) for name, text in rows.items()}


def scan(out, number):
    path = out / 'training/velodyne' / f'{number:06}.bin'
    return np.fromfile(path, '<f4').reshape(-1, 4)


def projected(out, number, points):
    """(N, 2) pixels of image 2, and (N,) depths, of points of a scan."""
    rows = calibration(out, number)
    in_camera = rows['R0_rect'] @ rows['Tr_velo_to_cam'] @ homogeneous(points).T
    seen = (rows['P2'] @ homogeneous(in_camera.T).T).T
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


def homogeneous(points):
    return np.column_stack([points, np.ones(len(points))])


def labels(out, number):
    """(type, height width length x y z rotation_y) of each line."""
    path = out / 'training/label_2' / f'{number:06}.txt'
    lines = [line.split() for line in path.read_text().splitlines()]
    return [(words[0], np.array(words[8:15], float)) for words in lines]


def pinhole(points, base_t_camera, k):
    seen = (np.linalg.inv(base_t_camera) @ homogeneous(points).T)[:3].T
    pixels = seen @ k.T
    return pixels[:, :2] / pixels[:, 2:], seen[:, 2]


SWEEPS = nuscenes_mcap.make_sweeps()


@pytest.fixture(scope='module')
def nuscenes_bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('nuscenes') / 'NuScenes-v1.0-mini-scene-0061.mcap'
    return nuscenes_mcap.write(path, nuscenes_mcap.records(SWEEPS))


def front_only(plan):
    """The front camera, and the tolerance of the page."""
    front = next(camera for camera in plan.cameras.values() if '/cam_front/' in camera.topic)
    return replace(plan, tolerance_s=0.04, cameras={2: front}, labels=None)


def test_nuscenes_points_are_true(nuscenes_bag, tmp_path):
    report, found = convert([nuscenes_bag], tmp_path / 'out', front_only)
    assert found.plan.scan.topic == '/lidar_top'
    assert report.losses == ()
    assert report.frames == 13  # those with an image, at 12 Hz
    seen = 0
    for number in range(report.frames):
        points = scan(tmp_path / 'out', number)
        pixels, depths = projected(tmp_path / 'out', number, points[:, :3])
        for sweep in SWEEPS:
            xyz = np.column_stack([sweep.points[name] for name in 'xyz'])
            base = (nuscenes_mcap.BASE_T_LIDAR @ homogeneous(xyz).T)[:3].T
            camera = nuscenes_mcap.CAMERAS['cam_front']
            expected, expected_depths = pinhole(base, camera, nuscenes_mcap.K)
            if len(points) == len(xyz) and np.abs(depths - expected_depths).max() < 1e-3:
                ahead = depths > 1
                np.testing.assert_allclose(pixels[ahead], expected[ahead], atol=0.05)
                intensity = sweep.points['intensity'] / 255
                np.testing.assert_allclose(points[:, 3], intensity, atol=1e-6)
                seen += 1
    assert seen == report.frames


def test_nuscenes_poses_transforms_and_boxes_are_read(nuscenes_bag):
    with open_messages(nuscenes_bag) as messages:
        types = dict(messages.channels)
        decode = messages.typestore.deserialize_cdr
        boxes = [
            decode(each.data, each.msgtype)
            for each in messages
            if each.topic == '/markers/annotations'
        ]
        left_out = {channel.topic for channel, _ in messages.left_out}
    assert types['/tf'] == 'tf2_msgs/msg/TFMessage'
    assert types['/pose'] == 'geometry_msgs/msg/PoseStamped'
    assert types['/gps'] == 'sensor_msgs/msg/NavSatFix'
    assert left_out == {'/map', '/drivable_area', '/cam_front/annotations', '/imu'}
    assert len(boxes) == nuscenes_mcap.KEYFRAMES
    for message in boxes:
        for marker, cube in zip(message.markers, nuscenes_mcap.CUBES, strict=True):
            category, name, size, place, yaw = cube
            assert (marker.text, marker.ns, marker.header.frame_id) == (category, name, 'map')
            assert (marker.scale.x, marker.scale.y, marker.scale.z) == size
            middle = nuscenes_mcap.cube_in_map(place, yaw)[:3, 3]
            position = marker.pose.position
            np.testing.assert_allclose([position.x, position.y, position.z], middle)


def test_nuscenes_boxes_are_true(nuscenes_bag, tmp_path):
    """By log times, which the samples of a keyframe have in common."""

    def change(plan):
        log = type(plan.stamps)('log')
        every = replace(plan.labels, camera=2, out_of_view=True)  # the vehicle passes the boxes
        return replace(front_only(plan), labels=every, stamps=log)

    report, _ = convert([nuscenes_bag], tmp_path / 'out', change)
    assert report.losses == ()
    assert report.frames == nuscenes_mcap.KEYFRAMES
    for number in range(report.frames):
        boxes = labels(tmp_path / 'out', number)
        assert len(boxes) == len(nuscenes_mcap.CUBES)
        stamp_ns = nuscenes_mcap.START_NS + number * nuscenes_mcap.KEYFRAME_NS
        base_t_map = np.linalg.inv(nuscenes_mcap.map_t_base(stamp_ns))
        for (_, values), (_, _, size, place, yaw) in zip(boxes, nuscenes_mcap.CUBES, strict=True):
            middle = base_t_map @ nuscenes_mcap.cube_in_map(place, yaw)
            camera = np.linalg.inv(nuscenes_mcap.CAMERAS['cam_front']) @ middle
            np.testing.assert_allclose(values[:3], [size[2], size[1], size[0]], atol=1e-4)
            bottom = camera[:3, 3] + [0, size[2] / 2, 0]
            np.testing.assert_allclose(values[3:6], bottom, atol=1e-3)


def test_argoverse2_with_a_written_calibration_is_true(tmp_path):
    bags = argoverse2_mcap.write(tmp_path)
    path = argoverse2_mcap.write_calibration(tmp_path / 'calib.txt')

    def front(plan):
        camera = next(each for each in plan.cameras.values() if each.topic == 'ring_front_center')
        return replace(plan, cameras={2: camera})

    out = tmp_path / 'out'
    report, _ = convert(bags, out, front, calib=path)
    assert report.losses == ()
    assert report.frames == argoverse2_mcap.FRAMES
    for number in range(report.frames):
        points = scan(out, number)
        expected = argoverse2_mcap.points_of(number)
        np.testing.assert_allclose(points[:, :3], expected, atol=1e-6)
        assert not points[:, 3].any()
        pixels, depths = projected(out, number, points[:, :3])
        truth, _ = pinhole(expected, argoverse2_mcap.BASE_T_CAMERA, argoverse2_mcap.K)
        np.testing.assert_allclose(pixels[depths > 1], truth[depths > 1], atol=0.01)
        for (_, values), cube in zip(labels(out, number), argoverse2_mcap.CUBES, strict=True):
            _, _, size, place = cube
            bottom = [*place[:2], place[2] - size[2] / 2, 1]
            expected_place = np.linalg.inv(argoverse2_mcap.BASE_T_CAMERA) @ bottom
            np.testing.assert_allclose(values[3:6], expected_place[:3], atol=1e-4)
            np.testing.assert_allclose(values[:3], size[::-1], atol=1e-4)


@pytest.mark.parametrize('optical', [False, True])
def test_waymo_is_true_with_and_without_optical_frames(optical, tmp_path):
    out = tmp_path / 'out'

    def front(plan):
        camera = next(each for each in plan.cameras.values() if '/FRONT/' in each.topic)
        return replace(plan, cameras={2: camera})

    bag = waymo_mcap.write(tmp_path / 'segment.mcap', optical=optical)
    report, found = convert([bag], out, front)
    assert found.plan.labels.topic == '/perception/boxes_3d'
    assert report.losses == ()
    assert report.frames == waymo_mcap.FRAMES
    truth, _ = pinhole(waymo_mcap.DOTS, waymo_mcap.base_t_optical('FRONT'), waymo_mcap.K)
    for number in range(report.frames):
        points = scan(out, number)
        np.testing.assert_allclose(points[:, :3], waymo_mcap.points_of(number)[:, :3], atol=1e-5)
        pixels, _ = projected(out, number, waymo_mcap.DOTS)
        image = cv2.imread(str(out / 'training/image_2' / f'{number:06}.png'), 0)
        for (u, v), (x, y) in zip(pixels, truth, strict=True):
            assert np.hypot(u - x, v - y) < 60  # rectified with other intrinsics
            window = image[round(v) - 8 : round(v) + 9, round(u) - 8 : round(u) + 9].astype(float)
            bright = np.clip(window - 60, 0, None)
            rows, columns = np.mgrid[-8:9, -8:9]
            found_u = round(u) + (bright * columns).sum() / bright.sum()
            found_v = round(v) + (bright * rows).sum() / bright.sum()
            assert np.hypot(found_u - u, found_v - v) < 0.3
        for (_, values), cube in zip(labels(out, number), waymo_mcap.CUBES, strict=True):
            _, _, size, place, _ = cube
            bottom = [*place[:2], place[2] - size[2] / 2, 1]
            expected = np.linalg.inv(waymo_mcap.base_t_optical('FRONT')) @ bottom
            np.testing.assert_allclose(values[3:6], expected[:3], atol=1e-4)


def test_waymo_classes_are_the_texts(tmp_path):
    bag = waymo_mcap.write(tmp_path / 'segment.mcap')
    with open_messages(bag, {'/perception/boxes_3d'}) as messages:
        for message in messages:
            made = messages.typestore.deserialize_cdr(message.data, message.msgtype)
            assert [marker.action for marker in made.markers] == [3, 0, 0]
            assert [marker.text for marker in made.markers[1:]] == ['Car', 'Ped']
