# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A calibration that changes within a bag: each frame of an object set has the one of its stamp."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.samples import rect_from_velo
from kitti_ros2.model.streams import Layout

from cropped_set import crop_frame  # isort: skip

POINTS = np.array([[9.0, 2.0, -1.0], [20.0, -5.0, 0.5], [40.0, 1.0, 2.0]])


@pytest.fixture
def source(recordings, tmp_path):
    """An object set of two calibrations and sizes: of frame 1, and of the others."""
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.OBJECT], root)
    crop_frame(root, 1)
    return root


def pixels(root, number: int, camera: int = 2) -> np.ndarray:
    found = open_recording(root).calibration(number)
    places = rect_from_velo(found).apply(POINTS)
    seen = np.column_stack([places, np.ones(len(places))]) @ found.cameras[camera].p_rect.T
    return seen[:, :2] / seen[:, 2:]


def to_bag(source, bag, *words: str):
    assert main(['to-bag', str(source), str(bag), '--exclude-topics', *words, '-q']) == 0
    return bag


@pytest.mark.one_in(3)
@pytest.mark.parametrize('suffix', ['mcap', 'bag'])
@pytest.mark.parametrize('topics', [('/kitti/source/*',), ('/kitti/source/*', '*right*')])
@pytest.mark.parametrize('incomplete', ['keep', 'drop'])
def test_each_frame_has_its_own(source, tmp_path, capsys, suffix, topics, incomplete):
    bag = to_bag(source, tmp_path / f'own.{suffix}', *topics)
    plan, out = tmp_path / 'plan.yaml', tmp_path / 'out'
    assert main(['to-kitti', str(bag), '--layout', 'object', '--plan']) == 0
    text = capsys.readouterr().out
    plan.write_text(text.replace('incomplete: keep', f'incomplete: {incomplete}'))
    assert main(['to-kitti', str(bag), str(out), '--plan-file', str(plan)]) == 0
    assert '2 calibrations, each frame has the one valid at its stamp' in capsys.readouterr().out
    for stream in ('image_2', 'velodyne', 'calib', 'label_2'):
        names = [
            {file.name for file in (root / f'training/{stream}').iterdir()}
            for root in (out, source)
        ]
        assert names[0] == names[1]
    for number in range(3):
        np.testing.assert_allclose(pixels(out, number), pixels(source, number), atol=1e-3)
    assert np.abs(pixels(source, 1) - pixels(source, 0)).max() > 10


@pytest.mark.parametrize('layout', ['tracking', 'odometry'])
def test_a_layout_with_one_calibration_says_for_which_frames_it_holds(
    source, tmp_path, capsys, layout
):
    bag = to_bag(source, tmp_path / 'own.mcap', '/kitti/source/*')
    out = tmp_path / 'out'
    main(['to-kitti', str(bag), str(out), '--layout', layout, '--end', '1'])
    said = capsys.readouterr()
    assert 'skipped calibration (1): CameraInfo or static transforms change' in said.err
    assert 'holds for frames 0' in said.err
    assert (
        main(['to-kitti', str(bag), str(out), '--layout', layout, '--end', '0', '--overwrite']) == 0
    )
