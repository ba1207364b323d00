# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360: real files against values that NumPy found without this package, and faulty ones.

The values are those of facts.py and README.md beside the files; they are skipped without them.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import kitti_ros2
from kitti_ros2.cli import main
from kitti_ros2.datasets import statistics
from kitti_ros2.kitti.kitti360 import parse_kitti360_poses
from kitti_ros2.kitti.kitti360_calib import (
    format_kitti360_calibration,
    parse_kitti360_calibration,
)
from kitti_ros2.kitti.names import KITTI_360_CALIB
from kitti_ros2.kitti.opening import guess_layout, open_recording, open_recordings
from kitti_ros2.kitti.text_file import parse_timestamps
from kitti_ros2.messages.camera_info import with_nominal_mounts
from kitti_ros2.messages.scan import rings
from kitti_ros2.model.lenses import MeiLens
from kitti_ros2.model.streams import Clock, Layout, Stream
from kitti_ros2.options.read import ReadOptions

from builders import convert_recording  # isort: skip

D = '2013_05_28_drive_{}_sync'
PIXELS = ((1408, 376), (1408, 376), (1400, 1400), (1400, 1400))


@pytest.fixture(scope='module')
def set_of_links(real_360, tmp_path_factory) -> Path:
    """The real files in a folder of one's own, to take some away."""
    root = tmp_path_factory.mktemp('kitti360')
    shutil.copytree(real_360, root / 'set', copy_function=os.symlink)
    return root / 'set'


def test_contradicting_poses_are_apart_in_metres_and_degrees(set_of_links, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(set_of_links, root)
    path = root / 'calibration' / 'perspective.txt'
    text = path.read_text()
    path.unlink()
    lines = [line for line in text.splitlines(True) if not line.startswith('R_rect_00')]
    path.write_text(''.join(lines) + 'R_rect_00: 1 0 0 0 1 0 0 0 1\n')
    recording = open_recording(root, ReadOptions(sequence='0010'))
    said = [*recording.contradictions()]
    assert len(said) == len(recording.streams[Stream.POSE])
    assert all(re.search(r'is 0\.00. m, 0\.4.. deg from poses.txt', line) for line in said), said


@pytest.fixture(scope='module')
def rig(real_360):
    return kitti_ros2.read_calibration(real_360 / 'calibration')


def read_stamps(path):
    return parse_timestamps(path.read_text(), path).values


def inside(pixels, camera):
    width, height = PIXELS[camera]
    u, v = pixels.T
    return int(((u >= 0) & (u < width) & (v >= 0) & (v < height)).sum())


# Scans in the images: points, and those in image_00 to image_03.
SCANS = {
    ('0000', 1134): (112580, 25407, 25225, 65676, 58944),
    ('0008', 3000): (111883, 27707, 27128, 66889, 57138),
    ('0008', 3001): (113489, 27341, 26664, 66907, 58739),
}


@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
@pytest.mark.parametrize(('drive', 'number'), SCANS)
def test_points_in_the_four_images(real_360, drive, number):
    frame = kitti_ros2.open(real_360, sequence=drive).frame(number)
    points, *expected = SCANS[drive, number]
    assert len(frame.points) == points
    counts = [inside(frame.calibration.project(frame.points, c)[0], c) for c in range(4)]
    assert counts == expected


@pytest.mark.parametrize('camera', range(4))
def test_pixels_and_depths_lead_back_to_the_points(real_360, rig, camera):
    path = real_360 / f'data_3d_raw/{D.format("0008")}/velodyne_points/data/0000003000.bin'
    points = np.fromfile(path, np.float32).reshape(-1, 4)[::97, :3].astype(np.float64)
    pixels, depth = rig.project(points, camera)
    seen = np.isfinite(pixels[:, 0])
    width, height = PIXELS[camera]
    seen &= (pixels > -200).all(axis=1) & (pixels < (width + 200, height + 200)).all(axis=1)
    assert seen.sum() > 200
    np.testing.assert_allclose(
        rig.unproject(pixels[seen], depth[seen], camera), points[seen], atol=1e-6
    )


@pytest.mark.parametrize(
    ('camera', 'angle', 'radius'),
    [(2, 90.0, 647), (3, 90.0, 647), (2, 98.9, 700), (3, 99.7, 700)],
)
def test_fisheyes_see_behind_their_image_plane(rig, camera, angle, radius):
    model = rig.model.cameras[camera]
    lens = MeiLens(model.lens.xi, np.array([*model.lens.d[:2], 0.0, 0.0]))
    ray = np.array([[np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))]])
    assert model.p_rect[0, 0] * lens.bent(ray)[0, 0] == pytest.approx(radius, abs=1)


@pytest.mark.parametrize(('camera', 'limit'), [(2, 116.9), (3, 113.1)])
def test_nothing_is_folded_back_into_the_image(rig, camera, limit):
    angles = np.radians(np.arange(0.05, 180, 0.1))
    rays = np.stack([np.sin(angles), np.zeros_like(angles), np.cos(angles)], axis=1)
    with np.errstate(invalid='ignore'):
        bent = rig.model.cameras[camera].lens.bent(rays)
    seen = np.isfinite(bent[:, 0])
    assert np.degrees(angles[seen].max()) == pytest.approx(limit, abs=0.2)
    assert seen[: seen.sum()].all()


ORIGINS = {
    0: (0.8044, 0.2993, -0.1770),
    1: (0.8303, -0.2943, -0.1797),
    2: (-0.0497, 0.4475, 0.2332),
    3: (-0.0692, -0.4489, 0.2369),
}


def test_mounts(rig):
    for camera, origin in ORIGINS.items():
        found_at = rig.transform('velo_link', camera)[:3, 3]
        np.testing.assert_allclose(found_at, origin, atol=2e-3 if camera == 1 else 6e-5)
    np.testing.assert_allclose(
        rig.transform('velo_link', 'imu_link')[:3, 3], (-0.7640, 0.2966, -0.8434), atol=6e-5
    )
    assert rig.transform(1, 0)[0, 3] == pytest.approx(-0.59418, abs=1e-5)
    # imu_link is x forward, y left, z up, as the scanner, within the few degrees of its mount.
    np.testing.assert_allclose(rig.transform('velo_link', 'imu_link')[:3, :3], np.eye(3), atol=0.05)


def test_k_ends_in_1_and_storage_is_read(rig):
    assert [rig.model.cameras[c].k[2].tolist() for c in (0, 1)] == [[0, 0, 1]] * 2
    assert not rig.model.missing
    assert rig.model.cameras[2].lens.xi == 2.2134047507854890
    assert [rig.model.cameras[c].size for c in range(4)] == list(PIXELS)


@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
def test_frames_are_paired_by_number(real_360):
    recording = kitti_ros2.open(real_360, sequence='0000')
    poses = recording.streams['pose']
    assert (len(poses), poses[0], poses[-1]) == (1038, 1, 1200)
    assert recording.streams['scan'].tolist() == [1134]
    assert recording.streams['image_0'].tolist() == [1134]
    assert recording.cameras == {0: '0', 1: '1'}
    frame = recording.frame(1134)
    assert frame.points[0].tolist() == pytest.approx([75.4411, 0.1631, 2.7601, 0], abs=5e-5)
    assert frame.image(0).shape == frame.image(1).shape == (376, 1408, 3)
    assert len(recording.frame(14).transform('map', 0)) == 4
    with pytest.raises(kitti_ros2.KittiRos2Error, match='has no frame 0;'):
        recording.frame(0)  # no drive has a pose of frame 0
    with pytest.raises(kitti_ros2.KittiRos2Error, match='has no frame 2;'):
        recording.frame(2)


def test_poses_are_imu_link_and_camera_0_is_the_rectified_one(real_360):
    """cam0_to_world.txt, all lines of 0003: 5e-7 and 5e-4 m, its rounding."""
    recording = open_recording(real_360, ReadOptions(sequence='0003'))
    calibration = recording.calibration(0)
    rig = kitti_ros2.read_calibration(real_360 / 'calibration')
    imu_t_cam0 = rig.transform('imu_link', 0)
    rows = np.loadtxt(real_360 / f'data_poses/{D.format("0003")}/cam0_to_world.txt')
    assert recording.streams[Stream.POSE].numbers.tolist() == rows[:, 0].tolist()
    assert calibration.r0_rect is not None
    for number, *values in rows.tolist():
        pose = recording.read(Stream.POSE, int(number)).world_T_imu.matrix()
        assert pose[2, 2] > 0.97  # z up
        expected = np.reshape(values, (4, 4))
        np.testing.assert_allclose((pose @ imu_t_cam0)[:3, :3], expected[:3, :3], atol=3e-6)
        np.testing.assert_allclose((pose @ imu_t_cam0)[:3, 3], expected[:3, 3], atol=6e-4)


ROUTES = {  # poses, length in metres of those of the GPS/IMU, numbers between them without one
    '0003': (1010, 1378.57, 20),
    '0000': (1038, 724.94, 162),
}
MISSING_0003 = '2 3 5 7 9 142 144 146 147 149 150 152 153 155 156 158 160 162 164 166'


@pytest.mark.parametrize('drive', ROUTES)
def test_the_route_of_a_drive(real_360, drive):
    poses, length_m, missing = ROUTES[drive]
    route = statistics(real_360, sequence=drive).total.route
    assert route.poses == poses
    assert route.length_m == pytest.approx(length_m, abs=5e-3)
    numbers = open_recording(real_360, ReadOptions(sequence=drive)).streams[Stream.POSE].numbers
    between = np.setdiff1d(np.arange(1, numbers[-1]), numbers)
    assert len(between) == missing
    if drive == '0003':
        assert ' '.join(map(str, between)) == MISSING_0003
        assert route.speed_m_s.mean == pytest.approx(13.0, abs=0.05)
        assert route.speed_m_s.greatest == pytest.approx(17.1, abs=0.05)


# First point, and the number of points without reflectance.
FIRST_POINTS = {
    ('0000', 1134): ((75.4411, 0.1631, 2.7601, 0), 11111),
    ('0008', 3000): ((34.2208, 0.0598, 1.3663, 0.19921875), 8295),
    ('0008', 3001): ((32.5937, 0.0045, 1.3113, 0.13671875), 8104),
}


@pytest.mark.parametrize(('drive', 'number'), FIRST_POINTS)
def test_the_points_of_a_scan(real_360, drive, number):
    points = open_recording(real_360, ReadOptions(sequence=drive)).read(Stream.SCAN, number).points
    first, dark = FIRST_POINTS[drive, number]
    assert points[0].tolist() == pytest.approx(first, abs=5e-5)
    assert np.count_nonzero(points[:, 3] == 0) == dark
    assert np.array_equal(points[:, 3] * 256, np.rint(points[:, 3] * 256))
    laser = rings(points)
    assert laser.tolist() == sorted(laser.tolist(), reverse=True)  # the top row is the first
    assert (laser[0], laser[-1]) == (63, 0)
    elevation = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    assert 2.0 < np.median(elevation[laser == 63]) < 2.8
    assert -23.8 < np.median(elevation[laser == 0]) < -23.3


def test_camera_poses_alone_serve(set_of_links):
    path = set_of_links / f'data_poses/{D.format("0008")}/poses.txt'
    options = ReadOptions(sequence='0008')
    fine = open_recording(set_of_links, options)
    path.unlink()
    coarse = open_recording(set_of_links, options)
    assert any('read without poses.txt' in note for note in coarse.notes)
    numbers = fine.streams[Stream.POSE].numbers.tolist()
    assert coarse.streams[Stream.POSE].numbers.tolist() == numbers
    for number in numbers:
        one, other = (each.read(Stream.POSE, number).world_T_imu for each in (fine, coarse))
        np.testing.assert_allclose(one.matrix(), other.matrix(), atol=2e-3)


@pytest.mark.parametrize(
    ('drive', 'stream', 'first', 'last'),
    [
        ('0003', 'image_00', 1369735051995373568, 1369735159763863296),
        ('0003', 'image_01', 1369735051995376640, None),
        ('0003', 'velodyne_points', 1369735051995970538, 1369735159760662706),
        ('0000', 'image_00', 1369730762904483072, None),
        ('0000', 'velodyne_points', 1369730762904295089, None),
    ],
)
def test_stamps(real_360, drive, stream, first, last):
    part = 'data_3d_raw' if stream == 'velodyne_points' else 'data_2d_raw'
    path = real_360 / part / D.format(drive) / stream / 'timestamps.txt'
    stamps = read_stamps(path)
    assert stamps[0] == first
    assert last in (None, stamps[-1])


def test_poses_have_the_stamps_of_the_scans(real_360):
    recording = open_recording(real_360, ReadOptions(sequence='0003'))
    path = real_360 / f'data_3d_raw/{D.format("0003")}/velodyne_points/timestamps.txt'
    stamps = read_stamps(path)
    index = recording.streams[Stream.POSE]
    assert index.stamps_ns.tolist() == [stamps[number] for number in index.numbers.tolist()]
    assert recording.clock is Clock.UTC
    assert any(
        '1,010 poses of frames 1 to 1030, 20 between them have none' in note
        for note in recording.notes
    )


def test_a_fisheye_without_stamps_has_those_of_another_stream(real_360):
    recording = open_recording(real_360, ReadOptions(sequence='0003'))
    scans = real_360 / f'data_3d_raw/{D.format("0003")}/velodyne_points/timestamps.txt'
    index = recording.streams[Stream.IMAGE_2]
    assert index.numbers.tolist() == [0]
    assert index.stamps_ns.tolist() == [read_stamps(scans)[0]]
    assert any('no timestamps.txt; stamped as scan' in note for note in recording.notes)
    assert (recording.read(Stream.IMAGE_2, 0).width, PIXELS[2][0]) == (1400, 1400)


def test_without_any_stamps_frames_are_a_nominal_period_apart(real_360):
    recording = open_recording(real_360, ReadOptions(sequence='0008'))
    assert recording.clock is Clock.NOMINAL
    assert recording.streams[Stream.SCAN].numbers.tolist() == [3000, 3001]


@pytest.mark.parametrize('below', ['', 'data_3d_raw', f'data_3d_raw/{D.format("0008")}'])
def test_a_level_below_is_opened(real_360, below):
    assert guess_layout(real_360 / below) is Layout.KITTI_360
    opened = [recording.name for recording in open_recordings(real_360 / below)]
    if below.endswith('sync'):
        assert opened == [D.format('0008')]
    else:
        assert opened == [D.format(n) for n in ('0000', '0003', '0004', '0008', '0010')]


def test_the_files_of_the_second_half_of_a_drive(tmp_path, recordings):
    """Drive 0018 is the beginning of 0002; its files begin at 4391, its stamps at 0."""
    shutil.copytree(recordings[Layout.KITTI_360], tmp_path / 'set')
    shutil.rmtree(tmp_path / 'set/data_3d_bboxes')
    for folder in [*(tmp_path / 'set').glob('data_*/*')]:
        folder.rename(folder.with_name(D.format('0002')))
    for folder in (tmp_path / 'set').glob('data_*/*/*/data*'):
        stamps = folder.parent / 'timestamps.txt'
        stamps.write_text(stamps.read_text().splitlines()[0].join(('', '\n')) * 4391
                          + stamps.read_text())  # fmt: skip
        for path in sorted(folder.iterdir(), reverse=True):
            path.rename(path.with_name(f'{int(path.stem) + 4391:010d}{path.suffix}'))
    recording = open_recording(tmp_path / 'set')
    assert not recording.losses
    assert sum('begin at 4391; drive 0018' in note for note in recording.notes) == 6
    assert sum('poses to frame 3750 are drive 0018' in note for note in recording.notes) == 1
    assert recording.streams[Stream.SCAN].numbers[0] == 4391
    convert_recording(tmp_path / 'set', tmp_path / 'bag.mcap')
    with kitti_ros2.open(tmp_path / 'bag.mcap') as bag:
        assert bag.numbers[-5:].tolist() == [4391, 4392, 4393, 4394, 4395]
        assert not bag.losses


def test_a_calibration_survives_its_files(real_360):
    folder = real_360 / 'calibration'
    texts = {name: (folder / name).read_text() for name in KITTI_360_CALIB}
    first = parse_kitti360_calibration(texts, folder)
    again = parse_kitti360_calibration(format_kitti360_calibration(first), folder)
    assert not again.missing
    np.testing.assert_allclose(again.velo_T_imu.matrix(), first.velo_T_imu.matrix(), atol=1e-9)
    for index, camera in first.cameras.items():
        np.testing.assert_allclose(again.cameras[index].p_rect, camera.p_rect, atol=1e-9)
        if camera.lens is not None:
            np.testing.assert_array_equal(again.cameras[index].lens.d, camera.lens.d)
            np.testing.assert_allclose(
                again.cameras[index].cam_T_velo.matrix(), camera.cam_T_velo.matrix(), atol=1e-8
            )


@pytest.mark.parametrize(
    ('name', 'old', 'new', 'reason'),
    [
        ('calib_cam_to_pose.txt', 'image_02:', 'image_07:', 'calib_cam_to_pose.txt: no image_02'),
        ('calib_cam_to_velo.txt', '0.99516', 'nonsense', 'is no number; expected 12 numbers'),
        (
            'calib_cam_to_velo.txt',
            None,
            None,
            'calib_cam_to_velo.txt: no such file; calibration.zip',
        ),
        ('perspective.txt', 'R_rect_00', 'R_rect_07', 'perspective.txt: no R_rect_00'),
        ('image_02.yaml', 'MEI', 'EUCM', 'image_02.yaml:2: model_type is EUCM; expected MEI'),
        ('image_02.yaml', '   xi', '   eta', 'image_02.yaml: no xi'),
        ('image_02.yaml', ': 1400', ': 0', 'image_02.yaml: images of 0x0; expected whole pixels'),
        ('image_02.yaml', 'e: image_02', 'e: image_03', '.yaml:3: camera_name is image_03'),
        ('image_02.yaml', '2.2134', '.Inf', "image_02.yaml:7: xi: '.Inf"),
        ('image_03.yaml', None, None, 'image_03.yaml: no such file'),
    ],
)
def test_what_a_calibration_lacks_is_named(set_of_links, tmp_path, name, old, new, reason):
    root = tmp_path / 'set'
    shutil.copytree(set_of_links, root)
    path = root / 'calibration' / name
    text = path.read_text()
    path.unlink()
    if old is not None:
        path.write_text(text.replace(old, new))
    missing = open_recording(root, ReadOptions(sequence='0003')).calibration(0).missing
    assert any(reason in each for each in missing.values()), missing


MOUNTS = {2: [-0.05, 0.45, 0.23], 3: [-0.07, -0.45, 0.24]}


@pytest.mark.parametrize('missing', ['', 'image_0*.yaml', '*'])
def test_a_fisheye_without_a_model_looks_to_its_side(set_of_links, tmp_path, capsys, missing):
    """Its mount is in another file; without that the nominal one is KITTI-360's."""
    root = tmp_path / 'set'
    shutil.copytree(set_of_links, root)
    for path in (root / 'calibration').glob(missing) if missing else ():
        path.unlink()
    recording = open_recording(root, ReadOptions(sequence='0003'))
    calibration = recording.calibration(0)
    mounted = with_nominal_mounts(calibration, {0, 1, 2, 3})
    for index, place in MOUNTS.items():
        velo_t_camera = mounted.cameras[index].cam_T_velo.inverse()
        np.testing.assert_allclose(velo_t_camera.translation, place, atol=0.01)
        side = velo_t_camera.rotation @ [0, 0, 1]
        np.testing.assert_allclose(side, [0, 1 if index == 2 else -1, 0], atol=0.05)
    np.testing.assert_allclose(
        mounted.cam0_T_velo.inverse().translation, [0.8, 0.3, -0.18], atol=0.01
    )
    nominal = [part for part in mounted.nominal if part.startswith('the mount of camera')]
    assert len(nominal) == (3 if missing == '*' else 0)
    assert main(['info', str(root), '--sequence', '3']) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == len(set(said))
    assert any('image_02.yaml: no such file' in line for line in said) is (
        missing == 'image_0*.yaml'
    )


def test_lines_of_poses():
    row = ' '.join(map(str, np.eye(3, 4).ravel()))
    text = f'4 {row}\n7 {row} \n7 {row}\nx {row}\n9 1 2\n11 {row} 0 0 0 1\n'
    lines, numbers = parse_kitti360_poses(text, Path('poses.txt'))
    assert [numbers[line] for line in lines.sound()] == [4, 7]
    assert [error.line for error in lines.errors.values()] == [3, 4, 5, 6]
    reasons = ' '.join(map(str, lines.errors.values()))
    for reason in ('frame 7 again', "'x' is no frame number", '3 values', '17 values'):
        assert reason in reasons
    text = f'4 {row} 0 0 0 1 \n7 {row}\n11 {row} 0 0 1 1\n'
    lines, numbers = parse_kitti360_poses(text, Path('cam0_to_world.txt'))
    assert [numbers[line] for line in lines.sound()] == [4]
    reasons = ' '.join(map(str, lines.errors.values()))
    for reason in ('13 values; expected a frame number and 16 numbers', 'last row is not'):
        assert reason in reasons


def test_info_names_the_model_of_fisheyes(real_360, capsys):
    """Their focal lengths are no pinhole's: 1336 of 1400 pixels are no 55 degrees."""
    assert main(['info', str(real_360), '--sequence', '3']) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[:2] for line in lines if line and line[0].startswith('camera_')][:4] == [
        ['camera_0', '1408x376'],
        ['camera_1', '1408x376'],
        ['camera_2', '(mei)'],
        ['camera_3', '(mei)'],
    ]


# What a drive lacks, or has under another name: the change, and what is said of it.
NEXT = D.format('0000')


def renamed(old: str, new: str):
    return lambda root: (root / old).rename(root / new)


def without(name: str):
    return lambda root: shutil.rmtree(root / name)


def emptied(name: str):
    return lambda root: (root / name).write_bytes(b'')


SAID = {
    'poses without _sync': (
        renamed(f'data_poses/{NEXT}', 'data_poses/2013_05_28_drive_0000'),
        f'data_poses/2013_05_28_drive_0000: not read; expected a folder {NEXT}',
    ),
    'images in data_rgb': (
        renamed(f'data_2d_raw/{NEXT}/image_00/data_rect', f'data_2d_raw/{NEXT}/image_00/data_rgb'),
        'image_00/data_rgb: not read; expected a folder data_rect',
    ),
    'empty poses.txt': (
        emptied(f'data_poses/{NEXT}/poses.txt'),
        'cam0_to_world.txt: read without poses.txt, which has more digits',
    ),
    'poses.txt is cam0_to_world.txt': (
        renamed(f'data_poses/{NEXT}/cam0_to_world.txt', f'data_poses/{NEXT}/poses.txt'),
        'poses.txt: no valid pose, pose is left out',
    ),
    'the SLAM benchmark beside': (
        lambda root: (root / 'data_2d_test_slam').mkdir(),
        'data_2d_test_slam: not converted',
    ),
    'no poses': (
        without(f'data_poses/{NEXT}'),
        'poses.txt: absent or empty, pose is left out',
    ),
    'no images': (without('data_2d_raw'), 'image_00: absent, image_0 is left out'),
    'no scans': (without('data_3d_raw'), 'velodyne_points: absent, scan is left out'),
}


@pytest.mark.parametrize('case', SAID)
def test_other_names_and_missing_parts_are_named(recordings, tmp_path, case):
    change, expected = SAID[case]
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.KITTI_360], root)
    change(root)
    recording = open_recording(root)
    said = [*recording.notes, *(loss.text() for loss in recording.losses)]
    assert any(line.endswith(expected) for line in said), said


@pytest.mark.parametrize('below', ['', 'data_2d_raw', 'data_2d_raw/2013_05_28_drive_0000'])
def test_drives_of_other_names_are_no_drives(tmp_path, below):
    (tmp_path / 'data_2d_raw/2013_05_28_drive_0000/image_00/data_rect').mkdir(parents=True)
    with pytest.raises(kitti_ros2.KittiRos2Error, match=f'name drives like {NEXT}'):
        open_recording(tmp_path / below)


@pytest.mark.parametrize('levels', range(5))
def test_the_slam_benchmark_is_no_raw_drive(recordings, tmp_path, levels):
    """Its folders are named as those of a raw drive."""
    scans = recordings[Layout.KITTI_360] / f'data_3d_raw/{NEXT}/velodyne_points'
    below = Path('data_3d_test_slam', 'test_3', NEXT, 'velodyne_points')
    shutil.copytree(scans, tmp_path / below)
    with pytest.raises(kitti_ros2.KittiRos2Error, match=f'put a drive of it at data_3d_raw/{NEXT}'):
        open_recording(tmp_path / Path(*below.parts[:levels]))


def test_a_merged_drive_is_said_to_be_of_kitti_360(recordings, tmp_path):
    scans = recordings[Layout.KITTI_360] / f'data_3d_raw/{NEXT}/velodyne_points'
    shutil.copytree(scans, tmp_path / NEXT / 'velodyne_points')
    missing = open_recording(tmp_path).calibration(0).missing
    assert any('in KITTI-360, drives are in data_2d_raw' in reason for reason in missing.values())


def test_a_tilted_pose_is_left_out(real_360):
    """The first one of drive 0004; the map would begin there."""
    recording = open_recording(real_360, ReadOptions(sequence='0004'))
    assert recording.streams[Stream.POSE].numbers[0] == 54
    (loss,) = recording.losses
    assert loss.numbers == (1,)
    assert 'poses lean by more than 60 degrees, or their z is not down' in loss.text()


@pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
def test_what_is_usual_in_the_data_set_is_no_finding(real_360):
    """9.57 Hz, no pose of frame 0 and of stops; the samples are excerpts, without most files."""
    report = kitti_ros2.datasets.validate(real_360)
    (tilted,) = (each for each in report.findings if each.severity != 'note'
                 and each.rule != 'frames-missing')  # fmt: skip
    assert tilted.place.endswith(f'{D.format("0004")}/poses.txt:1')
    assert tilted.message == 'the vehicle leans by 74 degrees'
