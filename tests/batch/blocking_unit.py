# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A unit of to-bag that blocks in the middle when the test has armed it, until it is killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from kitti_ros2.batch.unit_functions import run_bag_unit

FOLDER = 'KITTI_ROS2_TEST_BLOCK'
BLOCK_AT = 6
"""Samples done: the bag is half written."""


def run_blocking(job, advance):
    """Run a unit; block at a sample if armed."""

    def stop(done, total):
        advance(done, total)
        folder = os.environ.get(FOLDER)
        if folder and done == BLOCK_AT and _take(Path(folder)):
            if (Path(folder) / 'deaf').exists():
                signal.signal(signal.SIGTERM, lambda *_: (Path(folder) / 'asked').touch())
            (Path(folder) / 'name').write_text(job.unit.name)
            written = Path(folder) / 'pid.partial'
            written.write_text(str(os.getpid()))
            written.rename(Path(folder) / 'pid')
            while True:
                signal.pause()

    return run_bag_unit(job, stop)


def arm(folder):
    """Let the next unit block."""
    (folder / 'armed').touch()


def _take(folder):
    try:
        (folder / 'armed').unlink()
    except FileNotFoundError:
        return False
    return True
