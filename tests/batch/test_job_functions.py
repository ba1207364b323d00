# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Jobs that fail, and jobs that are ended."""

import threading
from pathlib import Path

import pytest
from broken_lock import break_a_lock

from kitti_ros2.batch.job_functions import guarded
from kitti_ros2.batch.jobs import Job
from kitti_ros2.batch.pool import JobTask

TASK = JobTask(Job('a', Path('a')), Path('out'), {})


@pytest.mark.parametrize('lock', [threading.Lock, threading.RLock], ids=['Lock', 'RLock'])
@pytest.mark.parametrize('error', [SystemExit(143), KeyboardInterrupt()], ids=['TERM', 'INT'])
def test_a_signal_that_breaks_a_lock_ends_the_unit(lock, error):
    with pytest.raises(type(error)) as raised:
        guarded(lambda *_: break_a_lock(lock, error))(TASK, lambda *_: None)
    assert raised.value is error


def test_another_error_of_a_lock_is_a_reason():
    error = ValueError()
    result = guarded(lambda *_: break_a_lock(threading.Lock, error))(TASK, lambda *_: None)
    assert 'internal error, RuntimeError' in result.reason
