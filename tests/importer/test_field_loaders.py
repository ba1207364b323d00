# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the field's loaders make of a bag of others, against what is true; where they are there.

pip install pykitti kiss-icp evo trackeval

The demands of those that are not small packages, mmdetection3d and OpenPCDet, are checked by
field_readers, which also finds planted faults, and the known counts in real KITTI.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from datetime import timezone
from pathlib import Path

import foreign
import numpy as np
import pytest
from builders import OF_OTHERS
from field_readers import (
    check_evo,
    check_kiss_icp,
    check_mmdet3d,
    check_openpcdet,
    check_pykitti,
    points_in_labels,
)

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti import names
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

TRUTH = foreign.make_truth()


@pytest.fixture(scope='module')
def trees(tmp_path_factory):
    """The bag in every layout, its boxes called visible."""
    folder = tmp_path_factory.mktemp('loaders')
    bag = foreign.write_foreign(folder / 'bag.mcap', TRUTH)
    survey = survey_bags([bag])
    for layout in OF_OTHERS:
        options = ImportOptions(layout=layout)
        plan = guess([bag], survey, options).plan
        if plan.labels is not None:
            plan = replace(plan, labels=replace(plan.labels, occluded=0))
        convert_by_plan([bag], plan, survey, folder / layout.value, options)
    return {layout: folder / layout.value for layout in OF_OTHERS}


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


TURN_DEGREES = 20
"""The lidar of the rig is turned by 18 degrees from the camera, which the checks tell otherwise."""


def test_object_set_is_accepted(trees):
    root = trees[Layout.OBJECT]
    assert check_mmdet3d(root, axes_degrees=TURN_DEGREES) == []
    assert check_openpcdet(root, axes_degrees=TURN_DEGREES) == []


def test_turned_scan_is_told(trees):
    for check in (check_mmdet3d, check_openpcdet):
        breaches = check(trees[Layout.OBJECT])
        assert len(breaches) == foreign.FRAMES
        assert all('turned by -18.4' in line for line in breaches)


def test_drives_and_sequences_are_accepted(trees):
    for layout in (Layout.RAW, Layout.ODOMETRY, Layout.TRACKING):
        assert check_pykitti(trees[layout]) == []
    assert check_kiss_icp(trees[Layout.ODOMETRY]) == []
    assert check_evo(trees[Layout.ODOMETRY] / 'poses/00.txt') == []


def edit(path: Path, change) -> None:
    path.write_text(change(path.read_text()))


OBJECT_FAULTS = {
    'image absent': (lambda t: (t / 'image_2/000003.png').unlink(), 'is absent'),
    'calib short': (
        lambda t: edit(t / 'calib/000003.txt', lambda text: ''.join(text.splitlines(True)[:5])),
        'line 6',
    ),
    'no focal length': (
        lambda t: edit(t / 'calib/000003.txt', lambda text: text.replace('5.000', '0.000')),
        'no inverse',
    ),
    'scan cut': (
        lambda t: (t / 'velodyne/000003.bin').write_bytes(bytes(4 * 4 * 100 + 4)),
        'is no scan',
    ),
    'nothing in view': (
        lambda t: (t / 'velodyne/000003.bin').write_bytes(
            np.array([[-9, 0, 0, 0]], np.float32).tobytes()
        ),
        'no point in view',
    ),
    'DontCare first': (
        lambda t: edit(
            t / 'label_2/000003.txt',
            lambda text: 'DontCare -1 -1 -10 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10\n' + text,
        ),
        'DontCare stands before',
    ),
    'two blanks': (
        lambda t: edit(t / 'label_2/000003.txt', lambda text: text.replace(' ', '  ', 1)),
        'could not convert',
    ),
}


@pytest.mark.parametrize('fault', OBJECT_FAULTS)
def test_fault_of_an_object_set_is_found(trees, tmp_path, fault):
    plant, told = OBJECT_FAULTS[fault]
    root = Path(shutil.copytree(trees[Layout.OBJECT], tmp_path / 'set'))
    plant(root / 'training')
    for check in (check_mmdet3d, check_openpcdet):
        breaches = check(root, axes_degrees=TURN_DEGREES)
        assert breaches
        assert all('000003' in line for line in breaches)
        assert any(told in line for line in breaches)


def test_frame_without_a_box_is_openpcdets_own_demand(trees, tmp_path):
    root = Path(shutil.copytree(trees[Layout.OBJECT], tmp_path / 'set'))
    (root / 'training/label_2/000003.txt').write_text('')
    assert check_mmdet3d(root, axes_degrees=TURN_DEGREES) == []
    (line,) = check_openpcdet(root, axes_degrees=TURN_DEGREES)
    assert 'no object' in line


def test_empty_parts_stop_the_whole_preparation_of_mmdet3d(trees):
    told = check_mmdet3d(trees[Layout.OBJECT], whole=True, axes_degrees=TURN_DEGREES)
    assert [Path(line.split(':')[0]).stem for line in told] == ['val', 'test']


SEQUENCE_FAULTS = {
    'scan absent': (Layout.RAW, '*/*_drive_*/velodyne_points/data/0000000003.bin', None),
    'no times': (Layout.RAW, '*/*_drive_*/oxts/timestamps.txt', None),
    'no calibration': (Layout.RAW, '*/calib_imu_to_velo.txt', None),
    'short packet': (
        Layout.RAW,
        '*/*_drive_*/oxts/data/0000000003.txt',
        lambda text: text.rsplit(' ', 3)[0],
    ),
    'image absent': (Layout.ODOMETRY, 'sequences/00/image_2/000003.png', None),
    'times short': (Layout.ODOMETRY, 'sequences/00/times.txt', lambda text: text[:26]),
    'no Tr': (Layout.ODOMETRY, 'sequences/00/calib.txt', lambda text: text.replace('Tr', 'tr')),
    'poses short': (Layout.ODOMETRY, 'poses/00.txt', lambda text: text.split('\n', 1)[1]),
    'track absent': (Layout.TRACKING, 'training/image_02/0000/000003.png', None),
}


@pytest.mark.parametrize('fault', SEQUENCE_FAULTS)
def test_fault_of_a_drive_or_sequence_is_found(trees, tmp_path, fault):
    layout, pattern, change = SEQUENCE_FAULTS[fault]
    root = Path(shutil.copytree(trees[layout], tmp_path / 'set'))
    (path,) = root.glob(pattern)
    if change is None:
        path.unlink()
    else:
        edit(path, change)
    assert check_pykitti(root)


def test_fault_of_poses_is_found(trees, tmp_path):
    path = tmp_path / 'poses.txt'
    shutil.copy(trees[Layout.ODOMETRY] / 'poses/00.txt', path)
    edit(path, lambda text: text.replace('\n', ' \n', 1))
    assert ['13 entries' in line for line in check_evo(path)] == [True]
    edit(path, lambda text: text.replace(' \n', '\n').replace(text.split()[0], '2.0', 1))
    assert any('no rotation' in line for line in check_evo(path))


def test_counts_in_labels_of_real_kitti(real_kitti):
    """As mmdet3d and OpenPCDet publish them; one or two points off the upright box's own."""
    assert points_in_labels(real_kitti / 'object') == {
        '000000': [377],
        '000001': [71, 9, 18, -1, -1, -1, -1],
        '000002': [1349, 67],
    }
