# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each example runs as its first line says, and passes the strict type check."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import ros_domain  # noqa: F401 - sets the environment, before anything imports rclpy

import kitti_ros2
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.evaluation import live
from kitti_ros2.messages.cdr import deserialize, stamp_ns_of, transform_of
from kitti_ros2.messages.detections import cuboids_of_detections
from kitti_ros2.model.bag_formats import DETECTIONS_3D, ODOMETRY
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from shared_files import made_once  # isort: skip

pytestmark = pytest.mark.programs

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
    has_camera = 'image_2' in kitti_ros2.open(recording_path).streams
    assert ('points are in the image of camera 2' in text) is has_camera
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
def street(tmp_path_factory):
    """A drive of a few seconds, with scans that are dense enough for algorithms."""
    options = SyntheticOptions(frames=24, image_size=(62, 19), lidar_columns=500)
    return made_once(
        tmp_path_factory,
        'street',
        lambda folder: write_synthetic(folder / 'tracking', Layout.TRACKING, options),
    )


@pytest.fixture
def answers(street, tmp_path, monkeypatch):
    """Run a node of the examples on the drive; returns the messages by frame number."""
    pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')
    unscored = SimpleNamespace(losses=(), notes=())
    monkeypatch.setattr(live, 'score_results', lambda *_: unscored)

    def answers(name, topic, msgtype):
        out = tmp_path / 'results.mcap'
        node = shlex.join([sys.executable, str(EXAMPLES / name)])
        found = live.evaluate_live(street, topic=topic, node=node, out=out)
        assert found.losses == ()
        assert found.missing == ()
        with open_messages(out, {topic}) as messages:
            results = [deserialize(each.data, msgtype) for each in messages]
        numbers = {frame.stamp_ns: frame.number for frame in kitti_ros2.open(street)}
        return {numbers[stamp_ns_of(each.header)]: each for each in results}

    return answers


def test_cluster_detector(answers, street):
    found = answers('cluster_detector.py', '/cluster_detector/detections', DETECTIONS_3D)
    recording = kitti_ros2.open(street)
    hits = []
    for number, message in found.items():
        cuboids, absurd = cuboids_of_detections(message, {'velo_link': Transform.identity()})
        assert absurd == []
        assert all(0 < each.score < 1 for each in cuboids)
        cars = [each.velo_T_box.translation[:2] for each in cuboids if each.class_name == 'Car']
        for each in recording.frame(number).objects:
            place = each.box[:2]
            if each.class_name == 'Car' and np.hypot(*place) < 25:
                hits.append(any(np.hypot(*(place - car)) < 1 for car in cars))
    assert len(hits) > 30
    assert np.mean(hits) > 0.6


def test_kiss_icp_odometry(answers, street):
    pytest.importorskip('kiss_icp', reason='needs kiss-icp (pip install kiss-icp)')
    found = answers('kiss_icp_odometry.py', '/kiss_icp_odometry/odometry', ODOMETRY)
    recording = kitti_ros2.open(street)
    assert [*found] == recording.numbers.tolist()
    assert {each.header.frame_id for each in found.values()} == {'odom'}
    assert {each.child_frame_id for each in found.values()} == {'velo_link'}
    true = [recording.frame(number).transform('map', 'velo_link') for number in found]
    measured = [transform_of(each.pose.pose).matrix() for each in found.values()]
    length = sum(np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in pairwise(true))
    gone, moved = (np.linalg.inv(poses[0]) @ poses[-1] for poses in (true, measured))
    assert length > 15
    assert np.linalg.norm((gone - moved)[:3, 3]) < 0.02 * length


@pytest.fixture(scope='module')
def type_check():
    """What mypy says of all examples; its own process, for mypy raises the recursion limit."""
    pytest.importorskip('mypy')
    command = [sys.executable, '-m', 'mypy', '--strict', '--no-error-summary', EXAMPLES]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('name', NAMES)
def test_every_example_is_tested_and_typed(name, type_check):
    assert f"'{name}'" in Path(__file__).read_text()
    assert type_check.returncode == 0, type_check.stdout + type_check.stderr
