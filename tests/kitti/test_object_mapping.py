# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The object devkit's mapping of training frames to raw drives."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mapped_set import RAND, ROWS, write_mapping

from kitti_ros2.kitti.calib_file import parse_calibration, parse_raw_calibration
from kitti_ros2.kitti.object_set import (
    DriveFrame,
    find_mapping,
    parse_mapping,
    parse_rand,
    read_mapping,
)
from kitti_ros2.kitti.store import STORE
from kitti_ros2.model.errors import BadFileError, UsageError

_ROWS = st.tuples(st.integers(1, 9999), st.integers(0, 10**10 - 1))
HERE = Path('train.txt')
REAL = {
    0: ('2011_09_28_drive_0106_sync', 48),
    1: ('2011_09_26_drive_0101_sync', 528),
    2: ('2011_09_26_drive_0086_sync', 108),
    45: ('2011_09_26_drive_0001_sync', 21),
    310: ('2011_09_26_drive_0005_sync', 136),
}


@given(st.integers(1, 40).flatmap(lambda count: st.permutations(range(1, count + 1))))
def test_every_permutation_is_read_back(order):
    for separator in (',', ', ', '\n', ',\r\n'):
        assert parse_rand(separator.join(map(str, order)), HERE, len(order)) == order


@given(st.lists(_ROWS, unique=True, min_size=1))
def test_every_line_is_read_back(rows):
    names = [(f'2011_09_26_drive_{drive:04d}_sync', number) for drive, number in rows]
    for end in ('\n', '\r\n', ' \n', '\n\n'):
        last = [f'2011_09_26 {drive} {number:010d}' for drive, number in names]
        text = '\n'.join(last).replace('\n', end if end != '\n\n' else '\n') + end
        assert parse_mapping(text, HERE) == names


def test_a_frame_is_found_through_both_files(tmp_path):
    mapping = read_mapping(write_mapping(tmp_path / 'mapping'))
    assert mapping.frames == tuple(DriveFrame(*ROWS[line - 1]) for line in RAND)
    assert mapping.get(len(ROWS)) is None


@pytest.mark.parametrize(
    'place', ['object', 'object/mapping', 'object/devkit/mapping', 'mapping', 'devkit/mapping',
              'devkit/object/mapping', 'devkit_object/mapping'],
)  # fmt: skip
def test_the_mapping_is_found_beside_the_set(place, tmp_path):
    root = tmp_path / 'object'
    folder = tmp_path / place
    write_mapping(folder)
    assert find_mapping(root).folder == folder
    for given_folder in {folder, folder.parent} - {tmp_path, root}:
        assert find_mapping(tmp_path / 'elsewhere', given_folder).folder == folder


@pytest.mark.parametrize(
    ('line', 'found'),
    [
        ('2011_09_26 2011_09_26_drive_0001_sync', ':2: '),
        ('2011_09_26 2011_09_28_drive_0001_sync 0000000001', ':2: '),
        ('2011_09_26 ../2011_09_26_drive_0001_sync 1', ':2: '),
        ('2011_09_26 2011_09_26_drive_0001_sync -1', ':2: '),
        ('2011_09_26 2011_09_26_drive_0001_sync 1 2', ':2: '),
        ('', ':2: '),
        ('2011_09_26 2011_09_26_drive_0001_sync 0000000007', 'is in line 1 as well'),
    ],
)
def test_an_invalid_line_is_named(line, found):
    good = '2011_09_26 2011_09_26_drive_0001_sync 0000000007'
    with pytest.raises(BadFileError, match=r'^train\.txt:2: ') as error:
        parse_mapping(f'{good}\n{line}\n{good[:-1]}8\n', HERE)
    assert found in str(error.value)
    assert error.value.line == 2


@pytest.mark.parametrize(
    ('text', 'found'),
    [
        ('1,2', '2 numbers; expected each line of train_mapping.txt once, 1 to 3'),
        ('', '0 numbers'),
        ('1,2,4', "number 3 is '4'"),
        ('0,1,2', "number 1 is '0'"),
        ('1,2,2', 'numbers 2 and 3 are both 2'),
        ('1,2,3,1', 'numbers 1 and 4 are both 1'),
        ('1,x,3', "number 2 is 'x'"),
        ('1,-2,3', "number 2 is '-2'"),
        ('1,2.0,3', "number 2 is '2.0'"),
        ('1,\N{SUPERSCRIPT TWO},3', 'number 2 is'),
        ('1,' + '9' * 5000 + ',3', 'number 2 is'),
    ],
)
def test_numbers_that_are_no_permutation_are_refused(text, found):
    with pytest.raises(BadFileError) as error:
        parse_rand(text, HERE, 3)
    assert found in str(error.value)


def test_a_mapping_of_another_length_is_refused(tmp_path):
    folder = write_mapping(tmp_path / 'mapping', ROWS[:-1])
    with pytest.raises(BadFileError, match=r'train_rand\.txt: number \d+ is .*1 to 31'):
        read_mapping(folder)


def test_an_empty_mapping_is_refused():
    with pytest.raises(BadFileError, match='no line'):
        parse_mapping('\n', HERE)


def test_without_a_mapping_the_option_is_named(tmp_path):
    with pytest.raises(UsageError, match=r'devkit_object\.zip.*--mapping'):
        find_mapping(tmp_path / 'object')
    with pytest.raises(UsageError, match=r'in .*nowhere'):
        find_mapping(tmp_path / 'object', tmp_path / 'nowhere')


def test_the_real_mapping(real_kitti):
    mapping = find_mapping(real_kitti / 'object')
    assert len(mapping.frames) == len({*mapping.frames}) == 7481
    assert len({frame.drive for frame in mapping.frames}) == 141
    assert {number: mapping.frames[number] for number in REAL} == REAL
    missing_scans = {DriveFrame('2011_09_26_drive_0009_sync', n) for n in range(177, 181)}
    assert not missing_scans & {*mapping.frames}


def test_frames_have_the_calibration_of_the_date_of_their_drive(real_kitti):
    """Frames 1 and 2 are of 2011_09_26, frame 0 is not."""
    folder = real_kitti / 'raw' / '2011_09_26'
    texts = {path.name: STORE.read_text(path) for path in folder.glob('calib_*.txt')}
    of_date = parse_raw_calibration(texts, folder, rectified=True).cameras[2].p_rect
    mapping = find_mapping(real_kitti / 'object')
    for number in range(3):
        path = real_kitti / 'object' / 'training' / 'calib' / f'{number:06d}.txt'
        own = parse_calibration(STORE.read_text(path), path, path.name).cameras[2].p_rect
        same = mapping.frames[number].date == folder.name
        assert np.allclose(own, of_date, rtol=1e-6) == same
