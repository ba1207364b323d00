# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A short run of the soak: it ends by what has happened, not by time."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2 (pip install kitti_ros2[ros])')

import ros_domain  # noqa: F401 - sets the environment of what is started here

from figures import in_10_000, slope_mb_per_10_min  # isort: skip

ROOT = Path(__file__).resolve().parents[3]
FRAMES = 5
LOOPS = 4


def test_a_player_under_load_stays_well():
    words = ['--loops', LOOPS, '--frames', FRAMES, '--rate', 2, '--subscribers', 2]
    words += ['--longest', 4, '--calls-every', 0.1]
    done = subprocess.run(
        [sys.executable, '-m', 'tests.torture.soak', *map(str, words)], cwd=ROOT,
        env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
    figures = json.loads(done.stdout)
    assert (done.returncode, figures['stderr'], figures['stderr_of_others']) == (0, [], [])
    assert figures['frames'] >= LOOPS * FRAMES
    assert figures['calls'] >= LOOPS
    assert 1 < figures['in_use_mb'] < figures['rss_mb'][1]
    assert figures['in_use_mb_per_10_min_after_5'] is None  # too short
    assert figures['subscribers_gone'] >= LOOPS
    assert figures['unanswered'] == 0
    assert figures['timer_worst_ms'] is not None
    assert figures['publisher_worst_ms'] is not None


def test_the_slope_is_that_of_the_settled_part():
    times = range(900)
    sizes = [each * 1_000_000 if each < 300 else 4 * 10**8 + each * 10_000 for each in times]
    assert slope_mb_per_10_min(times, sizes) == pytest.approx(6.0)
    assert slope_mb_per_10_min(times[:300], sizes[:300]) is None


def test_shares():
    assert in_10_000(3, 30_000) == 1
    assert in_10_000(0, 0) == 0
