# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A unit of to-bag that goes on in the middle, if armed, until it is stopped or released."""

from __future__ import annotations

import os
from pathlib import Path

from kitti_ros2.batch.unit_functions import run_bag_unit

from blocking_unit import BLOCK_AT, FOLDER, _take  # isort: skip


def run_spinning(job, advance):
    """Run a unit; if armed, report a sample of it again and again."""

    def spin(done, total):
        advance(done, total)
        folder = os.environ.get(FOLDER)
        if folder and done == BLOCK_AT and _take(Path(folder)):
            (Path(folder) / 'name').write_text(job.unit.name)
            written = Path(folder) / 'pid.partial'
            written.write_text(str(os.getpid()))
            written.rename(Path(folder) / 'pid')
            while not (Path(folder) / 'released').exists():
                advance(done, total)

    return run_bag_unit(job, spin)
