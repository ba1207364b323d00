# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360's poses as ground truth: by frame number, with holes; results with and without one."""

from __future__ import annotations

import shutil
from importlib.util import find_spec

import numpy as np
import pytest
from builders import convert_recording

from kitti_ros2.evaluation import evaluate_odometry
from kitti_ros2.evaluation.trajectories import segment_errors
from kitti_ros2.model.errors import BadFileError, MissingDataError, UsageError
from kitti_ros2.model.streams import Layout

pytestmark = pytest.mark.skipif(find_spec('evo') is None, reason='evo is not installed')
DRIVE = 'data_poses/2013_05_28_drive_0003_sync'
LAST = 1030  # of drive 0003: 1010 of its frames 0 to 1030 have a pose


@pytest.fixture(scope='module')
def camera_rows(real_360):
    """(N, 17) frame numbers and 4x4 poses of the rectified camera 0."""
    return np.loadtxt(real_360 / DRIVE / 'cam0_to_world.txt')


@pytest.fixture
def numbered(camera_rows, tmp_path):
    """A perfect result with frame numbers."""
    np.savetxt(tmp_path / 'result.txt', camera_rows[:, :13], ['%d', *['%.9g'] * 12])
    return tmp_path / 'result.txt'


@pytest.fixture
def lined(camera_rows, tmp_path):
    """Write a result of n lines, those of frames without a pose as of the one before."""

    def write(lines):
        held = np.clip(np.searchsorted(camera_rows[:, 0], np.arange(lines), 'right') - 1, 0, None)
        np.savetxt(tmp_path / 'lines.txt', camera_rows[held, 1:13], '%.9g')
        return tmp_path / 'lines.txt'

    return write


@pytest.mark.parametrize('truth', ['', 'poses.txt', 'cam0_to_world.txt', 'bag'])
def test_all_forms_of_a_ground_truth_agree(real_360, numbered, tmp_path, truth):
    path = real_360 / DRIVE / truth
    if truth == 'bag':
        path = tmp_path / 'bag.mcap'
        convert_recording(real_360 / DRIVE, path)
    scores = evaluate_odometry(path, numbered)
    assert len(scores.numbers) == 1010
    assert (scores.numbers[0], scores.numbers[-1]) == (1, LAST)
    assert scores.losses == ()
    assert scores.t_err_percent < 1e-3
    assert scores.ape_m < 2e-3  # cam0_to_world.txt has three decimals at most
    assert scores.distances_m[-1] == pytest.approx(1378.6, abs=0.2)


@pytest.mark.parametrize('name', ['orbslam', 'semantic_suma'])
def test_lines_without_numbers_are_no_guess(real_360, name):
    result = real_360 / f'extra/slam_test_data/{name}/test_poses_0.txt'
    expected = r'933 poses without frame numbers.*1 to 1030 with gaps.*write the frame number first'
    with pytest.raises(UsageError, match=expected):
        evaluate_odometry(real_360 / DRIVE, result)


@pytest.mark.parametrize('lines', [1010, LAST])
def test_as_many_lines_as_poses_are_refused(real_360, lined, lines):
    with pytest.raises(UsageError, match='which line is which frame is not known'):
        evaluate_odometry(real_360 / DRIVE / 'cam0_to_world.txt', lined(lines))


@pytest.mark.parametrize('lines', [LAST + 1, LAST + 5])
def test_a_line_for_each_frame_is_taken_and_said(real_360, lined, lines):
    scores = evaluate_odometry(real_360 / DRIVE, lined(lines))
    assert scores.losses == ()
    assert scores.ape_m < 2e-3
    assert any('line n, from 0, is taken as frame n' in note for note in scores.notes)
    assert any('has no frames 0, 2-3, 5, 7, 9' in note for note in scores.notes)


@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
def test_a_frame_without_a_result_is_still_a_loss(real_360, numbered):
    lines = numbered.read_text().splitlines(keepends=True)
    numbered.write_text(''.join(lines[:500] + lines[503:]))
    (loss,) = evaluate_odometry(real_360 / DRIVE, numbered).losses
    assert loss.count == 3


def test_poses_of_the_imu_out_of_their_folder_are_said(real_360, numbered, tmp_path):
    shutil.copyfile(real_360 / DRIVE / 'poses.txt', tmp_path / 'poses.txt')
    notes = evaluate_odometry(tmp_path / 'poses.txt', numbered).notes
    assert any(
        'z of its frames points down, as in poses.txt of KITTI-360' in note for note in notes
    )


@pytest.mark.parametrize(
    ('name', 'part'),
    [
        ('perspective.txt', 'r0_rect'),
        ('calib_cam_to_pose.txt', 'velo_T_imu'),
        ('calib_cam_to_velo.txt', 'cam0_T_velo'),
    ],
)
def test_an_unknown_mount_is_said(real_360, numbered, tmp_path, name, part):
    for folder in ('calibration', DRIVE):
        shutil.copytree(real_360 / folder, tmp_path / 'set' / folder, copy_function=shutil.copyfile)
    (tmp_path / 'set/calibration' / name).unlink()
    notes = evaluate_odometry(tmp_path / 'set' / DRIVE, numbered).notes
    assert any(note.startswith(f'{part}: not known') for note in notes)


def test_a_drive_without_poses_is_refused(recordings, numbered, tmp_path):
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    shutil.rmtree(tmp_path / 'set/data_poses')
    with pytest.raises(MissingDataError, match=r'has no poses.*poses\.txt of KITTI-360'):
        evaluate_odometry(tmp_path / 'set', numbered)


def test_a_last_row_that_is_none(real_360, numbered, tmp_path):
    text = (real_360 / DRIVE / 'cam0_to_world.txt').read_text()
    path = tmp_path / 'cam0_to_world.txt'
    path.write_text(text.replace('0.000000 0 0.000000 1', '0.000000 1 0.000000 1'))
    with pytest.raises(BadFileError, match='the last row is not 0 0 0 1'):
        evaluate_odometry(path, numbered)


def test_speeds_are_by_frame_number():
    poses = np.tile(np.eye(4), (300, 1, 1))
    poses[:, 2, 3] = np.arange(300)
    posed = np.ones(300, dtype=bool)
    numbers = np.arange(300)
    for step, frames in ((1, 102), (10, 1011)):
        speeds = segment_errors(step * numbers, poses, poses, posed).speeds_m_s
        assert speeds[0] == pytest.approx(100 / (0.1 * frames))
