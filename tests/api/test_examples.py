# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each example runs as its first line says, and passes the strict type check."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.model.layouts import Layout

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
NAMES = sorted(path.name for path in EXAMPLES.glob('*.py'))


def run(name, *words):
    command = [sys.executable, EXAMPLES / name, *words]
    package = Path(kitti_ros2.__file__).resolve().parents[1]
    environment = {**os.environ, 'PYTHONPATH': f'{package}{os.pathsep}{EXAMPLES}'}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_kitti_in_20_lines(recording_path):
    text = run('kitti_in_20_lines.py', recording_path)
    assert 'points are in the image of camera 2' in text
    lines = (EXAMPLES / 'kitti_in_20_lines.py').read_text().split('"""')[2].strip().splitlines()
    assert len([line for line in lines if line]) <= 20


def test_training_dataset(recordings):
    text = run('training_dataset.py', recordings[Layout.OBJECT])
    assert 'points: (' in text
    assert 'gt_boxes: (' in text


def test_custom_sensor(tmp_path):
    run('custom_sensor.py', tmp_path / 'set')
    recording = kitti_ros2.open(tmp_path / 'set')
    assert recording.numbers.tolist() == [0, 1]
    for frame in recording:
        (car,) = frame.objects
        np.testing.assert_allclose(
            car.box, [12 + frame.number, 1.5, -0.9, 4.2, 1.7, 1.5, 0.3], atol=0.01
        )
        inside = np.linalg.inv(car.pose()) @ np.column_stack([frame.points[:, :3], np.ones(5500)]).T
        assert (np.abs(inside[:3].T) < car.box[3:6] / 2 + 0.01).all(axis=1).sum() >= 400


def test_colored_points(recordings, tmp_path):
    text = run('colored_points.py', recordings[Layout.RAW], tmp_path / 'out.ply')
    count = int(text.split(': ')[1].split()[0])
    head, _, body = (tmp_path / 'out.ply').read_bytes().partition(b'end_header\n')
    assert f'element vertex {count}'.encode() in head
    assert len(body) == count * 15


@pytest.fixture(scope='module')
def type_check():
    """What mypy says of all examples; its own process, for mypy raises the recursion limit."""
    pytest.importorskip('mypy')
    command = [sys.executable, '-m', 'mypy', '--strict', '--no-error-summary', EXAMPLES]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize('name', NAMES)
def test_every_example_is_tested_and_typed(name, type_check):
    assert f"'{name}'" in Path(__file__).read_text()
    assert type_check.returncode == 0, type_check.stdout + type_check.stderr
