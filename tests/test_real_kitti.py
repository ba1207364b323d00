# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Real KITTI through real bags: the expected values of the samples' own description."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.source_texts import decode_sweep
from kitti_ros2.model.streams import Stream
from kitti_ros2.options.read import ReadOptions

from builders import convert_recording, seen_by  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

POINTS = '/kitti/velo/points'
CONTAINERS = {'mcap': 'o.mcap', 'sqlite3': 'o', 'ros1': 'o.bag'}
COUNTS = {
    'raw': {POINTS: 1, '/kitti/oxts/imu': 154, '/tf': 154,
            '/kitti/camera_gray_left/image_rect/compressed': 1, '/tf_static': 1},
    'object': {POINTS: 3, '/kitti/camera_color_left/image_rect/compressed': 3,
               '/kitti/camera_color_left/camera_info': 3, '/kitti/source/labels': 3},
    'odometry': {POINTS: 2, '/kitti/ground_truth/odometry': 4541, '/tf': 4541,
                 '/kitti/ground_truth/path': 1},
    'tracking': {'/kitti/oxts/fix': 154, '/kitti/oxts/vel': 154, '/kitti/source/labels': 154},
}  # fmt: skip


def source(real_kitti: Path, layout: str) -> Path:
    raw = real_kitti / 'raw' / '2011_09_26'
    return {
        'raw': raw / '2011_09_26_drive_0005_sync',
        'object': real_kitti / 'object',
        'odometry': real_kitti / 'odometry' / 'dataset',
        'tracking': real_kitti / 'tracking',
    }[layout]


def run(path: Path, out: Path, sequence: str | None = None, storage: str = 'mcap'):
    return convert_recording(path, out, read=ReadOptions(sequence=sequence), storage=storage)


def read(path: Path, *topics: str) -> dict[str, list]:
    found: dict[str, list] = {}
    with open_messages(path, topics or None) as messages:
        for item in messages:
            found.setdefault(item.topic, []).append(
                (item.stamp_ns, deserialize(item.data, item.msgtype))
            )
    return found


@pytest.mark.one_in(3)
@pytest.mark.parametrize('storage', CONTAINERS)
@pytest.mark.parametrize('layout', COUNTS)
def test_message_counts_equal_file_counts(real_kitti, tmp_path, layout, storage):
    report = run(source(real_kitti, layout), tmp_path / CONTAINERS[storage], storage=storage)
    counts = Counter()
    with open_messages(report.path) as messages:
        for item in messages:
            counts[item.topic] += 1
    assert counts == Counter({topic: n for topic, n in report.counts.items() if n})
    for topic, count in COUNTS[layout].items():
        assert counts[topic] == count, topic


def project(static, info, points):
    """Pixels, homogeneous: by the decoded TF and CameraInfo."""
    seen = seen_by(static, info, points[:, :3].astype(np.float64))
    return np.column_stack([seen, np.ones(len(seen))]) @ info.p.reshape(3, 4).T, seen[:, 2]


def reduced_crop(static, info, points):
    """What OpenPCDet and mmdet3d keep as velodyne_reduced."""
    pixels, _ = project(static, info, points)
    depth = pixels[:, 2]
    u, v = pixels[:, 0] / depth, pixels[:, 1] / depth
    inside = (depth > 0.001) & (depth < 100)
    return points[inside & (u > 0) & (u < info.width) & (v > 0) & (v < info.height)]


def reference_crop(static, info, points):
    """What the beginners' crop script keeps."""
    points = points[points[:, 3] > 0]
    pixels, z = project(static, info, points)
    col, row = np.round(pixels[:, 0] / pixels[:, 2]), np.round(pixels[:, 1] / pixels[:, 2])
    return points[(z >= 0) & (col > 0) & (col < info.width) & (row > 0) & (row < info.height)]


def test_crops_through_the_decoded_messages(real_kitti, tmp_path):
    found = read(run(source(real_kitti, 'object'), tmp_path / 'o.mcap').path)
    statics = dict(found['/tf_static'])
    static = None
    reference = []
    for number, ((stamp, cloud), (_, info)) in enumerate(
        zip(found[POINTS], found['/kitti/camera_color_left/camera_info'], strict=True)
    ):
        static = statics.get(stamp, static)
        points = cloud.data.view('<f4').reshape(-1, 4)
        expected = real_kitti / 'object' / 'training' / 'velodyne_reduced' / f'{number:06d}.bin'
        assert reduced_crop(static, info, points).tobytes() == expected.read_bytes()
        reference.append(len(reference_crop(static, info, points)))
    assert reference == [19030, 15826, 18272]


def test_points_in_the_image_of_raw_drives(real_kitti, tmp_path):
    raw = real_kitti / 'raw'
    counts = []
    for sequence in ('0005', '0052'):
        found = read(run(raw, tmp_path / f'{sequence}.mcap', sequence).path)
        [(_, static)] = found['/tf_static']
        info = found['/kitti/camera_color_left/camera_info'][0][1]
        for _, cloud in found[POINTS]:
            points = cloud.data.view('<f4').reshape(-1, 4)
            pixels, _ = project(static, info, points)
            u, v, depth = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2], pixels[:, 2]
            counts.append(int(((depth > 0) & (u > 0) & (u < 1242) & (v > 0) & (v < 375)).sum()))
    assert counts == [20478, 16333, 16298, 16125, 15782, 15469, 15306, 15196, 15187]


def test_stamps_are_the_dataset_s_nanoseconds(real_kitti, tmp_path):
    found = read(run(real_kitti / 'raw', tmp_path / 'o.mcap', '0005').path)
    [(stamp, sweep)] = found['/kitti/source/sweep']
    start, end = decode_sweep(sweep)
    assert stamp == found[POINTS][0][0] == 1317042272335337762
    assert stamp == pytest.approx((start + end) / 2, abs=1000)
    assert found['/kitti/camera_color_left/camera_info'][0][0] == 1317042272345808896


@pytest.mark.parametrize(('sequence', 'metres'), [('0001', 106.96), ('0005', 69.40)])
def test_path_lengths(real_kitti, tmp_path, sequence, metres):
    found = read(run(real_kitti / 'raw', tmp_path / 'o.mcap', sequence).path)
    recording = open_recording(real_kitti / 'raw', ReadOptions(sequence=sequence))
    poses = recording.trajectory(recording.streams[Stream.POSE].numbers.tolist()).world_T_imu
    steps = np.diff([pose.translation for pose in poses], axis=0)
    assert np.linalg.norm(steps[:, :2], axis=1).sum() == pytest.approx(metres, abs=0.005)
    [(_, path)] = found['/kitti/ground_truth/path']
    assert len(path.poses) == len(poses)


def test_first_packet_of_drive_0001(real_kitti, tmp_path):
    found = read(run(real_kitti / 'raw', tmp_path / 'o.mcap', '0001').path)
    stamp, fix = found['/kitti/oxts/fix'][0]
    assert stamp == 1317042145964389445
    assert (fix.latitude, fix.longitude, fix.altitude) == (
        49.015003823272,
        8.4342971002335,
        116.43032836914,
    )
    az = [imu.linear_acceleration.z for _, imu in found['/kitti/oxts/imu']]
    assert np.mean(az) == pytest.approx(9.801, abs=5e-4)


def test_odometry_path_length(real_kitti):
    recording = open_recording(real_kitti / 'odometry' / 'dataset')
    poses = recording.trajectory(recording.streams[Stream.POSE].numbers.tolist()).world_T_imu
    camera = np.array([pose.translation for pose in poses])
    assert len(poses) == 4541
    # The imu swings about the camera in turns, so its way is a little longer than the camera's.
    assert np.linalg.norm(np.diff(camera, axis=0), axis=1).sum() == pytest.approx(3724.2, abs=30)


def test_a_gap_in_a_real_drive(make_drive, tmp_path):
    whole = read(run(make_drive(10), tmp_path / 'whole.mcap').path)
    report = run(make_drive(10, 'velodyne_points:5-6'), tmp_path / 'gapped.mcap')
    gapped = read(report.path)
    for topic in (POINTS, '/kitti/source/sweep'):
        del whole[topic][5:7]
    assert {topic: [stamp for stamp, _ in items] for topic, items in gapped.items()} == {
        topic: [stamp for stamp, _ in items] for topic, items in whole.items()
    }
    assert all(len(str(stamp)) == 19 for items in gapped.values() for stamp, _ in items)
    [loss] = report.losses
    assert 'no file for frames 5-6, which timestamps.txt lists' in loss.message
