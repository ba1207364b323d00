# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Projection, transforms and labels of a CalibratedRig, against KITTI's own formulas."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kitti_ros2
from kitti_ros2.model.samples import CameraCalibration
from kitti_ros2.model.streams import Layout

P2 = np.array([[721.5, 0, 609.6, 44.9], [0, 721.5, 172.9, 0.2], [0, 0, 1, 0.003]])
RECT_T_VELO = np.array([[0, -1, 0, 0.01], [0, 0, -1, -0.07], [1, 0, 0, -0.27], [0, 0, 0, 1.0]])
PLACES = st.tuples(st.floats(1, 80), st.floats(-40, 40), st.floats(-3, 10))


def rig(**rest):
    return kitti_ros2.CalibratedRig.from_matrices({2: P2}, RECT_T_VELO, **rest)


def devkit(points, p=P2, rect_t_velo=RECT_T_VELO):
    """P_rect R0_rect Tr_velo_to_cam x, as readme.txt of the object devkit has it."""
    seen = (p @ rect_t_velo @ np.column_stack([points, np.ones(len(points))]).T).T
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


@given(st.lists(PLACES, min_size=1, max_size=20))
def test_project_is_the_devkits(places):
    points = np.array(places)
    uv, depth = rig().project(points)
    expected, far = devkit(points)
    np.testing.assert_allclose(uv, expected, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(depth, far, rtol=1e-12)


@given(st.lists(PLACES, min_size=1, max_size=20))
def test_unproject_is_the_inverse_of_project(places):
    points = np.array(places)
    found = rig().unproject(*rig().project(points))
    np.testing.assert_allclose(found, points, atol=1e-8)


def test_points_behind_have_no_pixel():
    uv, depth = rig().project([[-5.0, 0, 0], [5, 0, 0]])
    assert np.isnan(uv[0]).all()
    assert depth[0] < 0 < depth[1]
    assert np.isfinite(uv[1]).all()


def test_no_points_are_no_pixels():
    uv, depth = rig().project(np.empty((0, 4), np.float32))
    assert uv.shape == (0, 2)
    assert depth.shape == (0,)


def test_lenses_are_undone():
    """Images of raw extracts: OpenCV's projectPoints is the reference."""
    k = np.array([[984.2, 0, 690.0], [0, 980.8, 233.2], [0, 0, 1]])
    d = np.array([-0.3728755, 0.2037299, 0.002219027, 0.001383707, -0.07233722])
    bent = rig()
    camera = CameraCalibration(P2, k=k, d=d)
    model = bent.model
    object.__setattr__(model, 'rectified', False)
    model.cameras[0] = camera
    points = np.random.default_rng(1).uniform([5, -3, -1], [40, 3, 1], (200, 3))
    uv, depth = bent.project(points, camera=0)
    in_camera = (RECT_T_VELO @ np.column_stack([points, np.ones(200)]).T).T[:, :3]
    expected, _ = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), k, d)
    np.testing.assert_allclose(uv, expected[:, 0], atol=1e-6)
    np.testing.assert_allclose(bent.unproject(uv, depth, camera=0), points, atol=1e-8)


def test_transforms_compose_and_invert():
    calibration = rig()
    names = [*calibration.frames, 2]
    for one in names:
        for other in names:
            there = calibration.transform(one, other)
            back = calibration.transform(other, one)
            np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-12)
    camera_t_velo = calibration.transform(2, 'velo_link')
    # Camera 2 is beside camera 0 by the fourth column of P over the focal length.
    offset = np.linalg.solve(P2[:, :3], P2[:, 3])
    np.testing.assert_allclose(camera_t_velo[:3, 3], RECT_T_VELO[:3, 3] + offset, atol=1e-12)


def test_points_may_be_in_any_frame():
    calibration = rig()
    points = np.array([[10.0, 2, -1], [20, -3, 0]])
    for frame in (2, 'imu_link', 'base_link'):
        moved = np.column_stack([points, np.ones(2)]) @ calibration.transform(frame, 'velo_link').T
        uv, depth = calibration.project(moved[:, :3], frame=frame)
        expected, _ = calibration.project(points)
        np.testing.assert_allclose(uv, expected, atol=1e-8)
        np.testing.assert_allclose(
            calibration.unproject(uv, depth, frame=frame), moved[:, :3], atol=1e-8
        )


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda c: c.project([[1.0, 2, 3]], camera=3), 'no calibration of camera 3'),
        (lambda c: c.transform('velo', 'imu_link'), 'no frame velo; did you mean velo_link'),
        (lambda c: c.transform('map', 'velo_link'), 'map'),
        (lambda c: c.project([1.0, 2, 3]), r'\(N, 3\)'),
        (lambda c: c.from_matrices({2: np.eye(3)}, np.eye(4)), r'P2 of shape \(3, 3\)'),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(kitti_ros2.KittiRos2Error, match=message):
        call(rig())


def test_objects_project_into_their_2d_boxes(recordings):
    """The corners of a label's 3D box reach the borders of its 2D box."""
    for frame in kitti_ros2.open(recordings[Layout.OBJECT]):
        height, width, _ = frame.image(2).shape
        whole = [each for each in frame.objects if each.has_box and each.truncated == 0]
        assert whole
        for each in whole:
            uv, _ = frame.calibration.project(each.corners())
            found = np.array([*uv.min(axis=0), *uv.max(axis=0)])
            np.testing.assert_allclose(found.clip(0, (width, height) * 2), each.box_2d, atol=1.5)


def test_a_box_becomes_its_label_again(recordings):
    for frame in kitti_ros2.open(recordings[Layout.OBJECT]):
        height, width, _ = frame.image(2).shape
        for each in (one for one in frame.objects if one.has_box):
            made = frame.calibration.label(
                each.class_name, each.box, (width, height), score=0.5, track=7
            )
            assert (made.class_name, made.score, made.track_id) == (each.class_name, 0.5, 7)
            np.testing.assert_allclose(made.location, each.label.location, atol=0.05)
            np.testing.assert_allclose(made.size_hwl, each.label.size_hwl, atol=1e-9)
            np.testing.assert_allclose(made.rotation_y, each.label.rotation_y, atol=0.02)


def test_objects_are_in_any_frame(recordings):
    for frame in kitti_ros2.open(recordings[Layout.TRACKING]):
        map_t_velo = frame.transform('map', 'velo_link')
        for each in (one for one in frame.objects if one.has_box):
            corners = np.column_stack([each.corners(), np.ones(8)]) @ map_t_velo.T
            np.testing.assert_allclose(each.corners('map'), corners[:, :3], atol=1e-9)
            centre = each.corners().mean(axis=0)
            np.testing.assert_allclose(each.box[:3], centre, atol=1e-9)
            np.testing.assert_allclose(each.pose()[:3, 3], centre, atol=1e-9)


def test_an_object_without_a_3d_box_says_so(recordings):
    found = [
        each
        for frame in kitti_ros2.open(recordings[Layout.OBJECT])
        for each in frame.objects
        if each.class_name == 'DontCare'
    ]
    for each in found:
        assert not each.has_box
        with pytest.raises(kitti_ros2.KittiRos2Error, match='no 3D box'):
            each.corners()


def test_real_points_project_as_the_devkit_does(real_kitti):
    frame = kitti_ros2.open(real_kitti / 'object/training')[0]
    lines = dict(
        line.split(': ', 1)
        for line in (real_kitti / f'object/training/calib/{frame.number:06d}.txt')
        .read_text()
        .splitlines()
        if line
    )
    values = {key: np.array(text.split(), float) for key, text in lines.items()}
    rect, velo = np.eye(4), np.eye(4)
    rect[:3, :3] = values['R0_rect'].reshape(3, 3)
    velo[:3] = values['Tr_velo_to_cam'].reshape(3, 4)
    points = frame.points[frame.points[:, 0] > 2]
    uv, depth = frame.calibration.project(points)
    expected, far = devkit(points[:, :3], values['P2'].reshape(3, 4), rect @ velo)
    front = far > 0.5
    np.testing.assert_allclose(uv[front], expected[front], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(depth, far, rtol=1e-9, atol=1e-9)
