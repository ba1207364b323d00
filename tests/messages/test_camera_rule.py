# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""P, after R, projects points given in header.frame_id, exactly as KITTI's own P does."""

from __future__ import annotations

from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from kitti_ros2.kitti.calib_file import parse_calibration, parse_raw_calibration
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import (
    camera_model,
    decode_static,
    encode_camera_info,
    encode_static,
    image_frame_camera,
    static_links,
)
from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.messages.naming import FrameNames, make_frames
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.messages import Preset

BASE_T_IMU = Transform.from_translation((-0.05, 0.32, 0.93))
TOLERANCE_PX = 0.01


def street_points() -> np.ndarray:
    """(N, 3) points of velo_link, 3 to 60 m ahead, in and around the cameras' view."""
    rng = np.random.default_rng(1)
    ahead = rng.uniform(3, 60, 4000)
    return np.column_stack([ahead, ahead * rng.uniform(-0.9, 0.9, 4000), rng.uniform(-2, 3, 4000)])


def through_cdr(message):
    return deserialize(join(serialize(message)), message.__msgtype__)


def chain(links, target: str, source: str) -> Transform:
    """target_T_source from a static tree."""
    up = {child: (parent, transform) for parent, child, transform in links}

    def to_root(frame):
        steps = []
        while frame in up:
            parent, transform = up[frame]
            steps.insert(0, transform)
            frame = parent
        return reduce(lambda a, b: a @ b, steps, Transform.identity())

    return to_root(target).inverse() @ to_root(source)


def pixels_by_messages(calibration, index: int, points, frames: FrameNames):
    """Where a subscriber sees points of velo_link: by the decoded TF and CameraInfo alone."""
    links = decode_static(
        through_cdr(encode_static(static_links(calibration, BASE_T_IMU, frames), 0))
    )
    frame = frames.camera(image_frame_camera(calibration, index))
    info = through_cdr(encode_camera_info(calibration, index, (1242, 375), 0, frame))
    r, p = info.r.reshape(3, 3), info.p.reshape(3, 4)
    seen = chain(links, info.header.frame_id, frames.velo).apply(points)
    homogeneous = np.column_stack([seen @ r.T, np.ones(len(seen))]) @ p.T
    return homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]


def pixels_by_kitti(calibration, index: int, points):
    """P_i R_rect Tr, as the devkit projects."""
    camera = calibration.cameras[index]
    tr = camera.cam_T_velo or Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo
    homogeneous = np.column_stack([tr.apply(points), np.ones(len(points))]) @ camera.p_rect.T
    return homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]


def assert_rule(calibration, points=None):
    points = street_points() if points is None else points
    frames = make_frames(Preset.DEFAULT, {})
    assert calibration.cameras
    for index in (index for index, camera in calibration.cameras.items() if camera.lens is None):
        expected, depth = pixels_by_kitti(calibration, index, points)
        seen, _ = pixels_by_messages(calibration, index, points, frames)
        ahead = depth > 2
        assert ahead.sum() > 1000
        error = np.abs(seen - expected)[ahead].max()
        assert error < TOLERANCE_PX, f'camera {index}: {error} px'


def test_synthetic(recording):
    assert_rule(recording.calibration(0))


def real_calibrations():
    return [
        ('raw', '2011_09_26', True),
        ('extract', '2011_09_26', False),
        ('object', 'object/training/calib/000000.txt', True),
        ('object', 'object/training/calib/000002.txt', True),
        ('odometry', 'odometry/dataset/sequences/00/calib.txt', True),
        ('tracking', 'tracking/training/calib/0000.txt', True),
    ]


@pytest.mark.parametrize(('kind', 'name', 'rectified'), real_calibrations())
def test_real(real_kitti: Path, kind: str, name: str, rectified):
    if kind in {'raw', 'extract'}:
        folder = real_kitti / 'raw' / name
        texts = {path.name: path.read_text() for path in folder.glob('calib_*.txt')}
        calibration = parse_raw_calibration(texts, folder, rectified=rectified)
    else:
        path = real_kitti / name
        calibration = parse_calibration(path.read_text(), path, path.name)
    assert_rule(calibration)


def test_real_points_of_a_real_scan(real_kitti: Path):
    recording = open_recording(real_kitti / 'raw' / '2011_09_26' / '2011_09_26_drive_0005_sync')
    points = recording.read(next(s for s in recording.streams if s.value == 'scan'), 0).points
    assert_rule(recording.calibration(0), points[:, :3].astype(np.float64))


def test_waymo_shape():
    turn = rotation_from_rpy(-np.pi / 2, 0, -np.pi / 2).T
    rows = '\n'.join(
        f'Tr_velo_to_cam_{i}: '
        + ' '.join(f'{v:.9e}' for v in np.column_stack([turn, [0.1 * i, 0, 0]]).ravel())
        for i in range(5)
    )
    pinholes = '\n'.join(f'P{i}: 700 0 600 0 0 700 180 0 0 0 1 0' for i in range(5))
    text = f'{pinholes}\nR0_rect: 1 0 0 0 1 0 0 0 1\n{rows}\n'
    assert_rule(parse_calibration(text, Path('calib.txt'), 'calib.txt'))


def test_left_cameras_are_their_own_and_right_ones_their_pair_s(recordings):
    calibration = open_recording(next(iter(recordings.values()))).calibration(0)
    assert [image_frame_camera(calibration, i) for i in range(4)] == [0, 0, 2, 2]
    fourth = {}
    for index in range(4):
        info = encode_camera_info(calibration, index, (310, 94), 0, 'x')
        model = camera_model(through_cdr(info))
        p = info.p.reshape(3, 4)
        np.testing.assert_array_equal(model.p, p)
        np.testing.assert_array_equal(model.k, p[:, :3])
        np.testing.assert_array_equal(model.r, np.eye(3))
        assert model.d.tolist() == [0] * 5
        fourth[index] = p[:, 3]
    assert not fourth[0].any()
    assert not fourth[2].any()
    assert fourth[1][0] < 0
    assert fourth[3][0] < 0


def test_a_right_camera_without_its_left_stands_alone(recordings):
    whole = open_recording(next(iter(recordings.values()))).calibration(0)
    alone = type(whole)({3: whole.cameras[3]}, whole.r0_rect, whole.cam0_T_velo, whole.velo_T_imu)
    assert image_frame_camera(alone, 3) == 3
    assert_rule(alone)


def test_every_frame_has_one_parent(recording):
    frames = make_frames(Preset.DEFAULT, {})
    links = static_links(recording.calibration(0), BASE_T_IMU, frames)
    children = [child for _, child, _ in links]
    assert len(children) == len(set(children))
    assert [parent for parent, _, _ in links if parent not in children] == ['base_link']
