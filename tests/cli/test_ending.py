# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A signal ends a wait, whichever thread takes it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from waiting import PATIENCE_S  # isort: skip

ROOT = Path(__file__).parents[2]
BLOCKED_IN = Path(f'/proc/self/task/{os.getpid()}/wchan')
PROGRAM = """
import signal, sys, threading
from pathlib import Path
from kitti_ros2.cli.exits import end_by_signal

number = signal.Signals[sys.argv[1]]
blocked_in = Path(f'/proc/self/task/{threading.get_native_id()}/wchan')
ending = end_by_signal()

def take():
    while not any(word in blocked_in.read_text() for word in ('poll', 'select')):
        pass
    signal.pthread_kill(threading.get_ident(), number)

threading.Thread(target=take, daemon=True).start()
ending.wait()
print('ended')
"""


@pytest.mark.skipif(
    not BLOCKED_IN.is_file() or not BLOCKED_IN.read_text(), reason='needs wchan in /proc'
)
@pytest.mark.parametrize('name', ['SIGINT', 'SIGTERM'])
def test_a_signal_that_another_thread_takes_ends_the_wait(name):
    """The main thread is blocked in select and not interrupted."""
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, name],
        env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, 'ended\n', '')


ABANDONED = """
import threading
from kitti_ros2.cli.exits import end_by_signal

threading.Thread(target=threading.Event().wait).start()
ending = end_by_signal()
ending.abandon()
print('unsaved')
ending.leave(3)
"""


def test_what_cannot_be_closed_does_not_keep_a_process_whose_output_has_no_room():
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    environment.pop('PYTHONUNBUFFERED', None)
    with Path('/dev/full').open('w') as full:
        done = subprocess.run(
            [sys.executable, '-c', ABANDONED],
            env=environment,
            stdout=full,
            timeout=PATIENCE_S,
            check=False,
        )
    assert done.returncode == 3
