# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A calibration from CameraInfo and TF puts points where the rig does, whoever wrote the bag."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import pi
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from kitti_ros2.importer.bag_calibration import (
    link_to_camera_0,
    make_calibration,
    rect_in_frame,
    with_kitti_cameras,
)
from kitti_ros2.kitti.calib_file import format_raw, parse_calibration, parse_raw_calibration
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import (
    CameraModel,
    camera_model,
    decode_static,
    encode_camera_info,
    encode_static,
    image_frame_camera,
    static_links,
)
from kitti_ros2.messages.cdr import deserialize, join, make_header, serialize
from kitti_ros2.messages.naming import make_frames
from kitti_ros2.messages.ros_types import CameraInfo, RegionOfInterest
from kitti_ros2.messages.tf_tree import FrameTree
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.model.geometry import (
    NOMINAL_CAM0_T_VELO,
    NOMINAL_VELO_T_IMU,
    Transform,
    rotation_from_rpy,
)
from kitti_ros2.model.samples import Calibration, CameraCalibration, rect_from_velo
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Preset

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (640, 480)
K = np.array([[500.0, 0, 318.0], [0, 502.0, 241.0], [0, 0, 1]])
OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Axes x forward, y left, z up in an optical frame."""
LEFT_T_LIDAR = Transform(rotation_from_rpy(0.01, -0.02, 0.015) @ OPTICAL, np.array([0.1, -0.3, 0]))
LIDAR_T_IMU = Transform(rotation_from_rpy(0.1, 0.2, 0.3), np.array([-0.5, 0.1, -0.6]))
BASELINE = 0.12
POINTS = np.random.default_rng(3).uniform([4, -3, -2], [30, 3, 2], (200, 3))
"""Of the lidar, in view."""

SMALL = st.floats(-0.1, 0.1)
ANY = st.floats(-pi, pi)
PLACE = st.tuples(SMALL, SMALL, SMALL)
ROTATIONS = st.builds(rotation_from_rpy, SMALL, SMALL, SMALL)
POSES = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), 10 * np.array(t)),
    st.tuples(ANY, st.floats(-1.5, 1.5), ANY),
    PLACE,
)
FOCALS = st.floats(300, 1500)


def pinhole(fx, fy, cx=320.0, cy=240.0):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def model(frame='left', p=None, **values) -> CameraModel:
    """A camera; one with R has a K of its own: with that of P it would be rectified."""
    p = np.column_stack([K, np.zeros(3)]) if p is None else p
    k = np.diag([1.1, 1.1, 1.0]) @ p[:, :3] if 'r' in values else p[:, :3]
    kept = {'size': SIZE, 'k': k, 'd': np.zeros(5), 'r': np.eye(3)} | values
    return CameraModel(frame=frame, p=p, **kept)


def right_model(frame, baseline=BASELINE, k=K, **values) -> CameraModel:
    return model(frame, np.column_stack([k, k @ [-baseline, 0, 0]]), **values)


def test_a_pinhole_that_is_turned_by_r_is_in_its_rectified_frame():
    """As bags made from pykitti have it: D = 0, K of P, R_rect in R, and P's column in the tree."""
    links = [('left', 'lidar', LEFT_T_LIDAR)]
    camera = displaced('left', 0.06, k=K, r=rotation_from_rpy(0.01, 0.002, -0.01))
    true = project(np.column_stack([K, np.zeros(3)]), LEFT_T_LIDAR.apply(POINTS))
    calib, notes = make(links, {2: camera})
    np.testing.assert_allclose(pixels_of(calib, 2), true, rtol=1e-9)
    assert 'D is 0 and K is that of P' in notes[0]
    np.testing.assert_array_equal(calib.r0_rect, camera.r)
    turned, _ = make(links, {2: replace(camera, turned=True)})
    assert np.abs(pixels_of(turned, 2) - true).max() > 1


@pytest.mark.parametrize(
    ('off_m', 'kept'),
    [((0.0, 0.0003, 0.0027), True), ((0.0, 0.0, 0.0), True), ((0.0, 0.02, 0.0), False)],
)
def test_p_of_rectified_frames_stays_to_the_bit(off_m, kept):
    """kitti2mcap's links have P[0, 3] / P[0, 0] alone, of an offset along y and z as well."""
    offset = np.array([-0.53, 0, 0]) + off_m
    p = np.column_stack([K, K @ offset])
    r = rotation_from_rpy(0.01, 0.002, -0.01)
    links = [
        ('left', 'lidar', LEFT_T_LIDAR),
        ('left', 'right', Transform.from_translation((-p[0, 3] / p[0, 0], 0, 0))),
    ]
    first = model('left', k=K, r=r)
    calib, _ = make(links, {0: first, 1: model('right', p, k=K, r=rotation_from_rpy(0.02, 0, 0))})
    assert np.array_equal(calib.cameras[1].p_rect, p) is kept
    assert calib.cameras[1].p_rect[0, 3] == pytest.approx(p[0, 3], abs=1e-6)


KITTI_PLACES = {
    'camera_gray_right': 0.53, 'camera_color_left': -0.06, 'camera_color_right': 0.47,
}  # fmt: skip
KITTI_LINKS = [
    ('camera_gray_left', 'lidar', LEFT_T_LIDAR),
    *(
        ('camera_gray_left', name, Transform.from_translation((x, 0.001, 0)))
        for name, x in KITTI_PLACES.items()
    ),
]


def test_cameras_of_kitti_without_images_are_those_of_their_frames():
    """Bags of objects and tracks, whose labels and P are for points of camera 0."""
    colour = {2: model('camera_color_left')}
    tree = FrameTree(KITTI_LINKS)
    assert not link_to_camera_0(tree, colour)
    calib, notes = make(KITTI_LINKS, with_kitti_cameras(tree, colour))
    assert not notes
    assert rect_from_velo(calib).matrix() == pytest.approx(LEFT_T_LIDAR.matrix())
    assert sorted(calib.cameras) == [0, 1, 2, 3]
    for index, x in enumerate(KITTI_PLACES.values(), 1):
        p = calib.cameras[index].p_rect
        np.testing.assert_allclose(p, np.column_stack([K, K @ [-x, -0.001, 0]]), atol=1e-9)


@pytest.mark.parametrize(
    ('links', 'cameras'),
    [
        (KITTI_LINKS, {2: model('camera_color_right')}),
        (KITTI_LINKS, {0: model('camera_color_left')}),
        (KITTI_LINKS, {2: model('camera_color_left', r=rotation_from_rpy(0.1, 0, 0))}),
        (KITTI_LINKS, {2: model('left')}),
        ([('camera_color_left', 'lidar', LEFT_T_LIDAR)], {2: model('camera_color_left')}),
    ],
    ids=['another number', 'camera 0', 'unrectified', 'another name', 'no frame of camera 0'],
)
def test_cameras_of_others_are_all_that_there_are(links, cameras):
    tree = FrameTree(links)
    assert with_kitti_cameras(tree, cameras) is cameras
    assert not link_to_camera_0(tree, cameras)


@pytest.mark.parametrize('frame', ['camera_color_left', 'camera_color_left_optical_frame'])
def test_camera_0_of_a_bag_of_kitti2mcap_is_where_p_has_it(frame):
    """Its only camera by default is number 2, whose frame and P both have the offset."""
    r, x = rotation_from_rpy(0.01, 0.002, -0.01), 0.06
    p = np.column_stack([K, K @ [x, 0.0003, 0.0027]])
    x = p[0, 3] / p[0, 0]
    lidar = Transform.from_translation((x, 0, 0)) @ LEFT_T_LIDAR
    cameras = {2: model(frame, p, k=K, r=r)}
    links = [(frame, 'lidar', lidar)]
    links += link_to_camera_0(FrameTree(links), cameras)
    calib, _ = make(links, with_kitti_cameras(FrameTree(links), cameras))
    np.testing.assert_array_equal(calib.cameras[2].p_rect, p)
    assert rect_from_velo(calib).matrix() == pytest.approx(LEFT_T_LIDAR.matrix())


def message(**values) -> CameraInfo:
    kept = {
        'header': make_header(0, 'cam'), 'height': SIZE[1], 'width': SIZE[0],
        'distortion_model': 'plumb_bob', 'd': np.zeros(5), 'k': K.ravel(),
        'r': np.eye(3).ravel(), 'p': np.column_stack([K, [-60.0, 3.0, 0]]).ravel(),
        'binning_x': 0, 'binning_y': 0, 'roi': RegionOfInterest(0, 0, 0, 0, do_rectify=False),
    }  # fmt: skip
    return CameraInfo(**kept | values)


def project(p, points):
    seen = np.column_stack([points, np.ones(len(points))]) @ p.T
    return seen[:, :2] / seen[:, 2:]


def pixels_of(calibration: Calibration, index: int, points=POINTS):
    """As KITTI's devkits project: P_i R0_rect Tr."""
    rect = rect_from_velo(calibration).apply(points)
    return project(calibration.cameras[index].p_rect, rect)


def make(links, cameras, lidar='lidar', imu=None, *, rectified=True, **options):
    tree = FrameTree(links)
    return make_calibration(tree, lidar, cameras, imu, rectified=rectified, **options)


# Of CameraInfo.


def test_a_model_has_the_message_s_numbers():
    camera = camera_model(message(d=np.arange(5.0), header=make_header(5, '/cam')))
    assert (camera.frame, camera.size, camera.model) == ('cam', SIZE, 'plumb_bob')
    np.testing.assert_array_equal(camera.k, K)
    np.testing.assert_array_equal(camera.d, np.arange(5.0))
    np.testing.assert_array_equal(camera.p, np.column_stack([K, [-60.0, 3.0, 0]]))


def test_lists_will_do_as_well_as_arrays():
    camera = camera_model(message(k=K.ravel().tolist(), d=[0.0] * 5, p=[0.0] * 12))
    np.testing.assert_array_equal(camera.p, np.column_stack([K, np.zeros(3)]))


def test_zeros_are_what_was_never_told():
    camera = camera_model(message(r=np.zeros(9), p=np.zeros(12), distortion_model=''))
    np.testing.assert_array_equal(camera.r, np.eye(3))
    np.testing.assert_array_equal(camera.p, np.column_stack([K, np.zeros(3)]))
    assert camera.model == 'plumb_bob'
    np.testing.assert_array_equal(camera_model(message(k=np.zeros(9))).k, K)


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'width': 0}, 'without width and height'),
        ({'height': 0}, 'without width and height'),
        ({'k': np.zeros(9), 'p': np.zeros(12)}, 'not calibrated'),
        ({'k': np.full(9, np.nan)}, 'not calibrated: K'),
        ({'k': np.diag([1e300, 1e300, 1]).ravel()}, 'not calibrated: K'),
        ({'k': -K.ravel()}, 'not calibrated: K'),
        ({'d': np.full(5, np.nan)}, 'not calibrated: D'),
        ({'p': [500, 0, 318, 1e300, 0, 500, 181, 0, 0, 0, 1, 0]}, 'not calibrated: P'),
        ({'binning_x': 2**32 - 1}, 'leaves no pixel'),
        ({'p': np.full(12, np.inf)}, 'not calibrated: P'),
        ({'r': np.full(9, np.nan)}, 'R is no rotation'),
        ({'r': -np.eye(3).ravel()}, 'R is no rotation'),
        ({'r': 2 * np.eye(3).ravel()}, 'R is no rotation'),
        ({'roi': RegionOfInterest(1, 0, 480, 640, do_rectify=False)}, 'begins at 1, 0'),
        ({'roi': RegionOfInterest(0, 0, 481, 0, do_rectify=False)}, '640 x 481'),
    ],
)
def test_what_is_no_camera_is_refused(values, complaint):
    with pytest.raises(ValueError, match=complaint):
        camera_model(message(**values))


@given(
    st.integers(0, 4), st.integers(0, 4), st.integers(0, 100), st.integers(0, 100), st.booleans()
)
def test_binning_and_region_bring_pixels_of_the_sensor_to_those_of_the_image(bx, by, x, y, whole):
    """A pixel (u, v) of the sensor is ((u - x) / bx, (v - y) / by) of what is published."""
    width, height = (0, 0) if whole else (400, 300)
    x, y = (0, 0) if whole else (x, y)
    roi = RegionOfInterest(x, y, height, width, do_rectify=False)
    camera = camera_model(message(binning_x=bx, binning_y=by, roi=roi))
    bins = np.array([max(bx, 1), max(by, 1)])
    full = camera_model(message())
    places = POINTS @ OPTICAL.T
    expected = (project(full.p, places) - [x, y]) / bins
    np.testing.assert_allclose(project(camera.p, places), expected, rtol=1e-12, atol=1e-9)
    expected = (places @ full.k.T)[:, :2] / places[:, 2:]
    seen = (places @ camera.k.T)[:, :2] / places[:, 2:]
    np.testing.assert_allclose(seen, (expected - [x, y]) / bins, rtol=1e-12, atol=1e-9)
    assert camera.size == ((width or SIZE[0]) // bins[0], (height or SIZE[1]) // bins[1])


# Of our own bags.


def through_messages(calibration: Calibration, *, rectified: bool, only=None, **options):
    """What our own bag of a calibration tells, read as anyone's."""
    frames = make_frames(Preset.DEFAULT, {})
    links = static_links(calibration, Transform.from_translation((-0.05, 0.32, 0.93)), frames)
    data = join(serialize(encode_static(links, 0)))
    links = decode_static(deserialize(data, 'tf2_msgs/msg/TFMessage'))
    cameras = {}
    for index, camera in calibration.cameras.items():
        frame = frames.camera(image_frame_camera(calibration, index))
        size = camera.size or (1242, 375)
        cameras[index] = camera_model(encode_camera_info(calibration, index, size, 0, frame))
    if only is not None:
        cameras = {index: cameras[index] for index in only}
    return make(links, cameras, frames.velo, frames.imu, rectified=rectified, **options)


def assert_same(made: Calibration, true: Calibration, tolerance: float):
    close = {'rtol': tolerance, 'atol': tolerance}
    assert set(made.cameras) == set(true.cameras)
    for index, camera in true.cameras.items():
        np.testing.assert_allclose(made.cameras[index].p_rect, camera.p_rect, **close)
        # To the bit: loaders read the focal length from here.
        np.testing.assert_array_equal(made.cameras[index].p_rect[:, :3], camera.p_rect[:, :3])
    rect_t_velo = rect_from_velo(true).matrix()
    np.testing.assert_allclose(rect_from_velo(made).matrix(), rect_t_velo, **close)
    np.testing.assert_allclose(made.velo_T_imu.matrix(), true.velo_T_imu.matrix(), **close)


def assert_same_lenses(made: Calibration, true: Calibration, tolerance: float):
    for index, camera in true.cameras.items():
        again = made.cameras[index]
        np.testing.assert_array_equal(again.k, camera.k)
        np.testing.assert_array_equal(again.d, camera.d)
        np.testing.assert_array_equal(again.r_rect, camera.r_rect)
        np.testing.assert_allclose(
            again.cam_T_cam0.matrix(), camera.cam_T_cam0.matrix(), rtol=0, atol=tolerance
        )
    np.testing.assert_array_equal(made.r0_rect, true.r0_rect)


@st.composite
def rigs(draw):
    """A KITTI rig whose rotations are exact: four cameras, rectified and not."""
    k_rect = [pinhole(draw(FOCALS), draw(FOCALS)) for _ in range(4)]
    r0_rect = draw(ROTATIONS)
    cameras = {}
    for index in range(4):
        offset = np.zeros(3) if index == 0 else np.array(draw(PLACE))
        r_rect = r0_rect if index == 0 else draw(ROTATIONS)
        rest = 1e-4 * np.array(draw(PLACE)) if index else np.zeros(3)
        p_rect = np.column_stack([k_rect[index], k_rect[index] @ (offset + rest)])
        cam_t_cam0 = Transform(r_rect.T @ r0_rect, r_rect.T @ offset)
        d = np.array(draw(st.tuples(*[SMALL] * 5)))
        k = pinhole(draw(FOCALS), draw(FOCALS))
        cameras[index] = CameraCalibration(p_rect, SIZE, k, d, r_rect, cam_t_cam0)
    return Calibration(cameras, r0_rect, draw(POSES), draw(POSES))


@given(rigs())
def test_a_rectified_rig_comes_back_from_its_messages(rig):
    calib, notes = through_messages(rig, rectified=True)
    assert_same(calib, rig, 1e-9)
    assert notes == ()
    assert calib.rectified
    assert calib.nominal == ()


@given(rigs())
def test_an_unrectified_rig_comes_back_from_its_messages(rig):
    rig = replace(rig, rectified=False)
    calib, notes = through_messages(rig, rectified=False)
    assert_same(calib, rig, 1e-9)
    assert_same_lenses(calib, rig, 1e-9)
    assert notes == ()
    assert not calib.rectified


# Rotations of seven digits are none to 1e-7, and quaternions are.
SEVEN_DIGITS = 1e-6


@pytest.mark.parametrize('layout', list(Layout))
def test_the_synthetic_rig_comes_back_from_its_messages(recordings, layout):
    rig = open_recording(recordings[layout]).calibration(0)
    # No CameraInfo of ROS describes a fisheye of the MEI model.
    cameras = {index: camera for index, camera in rig.cameras.items() if camera.lens is None}
    rig = replace(rig, cameras=cameras)
    calib, notes = through_messages(rig, rectified=True)
    assert_same(calib, rig, SEVEN_DIGITS)
    assert notes == ()


def test_the_synthetic_extract_comes_back_from_its_messages(recordings):
    rig = replace(open_recording(recordings[Layout.RAW]).calibration(0), rectified=False)
    calib, notes = through_messages(rig, rectified=False)
    assert_same(calib, rig, 1e-4)  # its P and its T have seven digits each
    assert_same_lenses(calib, rig, SEVEN_DIGITS)
    assert notes == ()


@given(rigs(), st.sets(st.integers(0, 3)))
def test_rectified_images_among_others_have_the_lens_of_their_pixels(rig, straightened):
    rig = replace(rig, rectified=False)
    calib, _ = through_messages(rig, rectified=False, straightened=straightened)
    places = POINTS * [4, 4, 1] + [0, 0, 30]  # in front of every camera, in camera 0
    velo = rig.cam0_T_velo.inverse().apply(places)
    for index, camera in calib.cameras.items():
        true = rig.cameras[index]
        seen = (camera.cam_T_cam0 @ calib.cam0_T_velo).apply(velo)
        if index in straightened:
            assert not camera.d.any()
            rect = Transform(true.r_rect, np.zeros(3)) @ true.cam_T_cam0 @ rig.cam0_T_velo
            expected = rect.apply(velo) @ true.p_rect[:, :3].T
            np.testing.assert_allclose(seen @ camera.k.T, expected, rtol=1e-6, atol=1e-3)
        else:
            np.testing.assert_array_equal(camera.d, true.d)
            expected = (true.cam_T_cam0 @ rig.cam0_T_velo).apply(velo)
            np.testing.assert_allclose(seen @ camera.k.T, expected @ true.k.T, rtol=1e-6, atol=1e-6)
    rect_t_velo = rect_from_velo(rig).matrix()
    np.testing.assert_allclose(rect_from_velo(calib).matrix(), rect_t_velo, rtol=0, atol=1e-9)


@pytest.mark.parametrize('rectified', [True, False])
def test_the_real_raw_rig_comes_back_from_its_messages(real_kitti: Path, rectified):
    folder = real_kitti / 'raw' / '2011_09_26'
    texts = {path.name: path.read_text() for path in folder.glob('calib_*.txt')}
    rig = parse_raw_calibration(texts, folder, rectified=rectified)
    calib, notes = through_messages(rig, rectified=rectified)
    assert_same(calib, rig, SEVEN_DIGITS)
    if not rectified:
        assert_same_lenses(calib, rig, SEVEN_DIGITS)
    assert notes == ()


@pytest.mark.parametrize(
    'name',
    [
        'object/training/calib/000000.txt',
        'odometry/dataset/sequences/00/calib.txt',
        'tracking/training/calib/0000.txt',
    ],
)
def test_real_rigs_come_back_from_their_messages(real_kitti: Path, name):
    path = real_kitti / name
    rig = parse_calibration(path.read_text(), path, path.name)
    calib, notes = through_messages(rig, rectified=True)
    assert_same(calib, rig, SEVEN_DIGITS)
    assert notes == ()


@pytest.mark.parametrize('only', [(0, 1), (1,), (1, 2), (1, 3), (1, 2, 3), (2, 3), (3,)])
def test_some_cameras_of_our_own_bag_see_what_they_saw(recordings, only):
    rig = open_recording(recordings[Layout.OBJECT]).calibration(0)
    calib, notes = through_messages(rig, rectified=True, only=only)
    for index in only:
        seen, true = pixels_of(calib, index), pixels_of(rig, index)
        np.testing.assert_allclose(seen, true, rtol=1e-5, atol=1e-3)
    assert notes == ()


def test_the_files_of_a_raw_drive_tell_the_same(recordings, tmp_path):
    rig = replace(open_recording(recordings[Layout.RAW]).calibration(0), rectified=False)
    calib, _ = through_messages(rig, rectified=False, only=(2, 3))
    again = parse_raw_calibration(format_raw(calib), tmp_path, rectified=False)
    assert again.missing == {}
    for index in (2, 3):
        np.testing.assert_allclose(pixels_of(again, index), pixels_of(rig, index), rtol=1e-4)


# Of anyone's bags.


class Stereo:
    """A stereo pair that is not quite parallel, calibrated as OpenCV does."""

    def __init__(self):
        turn = rotation_from_rpy(0.004, -0.03, 0.006)
        self.right_T_left = Transform(turn, turn @ np.array([-BASELINE, 0.002, 0.004]))
        k_right, d = pinhole(510, 512, 311, 236), np.array([-0.2, 0.05, 0.001, 0.0, 0.0])
        motion = (self.right_T_left.rotation, self.right_T_left.translation.reshape(3, 1))
        r1, r2, p1, p2, *_ = cv2.stereoRectify(K, d, k_right, d, SIZE, *motion, alpha=0)
        self.left = CameraModel('left', SIZE, K, d, r1, p1)
        self.right = CameraModel('right', SIZE, k_right, d, r2, p2)

    def true_pixels(self):
        """In the rectified right image."""
        in_right = (self.right_T_left @ LEFT_T_LIDAR).apply(POINTS)
        return project(self.right.p[:, :3] @ np.eye(3, 4), in_right @ self.right.r.T)


def stampings():
    stereo = Stereo()
    left = [('left', 'lidar', LEFT_T_LIDAR)]
    return {
        'the left frame': (left, 'left'),
        'its own frame': ([*left, ('right', 'left', stereo.right_T_left)], 'right'),
        'its own frame in the left camera': ([*left, ('left', 'right', Transform.identity())],
                                             'right'),
        'a frame that nothing joins': (left, 'right'),
    }  # fmt: skip


@pytest.mark.parametrize(('links', 'frame'), stampings().values(), ids=stampings())
@pytest.mark.parametrize('indices', [(0, 1), (2, 3), (3, 2)], ids=str)
def test_a_right_camera_counts_its_baseline_once(links, frame, indices):
    stereo = Stereo()
    cameras = {indices[0]: stereo.left, indices[1]: replace(stereo.right, frame=frame)}
    calib, notes = make(links, cameras)
    np.testing.assert_allclose(pixels_of(calib, indices[1]), stereo.true_pixels(), rtol=1e-6)
    true = project(stereo.left.p, LEFT_T_LIDAR.apply(POINTS) @ stereo.left.r.T)
    np.testing.assert_allclose(pixels_of(calib, indices[0]), true, rtol=1e-6)
    assert notes == ()
    k = stereo.right.p[:, :3]
    np.testing.assert_allclose(calib.cameras[indices[1]].p_rect[:, :3], k, atol=1e-9)


@pytest.mark.parametrize(('links', 'frame'), stampings().values(), ids=stampings())
def test_unrectified_pairs_stand_as_they_do(links, frame):
    stereo = Stereo()
    cameras = {0: stereo.left, 1: replace(stereo.right, frame=frame)}
    calib, _ = make(links, cameras, rectified=False)
    right = calib.cameras[1]
    in_right = (right.cam_T_cam0 @ calib.cam0_T_velo).apply(POINTS)
    true = (stereo.right_T_left @ LEFT_T_LIDAR).apply(POINTS)
    np.testing.assert_allclose(in_right, true, atol=1e-6)
    np.testing.assert_array_equal(right.k, stereo.right.k)


def test_a_right_camera_alone_finds_its_left_one_in_the_tree():
    stereo = Stereo()
    links = stampings()['its own frame'][0]
    calib, notes = make(links, {2: stereo.right})
    np.testing.assert_allclose(pixels_of(calib, 2), stereo.true_pixels(), rtol=1e-6)
    assert notes == ()


def test_the_left_camera_is_looked_for_along_the_rectified_rows():
    r = rotation_from_rpy(0, 0, 0.4)
    place = Transform.from_translation(r.T @ [-BASELINE, 0, 0])
    right = right_model('right', r=r)
    calib, notes = make([('left', 'lidar', LEFT_T_LIDAR), ('right', 'left', place)], {2: right})
    assert not calib.cameras[2].p_rect[:, 3].any()
    assert notes == ()


def test_a_baseline_of_little_more_than_nothing_is_not_mistaken_for_none():
    right = right_model('right', 0.015)
    calib, notes = make([('right', 'lidar', LEFT_T_LIDAR)], {2: right})
    np.testing.assert_array_equal(calib.cameras[2].p_rect, right.p)
    assert 'baseline of 0.015 m' in notes[0]


def test_a_right_camera_without_a_left_one_is_taken_as_it_is():
    links = [('right', 'lidar', LEFT_T_LIDAR)]
    calib, notes = make(links, {3: right_model('right')})
    true = project(right_model('right').p, LEFT_T_LIDAR.apply(POINTS))
    np.testing.assert_allclose(pixels_of(calib, 3), true, rtol=1e-9)
    (note,) = notes
    assert 'camera 3: P has a baseline of 0.120 m, taken as from right' in note


def side_by_side(metres):
    right_t_left = Transform.from_translation((-metres, 0, 0))
    return [('left', 'lidar', LEFT_T_LIDAR), ('right', 'left', right_t_left)]


@pytest.mark.parametrize('metres', [0.1, 0.125, 0.139])
def test_a_tree_that_has_much_the_same_baseline_is_followed(metres):
    calib, notes = make(side_by_side(metres), {0: model(), 1: right_model('right')})
    assert calib.cameras[1].p_rect[0, 3] == pytest.approx(-500 * metres)
    assert notes == ()


@pytest.mark.parametrize('metres', [0.08, 0.17])
def test_a_tree_with_another_baseline_is_not_and_both_are_named(metres):
    calib, notes = make(side_by_side(metres), {0: model(), 1: right_model('right')})
    assert calib.cameras[1].p_rect[0, 3] == pytest.approx(-500 * BASELINE)
    (note,) = notes
    assert f'baseline of 0.120 m but right is {metres:.3f} m from left' in note


def test_a_tree_that_has_nothing_to_do_with_the_baseline_leaves_p_as_it_is():
    calib, notes = make(side_by_side(-0.8), {0: model(), 1: right_model('right')})
    assert calib.cameras[1].p_rect[0, 3] == pytest.approx(500 * (0.8 - BASELINE))
    assert 'right is 0.800 m from left' in notes[0]


@given(POSES, st.lists(st.tuples(ROTATIONS, PLACE, FOCALS), min_size=1, max_size=3))
def test_cameras_of_any_rig_see_what_the_tree_and_their_info_say(base_t_lidar, mounted):
    links = [('base', 'lidar', base_t_lidar)]
    cameras = {}
    for index, (r, place, focal) in enumerate(mounted, 1):
        base_t_camera = Transform(rotation_from_rpy(*place) @ OPTICAL.T, 5 * np.array(place))
        links.append(('base', f'camera {index}', base_t_camera))
        p = np.column_stack([pinhole(focal, focal + 1), np.zeros(3)])
        cameras[index] = model(f'camera {index}', p, r=r)
    places = [np.array(place) for _, place, _ in mounted]
    # Parallel frames with different R are rectified frames, see messages/rectified_cameras.py.
    assume(all(abs(a - b).max() > 1e-3 for a, b in combinations(places, 2)))
    calib, _ = make(links, cameras)
    for index, camera in cameras.items():
        in_camera = POINTS @ OPTICAL.T
        points = FrameTree(links).transform('lidar', camera.frame).apply(in_camera)
        rect = rect_from_velo(calib).apply(points)
        seen = np.column_stack([rect, np.ones(len(rect))]) @ calib.cameras[index].p_rect.T
        true = in_camera @ camera.r.T @ camera.p[:, :3].T
        np.testing.assert_allclose(seen, true, rtol=1e-6, atol=1e-6)


def test_a_turned_camera_is_named_and_folded_into_its_p():
    turn = Transform(rotation_from_rpy(0, np.radians(30), 0), np.array([0.3, 0, 0]))
    links = [('left', 'lidar', LEFT_T_LIDAR), ('side', 'left', turn)]
    calib, notes = make(links, {0: model(), 1: model('side')})
    true = project(model().p, (turn @ LEFT_T_LIDAR).apply(POINTS))
    np.testing.assert_allclose(pixels_of(calib, 1), true, rtol=1e-9)
    assert any('camera 1 is turned by 30 degrees against camera 0' in note for note in notes)
    np.testing.assert_array_equal(calib.cameras[0].p_rect, model().p)


def test_frames_that_are_rectified_already_are_not_rectified_again(recordings):
    """As kitti2bag writes them: R, K and D of the raw cameras, frames of the rectified ones."""
    rig = open_recording(recordings[Layout.RAW]).calibration(0)
    frames = make_frames(Preset.KITTI2BAG, {})
    links = static_links(rig, Transform.identity(), frames)
    cameras = {
        index: CameraModel(
            frames.camera(index), SIZE, camera.k, camera.d, camera.r_rect, camera.p_rect
        )
        for index, camera in rig.cameras.items()
    }
    calib, notes = make(links, cameras, frames.velo, frames.imu)
    assert_same(calib, rig, 1e-4)
    assert_same_lenses(calib, rig, SEVEN_DIGITS)
    (note,) = notes
    assert note.startswith('camera_gray_left, camera_gray_right, camera_color_left, camera_color')
    for index, camera in cameras.items():
        alone, notes = make(
            links, {2: camera}, frames.velo, frames.imu, others=list(cameras.values())
        )
        np.testing.assert_allclose(pixels_of(alone, 2), pixels_of(calib, index), atol=1e-4)
        assert notes == (note.replace(note.partition(':')[0], camera.frame),)


@pytest.mark.parametrize(
    'name', ['the left frame', 'its own frame', 'its own frame in the left camera']
)
def test_a_right_camera_alone_is_compared_with_others_of_its_rig(name):
    stereo = Stereo()
    links, frame = stampings()[name]
    calib, notes = make(links, {2: replace(stereo.right, frame=frame)}, others=[stereo.left])
    np.testing.assert_allclose(pixels_of(calib, 2), stereo.true_pixels(), rtol=1e-6)
    assert notes == ()


def test_a_camera_that_nothing_joins_is_no_left_one_unless_the_plan_takes_it():
    links = [('right', 'lidar', LEFT_T_LIDAR)]
    calib, notes = make(links, {2: right_model('right')}, others=[model('elsewhere')])
    true = project(right_model('right').p, LEFT_T_LIDAR.apply(POINTS))
    np.testing.assert_allclose(pixels_of(calib, 2), true, rtol=1e-9)
    assert 'taken as from right' in notes[0]


def displaced(frame, metres, **values):
    """A camera whose P counts from another one, that is not there."""
    return model(frame, np.column_stack([K, K @ [metres, 0, 0]]), **values)


def test_two_baselines_from_a_camera_that_is_not_there_are_compared_with_each_other():
    cameras = {2: displaced('left', 0.06), 3: displaced('right', 0.06 - BASELINE)}
    calib, notes = make(side_by_side(BASELINE), cameras)
    assert notes == ()
    np.testing.assert_allclose(calib.cameras[2].p_rect[:, 3], 0, atol=1e-9)
    np.testing.assert_allclose(calib.cameras[3].p_rect[:, 3], K @ [-BASELINE, 0, 0], atol=1e-9)


def test_two_baselines_of_one_frame_are_taken_from_it():
    cameras = {2: displaced('left', 0.06), 3: displaced('left', 0.06 - BASELINE)}
    calib, notes = make([('left', 'lidar', LEFT_T_LIDAR)], cameras)
    offsets = [calib.cameras[index].p_rect[0, 3] / 500 for index in (2, 3)]
    np.testing.assert_allclose(offsets, [0.06, 0.06 - BASELINE])
    assert all('no left camera is there to compare with' in note for note in notes)
    assert len(notes) == len(cameras)


@pytest.mark.parametrize('first', [0.0, 0.06])
def test_a_baseline_that_is_that_of_p_without_r_is_of_rectified_frames(first):
    r = rotation_from_rpy(0.004, 0.01, -0.02)
    cameras = {2: displaced('left', first, r=r), 3: displaced('right', first - BASELINE, r=r)}
    calib, notes = make(side_by_side(BASELINE), cameras)
    for index, x in ((2, 0.0), (3, -BASELINE)):
        true = project(K @ np.eye(3, 4), LEFT_T_LIDAR.apply(POINTS) + np.array([x, 0, 0]))
        np.testing.assert_allclose(pixels_of(calib, index), true, rtol=1e-6)
    (note,) = notes
    assert 'left, right: taken as rectified frames, for the baseline in them is that of P' in note


def test_equal_r_of_parallel_frames_is_applied():
    """The tree has the baseline along the rectified rows."""
    r = rotation_from_rpy(0.02, 0.01, 0)
    beside = Transform.from_translation(r.T @ [-BASELINE, 0, 0])
    links = [('left', 'lidar', LEFT_T_LIDAR), ('right', 'left', beside)]
    calib, notes = make(links, {0: model(r=r), 1: right_model('right', r=r)})
    np.testing.assert_array_equal(calib.r0_rect, r)
    true = project(model().p, LEFT_T_LIDAR.apply(POINTS) @ r.T)
    np.testing.assert_allclose(pixels_of(calib, 0), true, rtol=1e-9)
    assert notes == ()


def test_without_a_scanner_its_nominal_place_stands_for_it():
    calib, _ = make([('left', 'imu', Transform.identity())], {2: model()}, None, None)
    assert calib.cam0_T_velo is NOMINAL_CAM0_T_VELO
    assert calib.velo_T_imu is NOMINAL_VELO_T_IMU
    assert calib.nominal == ('cam0_T_velo', 'velo_T_imu')


def test_without_a_scanner_the_imu_is_still_where_it_is_to_the_camera():
    left_t_imu = LEFT_T_LIDAR @ LIDAR_T_IMU
    calib, _ = make([('left', 'imu', left_t_imu)], {2: model()}, None, 'imu')
    cam_t_imu = calib.cam0_T_velo @ calib.velo_T_imu
    np.testing.assert_allclose(cam_t_imu.matrix(), left_t_imu.matrix(), atol=1e-12)
    assert calib.nominal == ('cam0_T_velo',)


def test_without_an_imu_the_nominal_one_stands_for_it():
    calib, _ = make(side_by_side(0.1), {0: model()})
    assert calib.nominal == ('velo_T_imu',)
    links = [*side_by_side(0.1), ('lidar', 'imu', LIDAR_T_IMU)]
    calib, _ = make(links, {0: model()}, 'lidar', 'imu')
    np.testing.assert_array_equal(calib.velo_T_imu.matrix(), LIDAR_T_IMU.matrix())
    assert calib.nominal == ()


@pytest.mark.parametrize('lidar', ['lidar', None])
def test_the_reference_is_where_the_calibration_says(lidar):
    stereo = Stereo()
    for links, frame in stampings().values():
        cameras = {2: replace(stereo.right, frame=frame), 3: stereo.left}
        name, frame_t_rect = rect_in_frame(FrameTree(links), cameras)
        lidar_t_rect = FrameTree(links).transform('lidar', name) @ frame_t_rect
        calib, _ = make(links, cameras, lidar)
        if lidar:
            found = rect_from_velo(calib).inverse().matrix()
            np.testing.assert_allclose(lidar_t_rect.matrix(), found, atol=1e-9)


def test_no_camera_is_no_calibration():
    with pytest.raises(MissingDataError, match='no camera has a CameraInfo'):
        make([], {})


@pytest.mark.parametrize(('lidar', 'imu'), [('velo', None), ('lidar', 'unit')])
def test_a_frame_that_is_not_joined_is_an_error_that_shows_the_tree(lidar, imu):
    with pytest.raises(MissingDataError, match=r'left -> \{lidar\}'):
        make([('left', 'lidar', LEFT_T_LIDAR)], {0: model()}, lidar, imu)


def test_a_second_camera_that_is_not_joined_is_an_error_unless_p_places_it():
    links = [('left', 'lidar', LEFT_T_LIDAR)]
    with pytest.raises(MissingDataError, match='there is no frame elsewhere'):
        make(links, {0: model(), 1: model('elsewhere')})


def test_a_pair_without_any_transform_is_a_pair():
    calib, notes = make([], {2: model('l'), 3: right_model('r')}, None)
    np.testing.assert_array_equal(calib.cameras[2].p_rect, model().p)
    np.testing.assert_allclose(calib.cameras[3].p_rect, right_model('r').p, rtol=1e-12)
    assert notes == ()


def test_each_of_two_pairs_without_transforms_of_right_cameras_has_its_own_left_one():
    grey_t_colour = Transform.from_translation((0.06, 0, 0))
    links = [('left', 'lidar', LEFT_T_LIDAR), ('left', 'colour', grey_t_colour)]
    cameras = {0: model(), 1: right_model('x'), 2: model('colour'), 3: right_model('y')}
    calib, _ = make(links, cameras)
    offsets = [calib.cameras[index].p_rect[0, 3] / -500 for index in range(4)]
    np.testing.assert_allclose(offsets, [0, 0.12, 0.06, 0.18], atol=1e-12)


def test_distortion_of_fewer_numbers_is_filled_up():
    camera = model(d=np.array([0.1, 0.2, 0.3, 0.4]))
    calib, _ = make([], {0: camera}, None, rectified=False)
    assert calib.cameras[0].d.tolist() == [0.1, 0.2, 0.3, 0.4, 0]
    calib, _ = make([], {0: model(d=np.zeros(0))}, None, rectified=False)
    assert calib.cameras[0].d.tolist() == [0] * 5


def test_a_rational_polynomial_without_a_denominator_is_plumb_bob():
    d = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0, 0, 0])
    calib, _ = make([], {0: model(d=d, model='rational_polynomial')}, None, rectified=False)
    assert calib.cameras[0].d.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5]


@pytest.mark.parametrize(
    ('name', 'd'),
    [('rational_polynomial', np.ones(8)), ('equidistant', np.zeros(4)), ('plumb_bob', np.ones(8))],
)
def test_other_distortion_has_no_place_in_unrectified_files(name, d):
    camera = model(d=d, model=name)
    with pytest.raises(
        MissingDataError, match=f'camera 0 is distorted by {name} of {len(d)} numbers'
    ):
        make([], {0: camera}, None, rectified=False)
    calib, _ = make([], {0: camera}, None, rectified=True)
    assert calib.cameras[0].k is None
    assert calib.cameras[0].d is None
