# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Errors name their files, and survive the way out of the worker processes of a data loader."""

import pickle
from pathlib import Path

import pytest

from kitti_ros2.model import errors

PATH, LINE = 'velodyne/000001.bin', 7
ERRORS = [
    errors.KittiRos2Error('a message'),
    errors.UsageError('a message').with_remedies(errors.Remedy(PATH, PATH, command='info')),
    errors.MissingPathError(PATH),
    errors.UnreadableFileError(PATH, OSError(5, 'Input/output error')),
    errors.MissingSourceError(Path(PATH), 'no such folder', ['raw']),
    errors.BadFileError(PATH, 'a cut point', '16 bytes a point', line=LINE, remedy='copy it'),
    errors.MissingFileError(PATH, 'the scan'),
]


@pytest.mark.parametrize('error', ERRORS, ids=lambda each: type(each).__name__)
def test_a_pickled_error_is_the_same(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__


def test_an_error_of_the_system_is_described_by_its_file_and_words():
    reading = OSError(5, 'Input/output error')
    assert errors.describe_error(reading) == 'Input/output error'
    with pytest.raises(OSError, match='Input') as raised, errors.naming(Path(PATH)):
        raise reading
    assert errors.describe_error(raised.value) == f'{PATH}: Input/output error'
    with pytest.raises(OSError, match='Input') as raised, errors.naming(Path('another')):
        raise reading
    assert raised.value.filename == PATH
    assert errors.describe_error(OSError('words')) == 'words'
