# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""python -m benchmarks prints a table in Markdown, with peers that are absent named."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from kitti_ros2.model.streams import Layout

REPO = Path(__file__).parents[1]
RATIO = re.compile(r'\*\*\d+\.\d\d\*\* \(\d+\.\d\d to \d+\.\d\d\)')


def test_the_table_has_a_line_for_each_peer(recordings, tmp_path):
    words = ['-m', 'benchmarks', recordings[Layout.RAW], '--pairs', '1', '--dir', tmp_path]
    done = subprocess.run(
        [sys.executable, *map(str, words), '--only', 'zstd', 'ROS 1', '`info`', '--devkit', 'none'],
        cwd=REPO,
        env=os.environ | {'PATH': '/usr/bin:/bin'},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    _, _, head, rule, *lines = done.stdout.splitlines()
    rows = [[cell.strip() for cell in line.split('|')[1:-1]] for line in lines if line[:1] == '|']
    assert {len(row) for row in rows} == {head.count('|') - 1} == {rule.count('|') - 1}
    named = {row[4].replace(': not installed', ''): row for row in rows}
    assert [*named] == ['loop, rosbags', 'pymcap-cli', 'rosbags-convert', 'mcap', 'rosbags']
    for name in ('loop, rosbags', 'mcap', 'rosbags'):
        seconds, cpu, memory, ratio, cpu_ratio = named[name][5:]
        assert float(seconds) > 0
        assert float(cpu) > 0
        assert float(memory) > 0
        assert RATIO.fullmatch(ratio)
        assert RATIO.fullmatch(cpu_ratio)
    for name in ('pymcap-cli', 'rosbags-convert'):
        assert named[name][4] == f'{name}: not installed'
    assert [*tmp_path.iterdir()] == []
