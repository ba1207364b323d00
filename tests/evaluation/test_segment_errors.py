# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's segment errors against a program that goes frame by frame, and known drifts."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from drives import drifted, drive, shaken

from kitti_ros2.evaluation.trajectories import segment_errors

from kitti_ros2.kitti.text_file import parse_poses  # isort: skip


def brute_force(numbers, truth, result):
    """Segments one by one, in the words of the devkit's publication; result by frame number.

    Angles are those of the rotation's quaternion, not of its trace, and everything is float64 but
    for the distances, whose rounding decides on which frame a segment ends.
    """
    way = [np.float32(0)]
    for before, after in pairwise(truth):
        x, y, z = (np.float32(value) for value in after[:3, 3] - before[:3, 3])
        way.append(way[-1] + np.sqrt(x * x + y * y + z * z))
    segments = []
    for first, number in enumerate(numbers):
        if (number - numbers[0]) % 10:
            continue
        for length in range(100, 801, 100):
            end = way[first] + np.float32(length)
            last = next((n for n in range(first, len(way)) if way[n] > end), None)
            if last is None or number not in result or numbers[last] not in result:
                continue
            moved = np.linalg.solve(truth[first], truth[last])
            claimed = np.linalg.solve(result[number], result[numbers[last]])
            error = np.linalg.solve(claimed, moved)
            half_sine = np.linalg.norm(error[:3, :3] - np.eye(3)) / math.sqrt(8)
            angle = 2 * math.asin(min(half_sine, 1.0))
            segments.append(
                (first, last, length, np.linalg.norm(error[:3, 3]) / length, angle / length)
            )
    return np.array(segments).reshape(-1, 5)


def score(truth, result, numbers=None, posed=None):
    numbers = np.arange(len(truth)) if numbers is None else np.array(numbers)
    posed = np.ones(len(truth), bool) if posed is None else posed
    return segment_errors(numbers, truth, result, posed)


def compare(errors, expected):
    assert len(errors) == len(expected) > 100
    assert errors.first.tolist() == expected[:, 0].tolist()
    assert errors.last.tolist() == expected[:, 1].tolist()
    assert errors.lengths_m.tolist() == expected[:, 2].tolist()
    np.testing.assert_allclose(errors.translations, expected[:, 3], rtol=2e-5, atol=1e-9)
    # The trace in float32 resolves angles to the root of 2^-22.
    resolution = 2.0**-22 / np.maximum(expected[:, 4] * expected[:, 2], 2.0**-11)
    assert (np.abs(errors.rotations - expected[:, 4]) * expected[:, 2] <= 2 * resolution).all()
    assert errors.t_err_percent == pytest.approx(100 * expected[:, 3].mean(), rel=1e-5)
    assert errors.r_err_deg_per_m == pytest.approx(np.degrees(expected[:, 4].mean()), rel=1e-4)


@pytest.mark.parametrize('seed', range(3))
def test_segments_are_those_of_a_program_that_goes_frame_by_frame(seed):
    truth = drive(1500, 0.8 + 0.2 * seed)
    result = shaken(truth, seed)
    expected = brute_force(range(len(truth)), truth, dict(enumerate(result)))
    compare(score(truth, result), expected)


def test_holes_of_both_leave_out_their_segments_only():
    truth, rng = drive(1500), np.random.default_rng(4)
    result = shaken(truth)
    numbers = np.setdiff1d(np.arange(1500), [*range(177, 181), 300, 905]) + 20
    truth, result = truth[numbers - 20], result[numbers - 20]
    posed = rng.random(len(numbers)) > 0.1
    posed[:35] = False
    given = {n: pose for n, pose, has in zip(numbers, result, posed, strict=True) if has}
    whole = brute_force(numbers, truth, dict(zip(numbers, result, strict=True)))
    errors = score(truth, np.where(posed[:, None, None], result, np.eye(4)), numbers, posed)
    expected = brute_force(numbers, truth, given)
    compare(errors, expected)
    assert errors.left_out == len(whole) - len(expected) > 100


def test_a_trajectory_has_no_error_against_itself_also_with_rounded_matrices():
    truth = drive(1200)
    for poses in (truth, np.round(truth, 4)):
        errors = score(poses, poses)
        assert len(errors) > 300
        assert (errors.t_err_percent, errors.r_err_deg_per_m) == (pytest.approx(0, abs=1e-9), 0)


def test_the_fixed_frame_does_not_matter():
    truth = drive(1200)
    result, moved = shaken(truth), np.eye(4)
    moved[:3] = [[0, -1, 0, 70], [0, 0, -1, -3], [1, 0, 0, 900]]
    first, second = score(truth, result), score(truth, moved @ result)
    assert second.t_err_percent == pytest.approx(first.t_err_percent, rel=1e-6)
    assert second.r_err_deg_per_m == pytest.approx(first.r_err_deg_per_m, rel=1e-3)


def segments_of(truth):
    """First and last frame of each segment and its length, found frame by frame."""
    way = [np.float32(0)]
    for before, after in pairwise(truth[:, :3, 3]):
        x, y, z = np.float32(after - before)
        way.append(way[-1] + np.sqrt(x * x + y * y + z * z))
    for first in range(0, len(truth), 10):
        for length in range(100, 801, 100):
            last = first
            while last < len(way) and way[last] <= way[first] + np.float32(length):
                last += 1
            if last < len(way):
                yield first, last, length


def shows_drift(truth):
    """Check the figures of known drifts to four digits, and 1.00 % and 0.0100 deg/m as printed.

    Expected values are computed from the positions of the ground truth alone, in float64. A segment
    ends at the first frame beyond its length, so a drift of 1 % of the way, or of 0.01 degrees a
    metre, is that times the way between its frames over its length, a little more than 1. Positions
    that are scaled by 1.01 are off by 1 % of the chord, which is shorter than the way in bends.
    """
    positions = truth[:, :3, 3]
    way = np.append(0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    ways, chords = [], []
    for first, last, length in segments_of(truth):
        ways.append((way[last] - way[first]) / length)
        chords.append(math.dist(positions[first], positions[last]) / length)
    drift, scale = math.fsum(ways) / len(ways), math.fsum(chords) / len(chords)
    assert 1 < drift < 1.005
    aside = score(truth, drifted(truth, share=0.01))
    assert aside.t_err_percent == pytest.approx(drift, rel=2e-5)
    assert f'{aside.t_err_percent:.2f}' == '1.00'
    assert aside.r_err_deg_per_m == 0
    for turned in (drifted(truth, deg_per_m=0.01), drifted(truth, 0.01, 0.01)):
        errors = score(truth, turned)
        assert errors.r_err_deg_per_m == pytest.approx(0.01 * drift, rel=2e-5)
        assert f'{errors.r_err_deg_per_m:.4f}' == '0.0100'
    scaled = score(truth, scaled_by(truth, 1.01))
    assert scaled.t_err_percent == pytest.approx(scale, rel=2e-5)
    assert scaled.r_err_deg_per_m == 0


def scaled_by(poses, factor):
    scaled = poses.copy()
    scaled[:, :3, 3] *= factor
    return scaled


def agrees_with_devkit(truth, figures):
    """Check figures against those of the devkit's functions, to all digits that were printed.

    They are from calcSequenceErrors and saveStats of evaluate_odometry.cpp, in a program with
    another class of 4x4 matrices, compiled with GCC (-O2) and run on the poses that are made here,
    written with ten digits: t_err in percent, r_err in degrees a metre, and the number of segments.
    """
    results = {
        'scale': scaled_by(truth, 1.01),
        'aside': drifted(truth, 0.01),
        'turned': drifted(truth, 0, 0.01),
        'both': drifted(truth, 0.01, 0.01),
        'shaken': shaken(truth),
    }
    for name, (t_err, r_err, count) in figures.items():
        errors = score(truth, results[name])
        assert len(errors) == count
        assert errors.t_err_percent == pytest.approx(t_err, rel=2e-6, abs=1e-6), name
        assert errors.r_err_deg_per_m == pytest.approx(r_err, rel=2e-6, abs=1e-8), name


def test_a_known_drift_has_its_figures():
    shows_drift(drive(4000))


def test_figures_are_those_of_the_devkit():
    figures = {
        'scale': (0.654934, 0, 2790),
        'aside': (1.001670, 0, 2790),
        'turned': (18.310568, 0.01001668, 2790),
        'both': (17.578053, 0.01001668, 2790),
        'shaken': (3.792060, 0.01433347, 2790),
    }
    agrees_with_devkit(drive(4000), figures)


def test_a_scale_of_a_straight_way_is_its_error():
    """The chord of a straight segment is its way: 1 % and the part of a step beyond the length."""
    truth = drive(3000, bend=0)
    errors = score(truth, scaled_by(truth, 1.01))
    assert f'{errors.t_err_percent:.2f}' == '1.00'
    assert errors.r_err_deg_per_m == 0


@pytest.fixture
def poses_00(real_kitti):
    """(4541, 4, 4) poses of sequence 00."""
    path = real_kitti / 'odometry/dataset/poses/00.txt'
    values = parse_poses(path.read_text(), path).values
    truth = np.array([np.vstack([pose, [0, 0, 0, 1]]) for pose in values])
    assert len(truth) == 4541
    return truth


def test_a_known_drift_on_a_real_way_has_its_figures(poses_00):
    errors = score(poses_00, poses_00)
    assert (f'{errors.t_err_percent:.6f}', errors.r_err_deg_per_m) == ('0.000000', 0)
    shows_drift(poses_00)
    scaled = scaled_by(drifted(poses_00, deg_per_m=0.01), 1.01)
    compare(score(poses_00, scaled), brute_force(range(4541), poses_00, dict(enumerate(scaled))))


def test_figures_on_a_real_way_are_those_of_the_devkit(poses_00):
    figures = {
        'scale': (0.616603, 0, 3283),
        'aside': (1.001602, 0, 3283),
        'turned': (17.340698, 0.01001603, 3283),
        'both': (17.406647, 0.01001603, 3283),
        'shaken': (4.022267, 0.01577563, 3283),
    }
    agrees_with_devkit(poses_00, figures)


@pytest.mark.parametrize('frames', [1, 2, 50])
def test_a_short_way_has_no_segment(frames):
    errors = score(drive(frames, 1.0), drive(frames, 1.0))
    assert (len(errors), errors.left_out) == (0, 0)
    assert errors.t_err_percent is errors.r_err_deg_per_m is None


def test_a_hand_made_segment():
    """101 frames a metre apart: one segment of 100 m ends beyond it, at frame 101 of 102."""
    truth = np.tile(np.eye(4), (102, 1, 1))
    truth[:, 2, 3] = np.arange(102)
    result = truth.copy()
    result[101, :3, 3] = [3, 0, 105]  # 3 m aside and 4 m too far
    errors = score(truth, result)
    assert (errors.first.tolist(), errors.last.tolist()) == ([0], [101])
    assert errors.t_err_percent == pytest.approx(5.0)
    assert errors.speeds_m_s.tolist() == [pytest.approx(100 / 10.2)]
