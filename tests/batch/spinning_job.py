# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A job of to-bag that goes on in the middle, if armed, until it is stopped or released."""

from __future__ import annotations

import os
from pathlib import Path

from kitti_ros2.batch.job_functions import run_bag_job

from blocking_job import BLOCK_AT, FOLDER, _take  # isort: skip


def run_spinning(task, advance):
    """Run a job; if armed, report a sample of it again and again."""

    def spin(done, total):
        advance(done, total)
        folder = os.environ.get(FOLDER)
        if folder and done == BLOCK_AT and _take(Path(folder)):
            (Path(folder) / 'name').write_text(task.job.name)
            written = Path(folder) / 'pid.partial'
            written.write_text(str(os.getpid()))
            written.rename(Path(folder) / 'pid')
            while not (Path(folder) / 'released').exists():
                advance(done, total)

    return run_bag_job(task, spin)
