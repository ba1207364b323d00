# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Units that fail, and units that are ended."""

import threading
from pathlib import Path

import pytest
from broken_lock import break_a_lock

from kitti_ros2.batch.pool import UnitJob
from kitti_ros2.batch.unit_functions import guarded
from kitti_ros2.batch.units import WorkUnit

JOB = UnitJob(WorkUnit('a', Path('a')), Path('out'), {})


@pytest.mark.parametrize('lock', [threading.Lock, threading.RLock], ids=['Lock', 'RLock'])
@pytest.mark.parametrize('error', [SystemExit(143), KeyboardInterrupt()], ids=['TERM', 'INT'])
def test_a_signal_that_breaks_a_lock_ends_the_unit(lock, error):
    with pytest.raises(type(error)) as raised:
        guarded(lambda *_: break_a_lock(lock, error))(JOB, lambda *_: None)
    assert raised.value is error


def test_another_error_of_a_lock_is_a_reason():
    error = ValueError()
    result = guarded(lambda *_: break_a_lock(threading.Lock, error))(JOB, lambda *_: None)
    assert 'internal error, RuntimeError' in result.reason
