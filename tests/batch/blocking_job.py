# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A job of to-bag that blocks in the middle when the test has armed it, until it is killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from kitti_ros2.batch.job_functions import run_bag_job

FOLDER = 'KITTI_ROS2_TEST_BLOCK'
BLOCK_AT = 6
"""Samples done: the bag is half written."""


def run_blocking(task, advance):
    """Run a job; block at a sample if armed."""

    def stop(done, total):
        advance(done, total)
        folder = os.environ.get(FOLDER)
        if folder and done == BLOCK_AT and _take(Path(folder)):
            if (Path(folder) / 'deaf').exists():
                signal.signal(signal.SIGTERM, lambda *_: (Path(folder) / 'asked').touch())
            (Path(folder) / 'name').write_text(task.job.name)
            written = Path(folder) / 'pid.partial'
            written.write_text(str(os.getpid()))
            written.rename(Path(folder) / 'pid')
            while True:
                signal.pause()

    return run_bag_job(task, stop)


def arm(folder):
    """Let the next job block."""
    (folder / 'armed').touch()


def _take(folder):
    try:
        (folder / 'armed').unlink()
    except FileNotFoundError:
        return False
    return True
