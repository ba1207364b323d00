# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Compact clouds of a bag, heard by a second process as PointCloud2."""

import shutil

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.kitti.scan_grid import on_grid
from kitti_ros2.messages.clouds import read_points
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import CLOUD
from kitti_ros2.model.streams import Layout

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import live

from waiting import PATIENCE_S  # isort: skip

POINTS = '/kitti/velo/points'
HALF_MM = 0.000504


def test_compact_clouds_are_heard_as_plain_ones(recordings, tmp_path):
    source, bag = tmp_path / 'object', tmp_path / 'bag.mcap'
    shutil.copytree(recordings[Layout.OBJECT], source)
    scans = []
    for path in sorted(source.glob('training/velodyne/*.bin')):
        points = np.fromfile(path, '<f4').reshape(-1, 4)
        points[:, :3] = on_grid(points[:, :3])
        points[:, 3] = np.rint(points[:, 3] * 100) / 100
        points.tofile(path)
        scans.append(points)
    assert main(['to-bag', str(source), str(bag), '--clouds', 'compact']) == 0
    process = live.play(bag, '--start-paused')
    try:
        assert process.stderr.readline()  # its topics come next
        listener = live.Listening({POINTS: CLOUD})
        try:
            listener.wait_for_publishers(process)
            assert listener.tell('offer', POINTS)[0][0] == CLOUD
            assert listener.tell('call', 'resume')[0]
            _, said = process.communicate(timeout=PATIENCE_S)
            assert (process.returncode, 'Traceback' in said) == (0, False), said
            assert listener.tell('wait', POINTS, len(scans)) == len(scans)
            last = bytes.fromhex(listener.tell('last', POINTS))
        finally:
            live.stop(listener.process)
    finally:
        live.stop(process)
    cloud = read_points(TYPESTORE.deserialize_cdr(last, CLOUD), None)
    assert np.abs(cloud - scans[-1])[:, :3].max() < HALF_MM
    assert np.abs(cloud - scans[-1])[:, 3].max() < 1e-6
