# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the field's loaders make of a bag of others, against what is true; where they are there.

pip install pykitti kiss-icp evo trackeval
"""

from __future__ import annotations

from dataclasses import replace
from datetime import timezone

import foreign
import numpy as np
import pytest

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import look
from kitti_ros2.kitti import names
from kitti_ros2.model.layouts import Layout
from kitti_ros2.options.importing import ImportOptions

TRUTH = foreign.make_truth()


@pytest.fixture(scope='module')
def trees(tmp_path_factory):
    """The bag in every layout, its boxes called visible."""
    folder = tmp_path_factory.mktemp('loaders')
    bag = foreign.write_foreign(folder / 'bag.mcap', TRUTH)
    survey = look([bag])
    for layout in Layout:
        options = ImportOptions(layout=layout)
        plan = guess([bag], survey, options).plan
        if plan.labels is not None:
            plan = replace(plan, labels=replace(plan.labels, occluded=0))
        convert_by_plan([bag], plan, survey, folder / layout.value, options)
    return {layout: folder / layout.value for layout in Layout}


def assert_true_samples(loaded):
    """Of pykitti, which takes the files that it finds."""
    for each, scan in zip(TRUTH, loaded.velo, strict=True):
        np.testing.assert_allclose(scan, each.points, atol=1e-4)
    for images in (list(loaded.cam2), list(loaded.cam3)):
        assert [image.size for image in images] == [foreign.SIZE] * foreign.FRAMES


def assert_true_calibration(calib):
    truth = foreign.lidar_t_camera().inverse().matrix()
    np.testing.assert_allclose(calib.T_cam2_velo, truth, atol=1e-6)
    np.testing.assert_allclose(calib.K_cam2, foreign.K_RECT, atol=1e-6)
    assert calib.b_rgb == pytest.approx(foreign.BASELINE, abs=1e-6)


def test_pykitti_odometry(trees):
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    loaded = pykitti.odometry(str(trees[Layout.ODOMETRY]), '00')
    assert len(loaded) == foreign.FRAMES
    assert_true_samples(loaded)
    assert_true_calibration(loaded.calib)
    np.testing.assert_allclose(loaded.poses, foreign.camera_poses(TRUTH), atol=1e-4)


def test_pykitti_raw(trees):
    pykitti = pytest.importorskip('pykitti', reason='pykitti is not installed')
    (drive,) = trees[Layout.RAW].glob('*/*_drive_*')
    date, number, kind = drive.parent.name, drive.name.split('_')[-2], drive.name.split('_')[-1]
    loaded = pykitti.raw(str(trees[Layout.RAW]), date, number, dataset=kind)
    assert len(loaded) == len(loaded.oxts) == foreign.FRAMES
    assert_true_samples(loaded)
    for each, stamp in zip(TRUTH, loaded.timestamps, strict=True):
        told = stamp.replace(tzinfo=timezone.utc).timestamp()
        assert told == pytest.approx(each.stamp_ns / 1e9, abs=2e-6)
    for number, packet in enumerate(loaded.oxts):
        assert packet.packet.yaw == pytest.approx(0.02 * number, abs=2e-3)


def test_pykitti_tracking(trees):
    tracking = pytest.importorskip('pykitti.tracking', reason='pykitti is not installed')
    loaded = tracking.tracking(str(trees[Layout.TRACKING] / 'training'), '0000')
    assert_true_samples(loaded)


def test_kiss_icp_odometry(trees):
    kitti = pytest.importorskip('kiss_icp.datasets.kitti', reason='kiss-icp is not installed')
    loaded = kitti.KITTIOdometryDataset(trees[Layout.ODOMETRY], '00')
    assert len(loaded) == foreign.FRAMES
    for index in range(foreign.FRAMES):
        scan, _ = loaded[index]
        assert scan.shape == TRUTH[index].points[:, :3].shape
    velo_t_camera = foreign.lidar_t_camera().matrix()
    expected = velo_t_camera @ foreign.camera_poses(TRUTH) @ np.linalg.inv(velo_t_camera)
    np.testing.assert_allclose(loaded.gt_poses, expected, atol=1e-4)


def test_evo_poses(trees):
    files = pytest.importorskip('evo.tools.file_interface', reason='evo is not installed')
    (path,) = (trees[Layout.ODOMETRY] / names.POSES).iterdir()
    loaded = files.read_kitti_poses_file(str(path))
    assert loaded.check()[0], loaded.check()
    np.testing.assert_allclose(loaded.poses_se3, foreign.camera_poses(TRUTH), atol=1e-4)


def test_trackeval_counts_every_box(trees, tmp_path):
    trackeval = pytest.importorskip('trackeval', reason='trackeval is not installed')
    labels = (trees[Layout.TRACKING] / 'training/label_02/0000.txt').read_text()
    found = ''.join(f'{line} 0.9\n' for line in labels.splitlines())
    for folder, text in (('truth/label_02', labels), ('trackers/own/data', found)):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / '0000.txt').write_text(text)
    sequences = f'0000 empty 000000 {foreign.FRAMES:06d}\n'
    (tmp_path / 'truth/evaluate_tracking.seqmap.training').write_text(sequences)
    folders = {
        'GT_FOLDER': str(tmp_path / 'truth'),
        'TRACKERS_FOLDER': str(tmp_path / 'trackers'),
        'OUTPUT_FOLDER': str(tmp_path / 'out'),
    }
    dataset = trackeval.datasets.Kitti2DBox({**folders, 'PRINT_CONFIG': False})
    quiet = ('USE_PARALLEL', 'PRINT_RESULTS', 'PRINT_CONFIG', 'PLOT_CURVES', 'OUTPUT_SUMMARY')
    evaluator = trackeval.Evaluator({**dict.fromkeys(quiet, False), 'OUTPUT_DETAILED': False})
    metric = trackeval.metrics.CLEAR({'PRINT_CONFIG': False})
    results, _ = evaluator.evaluate([dataset], [metric])
    car = results['Kitti2DBox']['own']['0000']['car']['CLEAR']
    assert (car['MOTA'], car['CLR_TP']) == (1, foreign.FRAMES)
