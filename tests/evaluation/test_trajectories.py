# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files of poses: 12, 13 and 8 columns, and what is damaged in them."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from drives import drive, write_poses, write_tum

from kitti_ros2.evaluation.trajectories import read_trajectory
from kitti_ros2.model.errors import BadFileError

LINE = '1 0 0 {} 0 1 0 0 0 0 1 0'


def write(tmp_path, *lines):
    path = tmp_path / '09.txt'
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_twelve_columns_are_frames_by_line(tmp_path):
    poses = drive(5)
    track = read_trajectory(write_poses(tmp_path / '09.txt', poses))
    assert (track.numbers.tolist(), track.stamps_ns, track.losses) == ([0, 1, 2, 3, 4], None, ())
    np.testing.assert_allclose(track.poses, poses, atol=1e-8)


def test_thirteen_columns_begin_with_the_frame(tmp_path):
    poses = drive(5)
    track = read_trajectory(write_poses(tmp_path / '09.txt', poses[[4, 1, 2]], [4, 1, 2]))
    assert track.numbers.tolist() == [1, 2, 4]
    np.testing.assert_allclose(track.poses, poses[[1, 2, 4]], atol=1e-8)
    assert track.notes == (f'{tmp_path / "09.txt"}: frame numbers are not in order; sorted',)


def test_numbers_with_a_point_are_frame_numbers(tmp_path):
    path = write(tmp_path, *(f'{n:.6e} {LINE.format(n)}' for n in (3, 7)))
    assert read_trajectory(path).numbers.tolist() == [3, 7]


def test_tum_keeps_all_nanoseconds_and_is_sorted(tmp_path):
    poses = drive(4)
    stamps = [f'1317042145.{ns:09d}' for ns in (951199337, 2, 1, 500)]
    track = read_trajectory(write_tum(tmp_path / 'a.tum', stamps, poses))
    second = 1317042145 * 10**9
    assert track.stamps_ns.tolist() == [second + 1, second + 2, second + 500, second + 951199337]
    np.testing.assert_allclose(track.poses, poses[[2, 1, 3, 0]], atol=1e-9)
    assert track.notes


@pytest.mark.parametrize(
    ('line', 'complaint'),
    [
        ('nan' + LINE.format(0)[1:], "'nan' is no finite number"),
        (LINE.format('inf'), "'inf' is no finite number"),
        (LINE.format('x'), "'x' is no number"),
        (LINE.format(0) + ' 1', '13 values'),
        ('1 0 0', '3 values'),
        (LINE.format('2e9'), 'a position beyond 1e9 m'),
        ('1.1' + LINE.format(0)[1:], 'the matrix is no rotation (R^T R is off by 0.21)'),
        ('-1' + LINE.format(0)[1:], 'the matrix is a reflection (left-handed axes'),
        ('1e200' + LINE.format(0)[1:], 'a position beyond 1e9 m'),
        ('0 0 0 0 0 0 0 0 0 0 0 0', 'the matrix is no rotation'),
    ],
)
def test_an_invalid_line_costs_its_frame(line, complaint, tmp_path):
    path = write(tmp_path, LINE.format(0), line, LINE.format(2))
    track = read_trajectory(path)
    assert track.numbers.tolist() == [0, 2]
    (loss,) = track.losses
    assert loss.text().startswith(f'{path}:2: {complaint}')


def test_matrices_that_are_nearly_rotations_are_taken_with_a_note(tmp_path):
    lines = [LINE.format(0), '1.02' + LINE.format(1)[1:]]
    track = read_trajectory(write(tmp_path, *lines))
    assert (len(track), track.losses) == (2, ())
    assert track.notes[0].endswith('no exact rotations, R^T R is off by up to 0.04')


@pytest.mark.parametrize(
    ('line', 'complaint'),
    [
        ('-1 0 0 0 0 0 0 1', "'-1' is no number of seconds"),
        ('1e12 0 0 0 0 0 0 1', 'no number of seconds'),
        ('2 0 0 0 0 0 0 0', 'the quaternion has length 0, not 1'),
        ('2 0 0 0 0 0 0 2', 'the quaternion has length 2, not 1'),
        ('2 0 0 nan 0 0 0 1', "'nan' is no finite number"),
    ],
)
def test_an_invalid_line_of_tum_costs_its_pose(line, complaint, tmp_path):
    path = write(tmp_path, '# a comment', '1 0 0 0 0 0 0 1', '', line, '3 0 0 0 0 0 0 1')
    track = read_trajectory(path)
    assert track.stamps_ns.tolist() == [10**9, 3 * 10**9]
    assert complaint in track.losses[0].text()
    assert track.losses[0].text().startswith(f'{path}:4: ')


@pytest.mark.parametrize('change', [b'\xef\xbb\xbf%s', b'# a comment\n\n%s', b'%s\n  \n'])
@pytest.mark.parametrize('end', [b'\n', b'\r\n', b'\r'])
def test_marks_blank_lines_and_line_ends_change_nothing(change, end, tmp_path):
    path = tmp_path / '09.txt'
    lines = [LINE.format(x).encode() for x in range(3)]
    path.write_bytes(change % end.join(lines))
    track = read_trajectory(path)
    assert track.poses[:, 0, 3].tolist() == [0, 1, 2]
    assert (track.losses, track.notes) == ((), ())


def test_a_header_is_no_frame(tmp_path):
    path = write(tmp_path, 'r11 r12 r13 tx', *(LINE.format(x) for x in range(3)))
    track = read_trajectory(path)
    assert track.numbers.tolist() == track.poses[:, 0, 3].tolist() == [0, 1, 2]
    assert track.losses == ()
    assert track.notes == (f'{path}: the first line has no numbers; taken as a header',)


def test_a_long_file_is_read_in_one_piece(tmp_path):
    lines = [f'{n * 0.01:.6f} {n} 0 0 0 0 0 1' for n in range(20_000)]
    lines[700] = lines[699]
    track = read_trajectory(write(tmp_path, *lines))
    assert (len(track), len(track.losses)) == (19_999, 1)
    assert 'in lines 701' in track.losses[0].text()


def test_the_first_of_two_poses_of_a_frame_is_used(tmp_path):
    path = write(tmp_path, *(f'{n} {LINE.format(x)}' for n, x in ((0, 0), (1, 1), (1, 5), (2, 2))))
    track = read_trajectory(path)
    assert track.poses[:, 0, 3].tolist() == [0, 1, 2]
    assert [loss.count for loss in track.losses] == [1]
    assert track.losses[0].text() == (
        f'{path}: a second pose of the same frame number in lines 3; the first is used'
    )


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        (b'# only a comment\n', 'contains no poses'),
        (b'', 'contains no poses'),
        (b'x y z\n', ':1: 3 columns; expected 12'),
        (b'1 2 3\n', ':1: 3 columns; expected 12 numbers a line'),
        (b'1\n', ':1: 1 column; expected'),
        (b'0,0,0,0,0,0,0,1\n', ':1: numbers are separated by commas; expected spaces, and 12'),
        (b'0,0,0,0,0,0,0,1\n' * 2, ':1: numbers are separated by commas'),
        (b'stamp,x\n0,0\n1,0\n', ':2: numbers are separated by commas'),
        (b'1; 0; 0\n', ':1: numbers are separated by semicolons; expected spaces'),
        (b'1, 0, 0, 0, 0, 0, 0, 1\n', ':1: numbers are separated by commas; expected spaces'),
        (b'\0' * 99, 'is no UTF-8 text'),
        ('1 0 0'.encode('utf-16'), 'is no UTF-8 text'),
        (b'1 0 0 0 0 1 0 0 0 0 1\n', ':1: 11 columns; expected 12 numbers a line'),
        (b'1 0 0 0 0 1 0 0 0 0 1 0 0\n', ':1: the matrix is no rotation'),
        (b'0 0 0 0 0 0 0 0\n', ':1: the quaternion has length 0, not 1'),
        (b'\xff\xfe\x00', 'is no UTF-8 text'),
        (b'nan 0 0 0 0 1 0 0 0 0 1 0\n', ":1: 'nan' is no finite number; expected twelve numbers"),
    ],
)
def test_a_file_without_a_pose_is_an_error(content, complaint, tmp_path):
    path = tmp_path / '09.txt'
    path.write_bytes(content)
    with pytest.raises(BadFileError) as raised:
        read_trajectory(path)
    assert str(raised.value).startswith(str(path))
    assert complaint in str(raised.value)


@pytest.mark.parametrize('line', ['x', '1 2 3', '# a comment'])
def test_megabytes_of_other_lines_cost_little(line, tmp_path):
    path = tmp_path / 'poses.txt'
    path.write_text(f'{line}\n' * 300_000)
    tracemalloc.start()
    try:
        with pytest.raises(BadFileError, match='expected 12 numbers a line'):
            read_trajectory(path)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 40 * 10**6
