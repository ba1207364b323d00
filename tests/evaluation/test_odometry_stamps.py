# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Odometry that is stamped at the start or the end of the scanner's turn, or at other times."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
from builders import convert_recording
from drives import odometry, offsets_ns, write_bag, write_poses, write_sequence, write_tum

from kitti_ros2 import KittiRos2Warning
from kitti_ros2.evaluation import evaluate_odometry
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import NS_PER_S, Layout, Stream
from kitti_ros2.options.read import (
    DEFAULT_EPOCH_NS,
    NOMINAL_PERIOD_NS,
    ReadOptions,
    ScanStamp,
    SelectionOptions,
)
from kitti_ros2.synthetic.scene import motion_at

from folder_and_bag import make_holes  # isort: skip

pytestmark = pytest.mark.skipif(find_spec('evo') is None, reason='evo is not installed')
POSED = (Layout.RAW, Layout.ODOMETRY, Layout.TRACKING, Layout.KITTI_360)


def at_starts(source):
    """The recording as `play --ring-time` plays it: the stamp of a scan is that of its turn."""
    undo = open_recording(source).layout is Layout.ODOMETRY
    options = ReadOptions(scan_stamp=ScanStamp.START, undo_deskew=undo)
    return open_recording(source, options)


def answers(recording, path, *, to_ns=1, at_end=False):
    """A stack's Odometry of every scan, with the stamp of the scan, and the pose of its frame."""
    scans = recording.streams[Stream.SCAN]
    published = []
    for number, start in zip(scans.numbers.tolist(), scans.stamps_ns.tolist(), strict=True):
        pose = recording.read(Stream.POSE, number).world_T_imu.matrix()
        stamp = recording.turns[number].end_ns if at_end else start
        rounded = stamp // to_ns * to_ns
        published.append(('/odom', rounded, odometry(rounded, pose, 'imu_link')))
    return write_bag(path, *published)


@pytest.fixture(params=['folder', 'bag', 'bag of poses'])
def ground_truth(request, tmp_path):
    """A function that returns a folder, or its bag."""

    def make(source):
        if request.param == 'folder':
            return source
        streams = ('pose', 'oxts', 'calibration', 'recording')
        streams += ('scan',) * (request.param == 'bag')
        bag = tmp_path / 'truth.mcap'
        convert_recording(source, bag, selection=SelectionOptions(streams), storage='mcap')
        return bag

    return make


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', POSED)
@pytest.mark.parametrize(('to_ns', 'at_end'), [(1000, False), (1, True)])
def test_every_frame_gets_the_pose_of_its_scan(
    layout, to_ns, at_end, recordings, ground_truth, tmp_path
):
    source = make_holes(recordings[layout], layout, tmp_path / 'holes')
    recording = at_starts(source)
    scans = recording.streams[Stream.SCAN]
    assert (scans.stamps_ns < open_recording(source).streams[Stream.SCAN].stamps_ns).all()
    result = answers(recording, tmp_path / 'run.mcap', to_ns=to_ns, at_end=at_end)
    answered = np.isin(recording.streams[Stream.POSE].numbers, scans.numbers)
    assert answered.any()
    assert not answered.all()
    with pytest.warns(KittiRos2Warning, match='no pose of frames'):
        scores = evaluate_odometry(ground_truth(source), result)
    assert scores.known.tolist() == answered.tolist()
    assert len(scores.losses) == 1
    moment = 'end' if at_end else 'start'
    assert scores.matched_by == f'stamp ({moment} of turn)'


FRAMES = 400


def true_poses(times_s):
    """(N, 4, 4) poses along the synthetic street."""
    poses = [motion_at(time, Transform.identity()).map_T_imu.matrix() for time in times_s]
    return np.array(poses)


def test_a_pose_is_compared_with_the_truth_at_its_stamp(tmp_path):
    """A perfect odometry with the stamps of the turns' starts has only the error of interpolation.

    Taken as the pose of its frame, it would have the error of the way that the car drives in half a
    turn, as far as that differs from frame to frame. The figures are those of the how-to.
    """
    offsets = np.array(offsets_ns(FRAMES))
    root = write_sequence(tmp_path / 'odometry', true_poses(offsets / NS_PER_S))
    starts = offsets - NOMINAL_PERIOD_NS // 2
    poses = true_poses(starts / NS_PER_S)
    stamps = [f'{DEFAULT_EPOCH_NS + start}e-9' for start in starts.tolist()]
    result = write_tum(tmp_path / 'r.tum', stamps, poses)
    scores = evaluate_odometry(root, result, align='se3')
    assert scores.known.all()
    assert scores.losses == ()
    assert scores.errors.ape_m.max() < 0.0003
    assert scores.t_err_percent < 0.001
    assert scores.r_err_deg_per_m == 0
    # Before the first frame the motion is that of the first step: 0.006 degrees, over 320 m.
    assert evaluate_odometry(root, result).errors.ape_m.max() < 0.035
    by_number = evaluate_odometry(root, write_poses(tmp_path / 'r.txt', poses), align='se3')
    assert by_number.t_err_percent == pytest.approx(0.25, abs=0.01)
    assert by_number.r_err_deg_per_m == pytest.approx(0.0017, abs=0.0001)
    assert by_number.errors.ape_m.max() == pytest.approx(0.10, abs=0.01)


def test_of_several_poses_the_nearest_to_the_frame_is_used(tmp_path):
    """Odometry at a higher rate has poses at the start of the turn, too."""
    offsets = np.array(offsets_ns(FRAMES))
    root = write_sequence(tmp_path / 'odometry', true_poses(offsets / NS_PER_S))
    times = np.sort(np.concatenate([offsets + late for late in (-51_800_000, -9_000_000, 20_000)]))
    stamps = [f'{DEFAULT_EPOCH_NS + ns}e-9' for ns in times.tolist()]
    result = write_tum(tmp_path / 'r.tum', stamps, true_poses(times / NS_PER_S))
    scores = evaluate_odometry(root, result)
    assert scores.matched_by == 'stamp, at most 0.0 ms apart'
    assert scores.errors.ape_m.max() < 0.0003
    assert scores.losses == ()
    assert f'{2 * FRAMES} poses of no frame, or not the nearest of one' in scores.notes[-1]


def test_a_late_pose_of_a_stack_is_that_of_its_stamp(tmp_path):
    offsets = np.array(offsets_ns(FRAMES))
    root = write_sequence(tmp_path / 'odometry', true_poses(offsets / NS_PER_S))
    late = offsets + np.where(np.arange(FRAMES) % 3, 30_000_000, 0)
    stamps = [f'{DEFAULT_EPOCH_NS + ns}e-9' for ns in late.tolist()]
    result = write_tum(tmp_path / 'r.tum', stamps, true_poses(late / NS_PER_S))
    assert evaluate_odometry(root, result).errors.ape_m.max() < 0.0003


def test_the_truth_does_not_move_where_its_stamps_are_wrong(tmp_path):
    offsets = np.array(offsets_ns(FRAMES))
    poses = true_poses(offsets / NS_PER_S)
    root = write_sequence(tmp_path / 'odometry', poses)
    times = root / 'sequences' / '07' / 'times.txt'
    lines = times.read_text().splitlines()
    lines[31] = lines[30]
    times.write_text('\n'.join(lines))
    stamps = [f'{DEFAULT_EPOCH_NS + ns + 5_000_000}e-9' for ns in offsets.tolist()]
    with pytest.warns(KittiRos2Warning, match='no pose of frames'):
        scores = evaluate_odometry(root, write_tum(tmp_path / 'r.tum', stamps, poses))
    assert 'stamps are not ascending' in scores.notes[-1]
    assert np.isfinite(scores.ape_m)
