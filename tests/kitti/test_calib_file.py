# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.calib_file import (
    format_object,
    format_odometry,
    format_raw,
    format_tracking,
    parse_calibration,
    parse_raw_calibration,
)
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import Calibration, CameraCalibration

PATH = Path('calib/000000.txt')
SMALL_ANGLES = st.floats(-0.5, 0.5)
METRES = st.floats(-3, 3)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(SMALL_ANGLES, SMALL_ANGLES, SMALL_ANGLES),
    st.tuples(METRES, METRES, METRES),
)


def camera(f, cx, cy, t):
    return CameraCalibration(np.array([[f, 0, cx, f * t], [0, f, cy, 0.2], [0, 0, 1, 0.003]]))


CALIBRATIONS = st.builds(
    lambda f, t, rect, cam_t_velo, velo_t_imu: Calibration(
        {i: camera(f, 600.0, 170.0, t * i) for i in range(4)}, rect.rotation, cam_t_velo, velo_t_imu
    ),
    st.floats(100, 2000),
    st.floats(-1, 1),
    TRANSFORMS,
    TRANSFORMS,
    TRANSFORMS,
)


def assert_same(one: Calibration, other: Calibration) -> None:
    assert set(one.cameras) == set(other.cameras)
    for index, cam in one.cameras.items():
        np.testing.assert_allclose(cam.p_rect, other.cameras[index].p_rect, rtol=1e-11)
    np.testing.assert_allclose(one.r0_rect, other.r0_rect, atol=1e-12)
    np.testing.assert_allclose(one.cam0_T_velo.matrix(), other.cam0_T_velo.matrix(), atol=1e-11)
    np.testing.assert_allclose(one.velo_T_imu.matrix(), other.velo_T_imu.matrix(), atol=1e-11)


@given(CALIBRATIONS)
@pytest.mark.parametrize('write', [format_object, format_tracking])
def test_object_and_tracking_text_and_back(write, calibration):
    text = write(calibration)
    again = parse_calibration(text, PATH, PATH.name)
    assert_same(again, calibration)
    assert not again.missing
    assert not again.nominal
    assert write(again) == text


@given(CALIBRATIONS)
def test_odometry_folds_the_rectification_into_tr(calibration):
    again = parse_calibration(format_odometry(calibration), PATH, PATH.name)
    point = np.array([[10.0, 2.0, -1.0]])
    np.testing.assert_allclose(
        again.cam0_T_velo.apply(point),
        calibration.cam0_T_velo.apply(point) @ calibration.r0_rect.T,
        atol=1e-9,
    )
    assert again.nominal == ('velo_T_imu',)


def test_loaders_read_object_files_by_line_number():
    calibration = Calibration(
        {2: camera(700.0, 600.0, 170.0, 0.06)},
        np.eye(3),
        Transform.identity(),
        Transform.identity(),
    )
    keys = [line.split(' ')[0] for line in format_object(calibration).splitlines()]
    assert keys == [
        'P0:', 'P1:', 'P2:', 'P3:', 'R0_rect:', 'Tr_velo_to_cam:', 'Tr_imu_to_velo:', '',
    ]  # fmt: skip


def test_raw_text_and_back():
    pinhole = camera(700.0, 600.0, 170.0, -0.5).p_rect
    own = CameraCalibration(
        pinhole,
        size=(1242, 375),
        k=np.diag([980.0, 980.0, 1.0]),
        d=np.array([-0.37, 0.2, 0.002, 0.001, -0.07]),
        r_rect=rotation_from_rpy(0.01, 0.0, 0.0),
        cam_T_cam0=Transform(rotation_from_rpy(0, 0.01, 0), np.array([-0.54, 0.0, 0.01])),
    )
    extrinsics = Transform(rotation_from_rpy(0.1, 0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    calibration = Calibration({0: own}, own.r_rect, extrinsics, extrinsics)
    again = parse_raw_calibration(format_raw(calibration), Path('d'), rectified=True)
    cam = again.cameras[0]
    assert cam.size == (1242, 375)
    np.testing.assert_allclose(cam.k, own.k, rtol=1e-6)
    np.testing.assert_allclose(cam.d, own.d, rtol=1e-6)
    np.testing.assert_allclose(cam.cam_T_cam0.matrix(), own.cam_T_cam0.matrix(), atol=1e-6)
    np.testing.assert_allclose(again.velo_T_imu.matrix(), extrinsics.matrix(), atol=1e-6)


def test_tracking_keys_have_no_colon_and_lines_end_in_blanks():
    text = 'P2: ' + '1 0 0 0 0 1 0 0 0 0 1 0  \n'
    text += 'R_rect 1 0 0 0 1 0 0 0 1  \nTr_velo_cam 1 0 0 5 0 1 0 6 0 0 1 7  \n\n'
    calibration = parse_calibration(text, PATH, PATH.name)
    assert calibration.cam0_T_velo.translation.tolist() == [5, 6, 7]
    assert set(calibration.cameras) == {2}
    assert set(calibration.missing) == {'P0', 'P1', 'P3'}


def test_waymo_cameras_stand_on_their_own():
    pinhole = '2000 0 950 0 0 2000 640 0 0 0 1 0'
    lines = [f'P{i}: {pinhole}' for i in range(5)]
    lines += ['R0_rect: 1 0 0 0 1 0 0 0 1']
    lines += [f'Tr_velo_to_cam_{i}: 1 0 0 {i} 0 1 0 0 0 0 1 0' for i in range(5)]
    calibration = parse_calibration('\n'.join(lines), PATH, PATH.name)
    assert calibration.independent_cameras
    assert [calibration.cameras[i].cam_T_velo.translation[0] for i in range(5)] == [0, 1, 2, 3, 4]
    assert not calibration.missing


GOOD = format_object(
    Calibration(
        {i: camera(700.0, 600.0, 170.0, 0.1 * i) for i in range(4)},
        np.eye(3), Transform.identity(), Transform.identity(),
    )
)  # fmt: skip


def break_line(key: str, line: str) -> str:
    return '\n'.join(line if old.startswith(key) else old for old in GOOD.splitlines())


@pytest.mark.parametrize(
    ('text', 'part', 'said'),
    [
        (
            break_line('P2', 'P2: 7.0e+02 0.0'),
            'P2',
            'calib/000000.txt:3: P2: 2 values; expected 12',
        ),
        (break_line('P2', 'P2: a b'), 'P2', '2 values'),
        (break_line('P2', 'P2: ' + 'x ' * 12), 'P2', "'x' is no number"),
        (break_line('P2', 'P2: ' + '1 ' * 12), 'P2', 'singular'),
        (break_line('R0', 'R0_rect: ' + '1 ' * 9), 'R0_rect', 'holds no rotation'),
        (break_line('Tr_velo', 'Tr_velo_to_cam: ' + '1 ' * 12), 'Tr_velo_to_cam', 'no rotation'),
        (GOOD[: GOOD.index('Tr_velo') + 30], 'Tr_velo_to_cam', 'expected 12 numbers'),
        (GOOD[: GOOD.index('Tr_velo')], 'Tr_velo_to_cam', 'no Tr_velo_to_cam'),
    ],
)
def test_a_bad_part_costs_that_part_only(text, part, said):
    calibration = parse_calibration(text, PATH, PATH.name)
    assert said in calibration.missing[part]
    others = {0, 1, 2, 3} - ({2} if part == 'P2' else set())
    assert set(calibration.cameras) == others


@pytest.mark.parametrize(
    'value', ['', ' ', '0', '0 ' * 12, '0.0e+00 ' * 12, '-0 ' * 12, 'nan ' * 12]
)
@pytest.mark.parametrize('key', ['P0', 'P2', 'Tr_imu_to_velo', 'Tr_velo_to_cam'])
def test_a_placeholder_counts_as_absent(key, value):
    text = break_line(key, f'{key}: {value}')
    found = parse_calibration(text, PATH, PATH.name)
    without = parse_calibration(break_line(key, ''), PATH, PATH.name)
    assert set(found.cameras) == set(without.cameras)
    assert found.nominal == without.nominal
    assert found.notes == (f'{key}: empty or zeros in the calibration, taken as absent',)
    # That there is no such camera is known; that the scanner has no place costs projections.
    assert set(found.missing) == ({key} if key == 'Tr_velo_to_cam' else set())


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        ('P2', '0 0 0'),
        ('R0_rect', '0 ' * 8),
        ('Tr_velo_to_cam', 'nan 0 0 1 ' * 3),
        ('P2', '- ' * 12),
    ],
)
def test_what_is_no_placeholder(key, value):
    found = parse_calibration(break_line(key, f'{key}: {value}'), PATH, PATH.name)
    assert found.missing
    assert not found.notes


def test_vectors_of_zeros_are_values():
    """Camera 0 has T = 0; a rectified camera has D = 0."""
    calibration = Calibration(
        {0: camera(700.0, 600.0, 170.0, 0.0)}, np.eye(3), Transform.identity(), Transform.identity()
    )
    found = parse_raw_calibration(format_raw(calibration), Path('d'), rectified=False)
    assert not found.missing
    assert not found.notes


@pytest.mark.parametrize(
    ('texts', 'missing', 'notes'),
    [
        ({'calib_imu_to_velo.txt': 'R: \nT: \n'}, set(), ('R, T',)),
        (
            {'calib_velo_to_cam.txt': f'R: {"0 " * 9}\nT: 0 0 0\n'},
            {'calib_velo_to_cam.txt'},
            ('R',),
        ),
    ],
)
def test_placeholders_of_raw_files(texts, missing, notes):
    calibration = Calibration(
        {0: camera(700.0, 600.0, 170.0, 0.0)}, np.eye(3), Transform.identity(), Transform.identity()
    )
    found = parse_raw_calibration({**format_raw(calibration), **texts}, Path('d'), rectified=True)
    assert set(found.missing) == missing
    assert tuple(note.partition(':')[0] for note in found.notes) == notes


@pytest.mark.parametrize(
    ('name', 'text', 'said'),
    [
        ('calib.txt', GOOD[: GOOD.index('R0')], 'no Tr; SOURCE'),
        (
            'calib.txt',
            GOOD[: GOOD.index('R0')] + 'Tr: \n',
            'no Tr (line 5 is empty or zeros); SOURCE',
        ),
        ('0000.txt', GOOD[: GOOD.index('R0')] + 'R_rect 1 0 0 0 1 0 0 0 1\n', 'no Tr_velo_cam; '),
        ('000000.txt', GOOD[: GOOD.index('Tr_velo')], 'no Tr_velo_to_cam; '),
    ],
)
def test_a_missing_scanner_is_named_by_the_key_of_its_layout(name, text, said):
    found = parse_calibration(text, Path(name), name, 'SOURCE')
    assert found.missing['Tr_velo_to_cam'].startswith(f'{name}: {said}')


@pytest.mark.parametrize('text', ['', '\n\n', '1 2 3\n', '\x00\x01'])
def test_what_is_no_calibration(text):
    with pytest.raises(BadFileError):
        parse_calibration(text, PATH, PATH.name)
