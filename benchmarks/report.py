#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How long kitti-ros2 report takes, start included, and how its memory grows.

    python benchmarks/report.py SRC [--long LONGER_SRC] [--repeat N] [--dir FOLDER]

SRC is a KITTI drive or a bag; the limit is that of 120 frames on 2 cores.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from statistics import median

from yardsticks import parse_arguments, process, report

LIMIT_S = 10.0
GROWTH = 1.2


def main() -> None:
    """Measure."""
    arguments = parse_arguments(__doc__)
    with tempfile.TemporaryDirectory(dir=arguments.dir) as folder:
        page = Path(folder) / 'report.html'

        def make(src: Path) -> tuple[float, float, int]:
            run, peak = process(page, 'report', str(src), '-o', str(page), '-q')
            return run.seconds, peak, run.size_bytes

        runs = [make(arguments.src) for _ in range(arguments.repeat)]
        seconds, peak = median([run[0] for run in runs]), median([run[1] for run in runs])
        note = f'a page of {runs[0][2] / 1e6:.1f} MB, memory {peak:.0f} MB'
        report('report, seconds', seconds, f'<= {LIMIT_S:.0f}', note)
        if arguments.long is not None:
            _, longer, _ = make(arguments.long)
            report('memory of the longer drive', longer / peak, f'<= {GROWTH}', f'{longer:.0f} MB')


if __name__ == '__main__':
    main()
